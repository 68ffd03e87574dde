"""The built-in transparent scene: nested see-through shells with bumps, like scans of statues one inside the other.

Closed surfaces about the origin, 2 m across, each of one colour and alpha 0.5, each around the next smaller one, and
rings that pass through them; no light casts a shadow. A ray through the middle crosses every shell twice.
"""

from __future__ import annotations

import numpy as np

from shading_atlas_bench.arithmetic import draws
from shading_atlas_bench.arithmetic.arrays import Doubles
from shading_atlas_bench.arithmetic.functions import power, sin, sin_cos
from shading_atlas_bench.arithmetic.matrices import transform
from shading_atlas_bench.scenes.builder import Mesh, Palette, lattice_indices, mesh, without_slivers
from shading_atlas_bench.scenes.model import Camera, Light, Material, Scene, SceneError, Sky

DEFAULT_DETAIL = 60_000
LEAST_DETAIL, MOST_DETAIL = 2_000, 5_000_000
ALPHA = 0.5
ACROSS = 2.0  # metres, bumps and all
SHELLS = (  # radius, colour, share of the triangles
    (1.0, (0.75, 0.30, 0.12), 0.4),
    (0.72, (0.15, 0.45, 0.70), 0.3),
    (0.45, (0.70, 0.62, 0.20), 0.2),
)
RINGS = (  # radii of the ring and of its tube, tilt in degrees, colour
    (0.85, 0.09, 25.0, (0.25, 0.60, 0.25)),
    (0.60, 0.07, 100.0, (0.60, 0.20, 0.55)),
)


def _surface(points: Doubles, material: int) -> Mesh:
    """A closed lattice of points (rows, columns, 3), smooth, front outwards; its columns close, its rows need not."""
    rows, columns = points.shape[:2]
    around = np.gradient(np.concatenate([points[:, -2:-1], points, points[:, 1:2]], axis=1), axis=1)[:, 1:-1]
    along = np.gradient(points, axis=0)
    normals = np.cross(around, along)
    lengths = np.linalg.norm(normals, axis=2, keepdims=True)
    outwards = points / np.maximum(np.linalg.norm(points, axis=2, keepdims=True), 1e-9)
    normals = np.where(lengths > 1e-9, normals / np.maximum(lengths, 1e-9), outwards)
    v, u = np.mgrid[0 : 1 : rows * 1j, 0 : 1 : columns * 1j]
    return without_slivers(mesh(points, normals, np.stack([u, v], axis=-1), lattice_indices(rows, columns), material))


def _shell(radius: float, triangles: int, material: int, rng: draws.Generator) -> Mesh:
    """A ball whose radius waves by up to a tenth."""
    rows = max(6, int(np.sqrt(triangles / 4)))
    phi, theta = np.meshgrid(np.linspace(-np.pi / 2, np.pi / 2, rows + 1), np.linspace(0, 2 * np.pi, 2 * rows + 1))
    phi, theta = phi.T, theta.T
    (above, level), (aside, ahead) = sin_cos(phi), sin_cos(theta)
    directions = np.stack([level * aside, above, level * ahead], axis=-1)
    directions[:, -1] = directions[:, 0]
    directions[[0, -1]] = np.array([[[0, -1, 0]], [[0, 1, 0]]])
    waves = np.zeros(phi.shape)
    for frequency in (3.0, 6.0, 12.0, 24.0):
        axes, shifts = rng.normal(size=(3, 3)), rng.uniform(0, 2 * np.pi, 3)
        waves += sin(transform(axes, frequency * directions) + shifts).sum(axis=-1) / power(frequency, 0.8)
    return _surface(directions * (radius * (1 + 0.1 * waves / np.abs(waves).max()))[..., None], material)


def _ring(radius: float, tube: float, tilt: float, triangles: int, material: int) -> Mesh:
    """A torus about an axis that leans by `tilt` degrees from y."""
    columns = max(12, int(np.sqrt(triangles * 2)))
    rows = max(6, triangles // (2 * columns))
    around, along = np.meshgrid(np.linspace(0, 2 * np.pi, columns + 1), np.linspace(0, -2 * np.pi, rows + 1))
    (aside, ahead), (below, outwards) = sin_cos(around), sin_cos(along)
    reach = radius + tube * outwards
    points = np.stack([reach * aside, -tube * below, reach * ahead], axis=-1)
    points[:, -1], points[-1] = points[:, 0], points[0]
    sine, cosine = sin_cos(np.radians(tilt))
    turn = np.array([[1, 0, 0], [0, cosine, -sine], [0, sine, cosine]])
    return _surface(transform(turn, points), material)


def make_shells(detail: int = DEFAULT_DETAIL, seed: int = 0) -> Scene:
    """The shells with `detail` triangles (2,000 to 5,000,000; within 5%), the same for the same detail and seed.

    Raises SceneError for a detail outside that range.
    """
    if not LEAST_DETAIL <= detail <= MOST_DETAIL:
        raise SceneError(
            f"The shells can have {LEAST_DETAIL:,} to {MOST_DETAIL:,} triangles, not {detail:,}; choose one between."
        )
    rng, palette = draws.generator(seed), Palette()

    def glass(name: str, colour: tuple[float, float, float]) -> int:
        return palette.material(
            Material(name, base_colour=(*colour, ALPHA), alpha_mode="blend", double_sided=True, roughness=0.6)
        )

    parts = [
        _shell(radius, int(share * detail), glass(f"shell {number}", colour), rng)
        for number, (radius, colour, share) in enumerate(SHELLS, 1)
    ]
    left = (detail - sum(part.triangle_count for part in parts)) // len(RINGS)
    parts += [
        _ring(radius, tube, tilt, left, glass(f"ring {number}", colour))
        for number, (radius, tube, tilt, colour) in enumerate(RINGS, 1)
    ]
    points = np.concatenate([part.positions for part in parts]).astype(np.float64)
    sun = Light("directional", (1.9, 1.8, 1.6), direction=(-0.4, -1.0, -0.6), shadows=False)
    return palette.assemble(
        "shells",
        parts,
        lights=[sun],
        sky=Sky((0.20, 0.26, 0.38), (0.30, 0.33, 0.36), (0.10, 0.09, 0.08)),
        cameras=[Camera((0.0, 0.5, 3.4), (0.0, -0.147, -1.0), name="front")],
        metres_per_unit=ACROSS / float((points.max(axis=0) - points.min(axis=0)).max()),
        place=False,
    )
