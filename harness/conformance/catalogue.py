"""The catalogue of adversarial scenes: a test is one function of a magnitude, registered with the magnitudes to try.

A test's function makes a `TrialCase` (scene, poses, sets, settings) as hard as its magnitude says; magnitudes are
listed from mild to hard. `@stress(name, what, magnitudes)` adds it to CATALOGUE, and nothing else has to be done.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from shading_atlas_bench.arithmetic import draws
from shading_atlas_bench.arithmetic.arrays import Array, Doubles
from shading_atlas_bench.arithmetic.functions import cos, sin, tan
from shading_atlas_bench.harness.conformance.trial import TrialCase
from shading_atlas_bench.harness.workload.views import Pose, ViewCell
from shading_atlas_bench.scenes.assemble import assemble
from shading_atlas_bench.scenes.features import find_features
from shading_atlas_bench.scenes.model import Light, Material, Scene
from shading_atlas_bench.scenes.paths import PathError, make_path
from shading_atlas_bench.scenes.raw import Part, RawScene

Magnitudes: TypeAlias = tuple[float, ...]
PIXELS_PER_TANGENT = 80 / tan(np.radians(30))  # of a trial's client, 160 pixels wide at 60 degrees
DOUBLE = Material(base_colour=(0.9, 0.9, 0.9, 1.0), double_sided=True)
LAMP = Light("point", (8.0, 7.5, 7.0), (0.5, 1.0, 1.0))
SUN = Light("directional", (1.2, 1.2, 1.1), direction=(-0.3, -1.0, -0.5))
AHEAD = np.array([0.0, 0.0, 0.0, 1.0])


Make: TypeAlias = Callable[[float], TrialCase]


@dataclass(frozen=True)
class StressTest:
    """A test of the catalogue.

    magnitudes: from mild to hard. what: in a sentence's end. unit: of the magnitude.
    invariant: the picture must stay that of the first magnitude. refusable: refusing the input in a sentence is right.
    """

    name: str
    what: str
    magnitudes: Magnitudes
    make: Make
    unit: str = ""
    invariant: bool = False
    refusable: bool = False


CATALOGUE: dict[str, StressTest] = {}


def stress(
    name: str,
    what: str,
    magnitudes: Magnitudes,
    *,
    unit: str = "",
    invariant: bool = False,
    refusable: bool = False,
) -> Callable[[Make], Make]:
    """Register a test."""

    def add(make: Make) -> Make:
        CATALOGUE[name] = StressTest(name, what, magnitudes, make, unit, invariant, refusable)
        return make

    return add


def powers(first: int, last: int) -> Magnitudes:
    """Powers of ten."""
    return tuple(float(f"1e{k}") for k in range(first, last + (1 if last >= first else -1), 1 if last >= first else -1))


# Scenes


def grid(
    corner: ArrayLike, along_u: ArrayLike, along_v: ArrayLike, columns: int, rows: int, bump: float = 0.0
) -> Doubles:
    """Corners, float64 (T, 3, 3), of a parallelogram of columns x rows pairs of triangles, bent by up to `bump`.

    corner, along_u, along_v: (3), the corner at both sides' start, and the sides.
    """
    v, u = np.meshgrid(np.linspace(0, 1, rows + 1), np.linspace(0, 1, columns + 1), indexing="ij")
    right, up = np.asarray(along_u, np.float64), np.asarray(along_v, np.float64)
    normal = np.cross(right, up) / np.linalg.norm(np.cross(right, up), axis=-1)
    height = bump * sin(7 * u + 3 * v) * sin(np.pi * u) * sin(np.pi * v)
    points = np.asarray(corner) + u[..., None] * right + v[..., None] * up + height[..., None] * normal
    a, b, c, d = points[:-1, :-1], points[:-1, 1:], points[1:, 1:], points[1:, :-1]
    pairs = np.stack([np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)], axis=2)
    return pairs.reshape(-1, 3, 3)


def room() -> Doubles:
    """6 x 3 x 6 units around the origin: a floor of two triangles, bumpy walls, loose triangles, a few slivers.

    Their corners, float64 (T, 3, 3).
    """
    rng = draws.generator(7)
    x, y, z = np.diag([6.0, 3.0, 6.0])
    low = -(x + y + z) / 2
    loose = rng.uniform(-1, 1, (40, 1, 3)) * [2, 1, 1] + rng.normal(size=(40, 3, 3)) * 0.15
    loose[::6, 2] = loose[::6, 1] + 0.02 * (loose[::6, 2] - loose[::6, 1])
    walls = [grid(low + z, x, -z, 1, 1), grid(low, x, y, 8, 6, 0.15), grid(low + z, -z, y, 6, 4, 0.1)]
    return np.concatenate([*walls, grid(low + x, z, y, 6, 4, 0.1), loose])


def backdrop(distance: float = 4.0) -> Doubles:
    """A wall of triangles across the view: their corners, float64 (32, 3, 3)."""
    reach = distance * 0.9
    return grid((-reach, -reach, -distance), (2 * reach, 0, 0), (0, 2 * reach, 0), 4, 4)


def scene_of(
    corners: Doubles,
    offset: ArrayLike = (0, 0, 0),
    scale: float = 1.0,
    *,
    materials: Sequence[Material] = (DOUBLE,),
    poison: Callable[[RawScene], None] | None = None,
) -> Scene:
    """A scene as a file with these corners, (T, 3, 3), would give: scaled, moved by offset, (3), then loaded, all in
    float64.

    poison: is given the raw scene before it is loaded.
    """
    points, indices = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    colours = np.ones((len(points), 4), np.float32)
    colours[:, :3] = 0.55 + 0.4 * sin(3 * points)
    moved = np.asarray(offset, np.float64)
    lights = [replace(light, position=_triple(np.array(light.position) * scale + moved)) for light in (LAMP, SUN)]
    part = Part(points * scale + moved, indices.reshape(-1, 3), 0, colours=colours)
    raw = RawScene([part], list(materials), lights=lights)
    if poison:
        poison(raw)
    scene = assemble("stress", raw)
    scene.metres_per_unit = 1 / scale
    scene.features = find_features(scene)
    return scene


def _triple(values: Doubles) -> tuple[float, float, float]:
    x, y, z = values
    return x, y, z


def as_they_are(corners: Doubles) -> Scene:
    """A scene of exactly these corners, (T, 3, 3), as float32 and without a loader's cleaning."""
    positions, indices = np.unique(corners.reshape(-1, 3).astype(np.float32), axis=0, return_inverse=True)
    colours = np.ones((len(positions), 4), np.float32)
    colours[:, :3] = 0.55 + 0.4 * sin(3 * positions)
    up = np.tile(np.array([0, 1, 0], np.float32), (len(positions), 1))
    ids = np.zeros(len(corners), np.int32)
    faces = indices.reshape(-1, 3).astype(np.int32)
    uvs = np.zeros((len(positions), 2), np.float32)
    return Scene("stress", positions, faces, up, uvs, colours, ids, [DOUBLE], lights=[LAMP])


def walk(scene: Scene, count: int = 2, offset: ArrayLike = (0, 0, 0), scale: float = 1.0) -> tuple[Pose, ...]:
    """Poses in the room at `offset`, (3), and `scale`, as for `scene_of`: 3 cm and 2 degrees a step."""
    poses = []
    for step in range(count):
        half = np.radians(2 * step) / 2
        position = np.array([0.03 * step, 0, 2 - 0.01 * step]) * scale + np.asarray(offset) - scene.origin
        poses.append(Pose(position, np.array([0, sin(half), 0, cos(half)])))
    return tuple(poses)


def still(scene: Scene, count: int = 2) -> tuple[Pose, ...]:
    """A camera at the file's origin that looks along -z."""
    return (Pose(-scene.origin, AHEAD),) * count


def seen_from_origin(corners: Doubles, atlas: tuple[int, int] = (256, 256)) -> TrialCase:
    """A case of a scene of these corners, (T, 3, 3), seen from the file's origin along -z."""
    scene = scene_of(corners)
    return TrialCase(scene, still(scene), atlas=atlas)


def facing(centres: Doubles, radius: Doubles | float) -> Doubles:
    """Equilateral triangles (n, 3, 3) that face +z, at centres (n, 3), each turned otherwise; radius: one, or (n)."""
    turn = np.arange(len(centres))[:, None] * 2.4 + np.arange(3) * 2 * np.pi / 3
    spokes = np.stack([cos(turn), sin(turn), np.zeros_like(turn)], axis=-1)
    corners: Doubles = centres[:, None] + spokes * np.broadcast_to(radius, len(centres))[:, None, None]
    return corners


def scattered(count: int, distance: float, seed: int = 1) -> Doubles:
    """Points (count, 3) all over the client's picture, at about a distance along -z."""
    rng = draws.generator(seed)
    across = rng.uniform(-0.5, 0.5, (count, 2)) * [1, 0.55]
    depth = distance * rng.uniform(0.8, 1.2, (count, 1))
    return np.concatenate([across * depth, -depth], axis=1)


# Where the scene is, and how large


@stress("world-offset", "the scene moved away from the world's origin", powers(0, 7), unit="units", invariant=True)
def world_offset(magnitude: float) -> TrialCase:
    """The room from a file in which it is `magnitude` times (1, 0.5, -1) away from the origin."""
    offset = magnitude * np.array([1.0, 0.5, -1.0])
    scene = scene_of(room(), offset)
    return TrialCase(scene, walk(scene, offset=offset))


@stress("float32-offset", "positions far from their own float32 origin", powers(0, 7), unit="units")
def float32_offset(magnitude: float) -> TrialCase:
    """The room with float32 positions `magnitude` times (1, 0.5, -1) away from the scene's own origin."""
    offset = magnitude * np.array([1.0, 0.5, -1.0])
    scene = as_they_are(room() + offset)
    scene.lights = [replace(LAMP, position=_triple(np.array(LAMP.position) + offset))]
    return TrialCase(scene, walk(scene, offset=offset))


@stress("scale-up", "the scene in ever smaller units", powers(0, 6), unit="times", invariant=True)
def scale_up(magnitude: float) -> TrialCase:
    """The room, its camera, near plane and view cell, all `magnitude` times as large in units."""
    scene = scene_of(room(), scale=magnitude)
    cell = ViewCell(0.08 * magnitude, 80)
    return TrialCase(scene, walk(scene, scale=magnitude), near=0.02 * magnitude, cell=cell)


@stress("scale-down", "the scene in ever larger units", powers(0, -6), unit="times", invariant=True)
def scale_down(magnitude: float) -> TrialCase:
    """The room as `scale_up` makes it, with magnitudes of at most 1."""
    return scale_up(magnitude)


# Shapes of triangles


@stress("slivers", "triangles of ever smaller aspect", powers(0, -7), unit="height / length")
def slivers(magnitude: float) -> TrialCase:
    """200 triangles with a base of 1 unit and a height of `magnitude` on it, before a wall."""
    rng = draws.generator(2)
    start = scattered(200, 2.0)
    along = rng.normal(size=(200, 3))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = np.cross(along, [0, 0, 1])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    thin = np.stack([start, start + along, start + along / 2 + magnitude * across], axis=1)
    return seen_from_origin(np.concatenate([thin, backdrop()]))


@stress("zero-area", "triangles without area: points, lines and repeated corners", (1, 3, 10, 30, 100, 300, 1000))
def zero_area(magnitude: float) -> TrialCase:
    """`magnitude` triangles that are points, lines of two corners or lines of three in turn, before a wall."""
    corners = facing(scattered(int(magnitude), 2.0), 0.1)
    corners[0::3, 1:] = corners[0::3, :1]
    corners[1::3, 2] = corners[1::3, 1]
    corners[2::3, 2] = (corners[2::3, 0] + corners[2::3, 1]) / 2
    scene = as_they_are(np.concatenate([corners, backdrop()]))
    return TrialCase(scene, still(scene))


@stress("duplicated", "copies of every triangle", (1, 2, 4, 8, 16, 32))
def duplicated(magnitude: float) -> TrialCase:
    """Every other triangle of the room, `magnitude` times."""
    scene = scene_of(np.concatenate([room()[::2]] * int(magnitude)))
    return TrialCase(scene, walk(scene), atlas=(512, 512))


@stress("coplanar", "triangles that overlap in one plane", (2, 4, 8, 16, 32, 64, 128))
def coplanar(magnitude: float) -> TrialCase:
    """`magnitude` triangles that overlap in the plane z = -2, before a wall."""
    centres = scattered(int(magnitude), 2.0)
    centres[:, 2] = -2
    return seen_from_origin(np.concatenate([facing(centres, 0.5), backdrop()]))


@stress("flipped", "triangles turned round, of single-sided material", (0.01, 0.03, 0.1, 0.3, 0.6, 1), unit="share")
def flipped(magnitude: float) -> TrialCase:
    """The room of single-sided material, a random share of `magnitude` of its triangles turned round."""
    corners = room()
    turned = draws.generator(3).random(len(corners)) < magnitude
    corners[turned] = corners[turned][:, ::-1]
    scene = scene_of(corners, materials=(replace(DOUBLE, double_sided=False),))
    return TrialCase(scene, walk(scene))


@stress("sub-pixel", "triangles smaller than a pixel", (1, 0.3, 0.1, 0.03, 0.01, 0.003, 0.001), unit="pixels")
def sub_pixel(magnitude: float) -> TrialCase:
    """400 triangles with a circumradius of about `magnitude` pixels, before a wall."""
    small = facing(scattered(400, 2.0), 2 * magnitude / PIXELS_PER_TANGENT)
    return seen_from_origin(np.concatenate([small, backdrop()]))


@stress("screen-filling", "a triangle that reaches beyond the screen", powers(0, 6), unit="times the screen")
def screen_filling(magnitude: float) -> TrialCase:
    """A slanted triangle with a circumradius of 4 `magnitude` units, 3 units ahead, behind 50 small ones."""
    large = facing(np.array([[0, 0, -3.0]]), 4 * magnitude)
    large[:, :, 2] -= 0.3 * large[:, :, 1]
    return seen_from_origin(np.concatenate([large, facing(scattered(50, 1.5), 0.1)]))


@stress("fan", "triangles at one vertex", (10, 30, 100, 300, 1000, 3000, 10_000))
def fan(magnitude: float) -> TrialCase:
    """`magnitude` triangles around one vertex, whose rim is wavy."""
    angle = np.linspace(0, 2 * np.pi, int(magnitude) + 1)
    ring = np.stack([cos(angle), sin(angle), -2.5 + 0.2 * cos(5 * angle)], axis=1)
    middle = np.broadcast_to([0.05, 0.02, -2.0], ring[1:].shape)
    return seen_from_origin(np.stack([middle, ring[:-1], ring[1:]], axis=1), atlas=(512, 512))


# What comes together in one place of a method


@stress("one-bin", "triangles of one size", (10, 30, 100, 300, 1000, 3000, 10_000))
def one_bin(magnitude: float) -> TrialCase:
    """`magnitude` triangles of one size beside each other in the plane z = -2."""
    side = int(np.ceil(np.sqrt(magnitude)))
    x, y = np.meshgrid(np.linspace(-1, 1, side), np.linspace(-0.55, 0.55, side))
    centres = np.stack([x, y, np.full_like(x, -2)], axis=-1).reshape(-1, 3)[: int(magnitude)]
    return seen_from_origin(facing(centres, 0.8 / side), atlas=(512, 512))


@stress("one-pixel", "triangles behind each other in one pixel", (1, 3, 10, 30, 100, 300, 1000))
def one_pixel(magnitude: float) -> TrialCase:
    """`magnitude` triangles, each about a pixel large, behind each other from 1 to 3 units away, before a wall."""
    depth = np.linspace(1, 3, int(magnitude))
    centres = np.stack([0.5 / PIXELS_PER_TANGENT * depth, 0.5 / PIXELS_PER_TANGENT * depth, -depth], axis=1)
    return seen_from_origin(np.concatenate([facing(centres, 0.6 * depth / PIXELS_PER_TANGENT), backdrop()]))


@stress("one-patch", "triangles that share one edge", (2, 4, 8, 16, 32, 64, 128, 256))
def one_patch(magnitude: float) -> TrialCase:
    """`magnitude` triangles at one edge, like the pages of a book."""
    angle = np.linspace(0, np.pi, int(magnitude))
    page = np.stack([cos(angle), 0.3 * sin(3 * angle), sin(angle) - 2.5], axis=1)
    hinge = [np.broadcast_to(point, page.shape) for point in ([0, -0.7, -2.6], [0, 0.7, -2.4])]
    return seen_from_origin(np.stack([*hinge, page], axis=1))


@stress("equal-depth", "layers at exactly one depth", (1, 2, 4, 8, 16, 32, 64))
def equal_depth(magnitude: float) -> TrialCase:
    """The same 8 triangles in the plane z = -2, `magnitude` times."""
    return seen_from_origin(np.concatenate([grid((-1, -0.6, -2), (2, 0, 0), (0, 1.2, 0), 2, 2)] * int(magnitude)))


@stress("blend-alpha", "blended surfaces", (1, 0.5, 0.1, 2 / 255, 1 / 255, 0), unit="alpha")
def blend_alpha(magnitude: float) -> TrialCase:
    """The room, every other triangle blended with an alpha of `magnitude`."""
    return _alpha(replace(DOUBLE, base_colour=(0.9, 0.7, 0.5, magnitude), alpha_mode="blend"))


@stress("mask-alpha", "masked surfaces, cut at half of their alpha", (1, 0.5, 0.1, 2 / 255, 1 / 255, 0), unit="alpha")
def mask_alpha(magnitude: float) -> TrialCase:
    """The room, every other triangle masked with an alpha of `magnitude` and a cutoff of half of it."""
    colour = (0.9, 0.7, 0.5, magnitude)
    return _alpha(replace(DOUBLE, base_colour=colour, alpha_mode="mask", alpha_cutoff=magnitude / 2))


def _alpha(material: Material) -> TrialCase:
    """Half of the room's triangles with a material, before the others."""
    scene = scene_of(room(), materials=(DOUBLE, material))
    scene.material_ids = np.where(np.arange(scene.triangle_count) % 2, 1, 0).astype(np.int32)
    scene.features = find_features(scene)
    return TrialCase(scene, walk(scene), exact=False)


# The camera


@stress("near-plane", "corners about, and on, the near plane", (0.1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 0),
        unit="of its distance")  # fmt: skip
def near_plane(magnitude: float) -> TrialCase:
    """30 triangles with a corner or two before, on or behind the near plane, off by `magnitude` times its distance."""
    near, count = 0.02, 30
    turn = np.arange(count) * 2 * np.pi / count
    side = np.stack([cos(turn), 0.5 * sin(turn), np.zeros(count)], axis=1)
    sign = np.arange(count)[:, None] % 3 - 1
    at = side * near * 0.4 - np.array([0, 0, near]) * (1 + sign * magnitude)
    far = side * 1.5 - np.array([0, 0, 3.0])
    next_far = np.roll(far, 1, axis=0)
    mixed = np.stack([at, far, next_far], axis=1)
    mixed[::2, 1] = at[np.roll(np.arange(count), 3)[::2]]
    # The scene's centre of bounds is the eye, so that no rounding of positions hides what is exactly on the plane.
    frame = facing(np.array([[0, 0, -4.0], [0, 0, 4.0]]), 3.0)
    frame = np.concatenate([frame, -frame])
    scene = as_they_are(np.concatenate([mixed, frame]))
    poses = still(scene)
    return TrialCase(scene, poses, ahead=poses, near=near)


@stress("behind", "triangles from far behind the eye to before it", powers(0, 6), unit="units behind")
def behind(magnitude: float) -> TrialCase:
    """A fan of 14 triangles around a vertex 2 units ahead; its rim is a circle of `magnitude` units around the eye."""
    turn = np.arange(14) * 2 * np.pi / 14
    ring = np.stack([cos(turn), np.full(14, -0.2), sin(turn)], axis=1) * [magnitude, 1, magnitude]
    middle = np.broadcast_to([0.1, -0.5, -2.0], ring.shape)
    return seen_from_origin(np.concatenate([np.stack([middle, ring, np.roll(ring, -1, axis=0)], axis=1), backdrop()]))


@stress("wide-view", "ever wider fields of view", (60, 90, 120, 150, 170, 175, 179), unit="degrees")
def wide_view(magnitude: float) -> TrialCase:
    """The room at a horizontal field of view of `magnitude` degrees; the cell's is 20 degrees wider, up to 179."""
    scene = scene_of(room())
    return TrialCase(scene, walk(scene), fov=magnitude, cell=ViewCell(0.08, min(179.0, magnitude + 20)))


@stress("narrow-view", "ever narrower fields of view", (60, 30, 10, 5, 2, 1), unit="degrees")
def narrow_view(magnitude: float) -> TrialCase:
    """The room at a horizontal field of view of `magnitude` degrees; the cell narrows with it."""
    scene = scene_of(room())
    return TrialCase(scene, walk(scene), fov=magnitude, cell=ViewCell(0.08 * magnitude / 60, 1.3 * magnitude))


@stress("motion", "ever smaller steps of the camera, and none", (0.1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 0), unit="units")
def motion(magnitude: float) -> TrialCase:
    """Four frames of the room, between which the camera moves by `magnitude` times (1, 0, 0.5) units."""
    scene = scene_of(room())
    (first,) = walk(scene, 1)
    steps = [np.array([magnitude, 0, magnitude / 2]) * k for k in range(4)]
    return TrialCase(scene, tuple(replace(first, position=first.position + step) for step in steps))


@stress("teleport", "a camera that jumps away and back", powers(-1, 6), unit="units")
def teleport(magnitude: float) -> TrialCase:
    """The room from one place, from `magnitude` units further along z, from the first backwards, and as at first."""
    scene = scene_of(room())
    here, there = walk(scene)
    away = replace(there, position=there.position + magnitude * np.array([0, 0, 1]))
    turned = Pose(here.position, np.array([0, 1.0, 0, 0]))
    return TrialCase(scene, (here, away, turned, here))


# The atlas and the set


@stress("small-atlas", "ever smaller atlases", (256, 128, 64, 48, 32, 16), unit="texels a side")
def small_atlas(magnitude: float) -> TrialCase:
    """The room in an atlas of `magnitude` x `magnitude` texels."""
    scene = scene_of(room())
    return TrialCase(scene, walk(scene), atlas=(int(magnitude), int(magnitude)))


@stress("large-atlas", "ever larger atlases", (256, 512, 1024, 2048, 4096, 8192), unit="texels a side")
def large_atlas(magnitude: float) -> TrialCase:
    """One frame of the room in an atlas of `magnitude` x `magnitude` texels."""
    scene = scene_of(room())
    return TrialCase(scene, walk(scene, 1), atlas=(int(magnitude), int(magnitude)))


@stress("empty-frames", "empty sets between full ones", (1, 2, 3, 5, 8, 13), unit="frames")
def empty_frames(magnitude: float) -> TrialCase:
    """`magnitude` frames of an empty set between two of the whole room, all from one pose."""
    scene = scene_of(room())
    full, none = np.arange(scene.triangle_count, dtype=np.int32), np.zeros(0, np.int32)
    sets = (full, *[none] * int(magnitude), full)
    return TrialCase(scene, walk(scene, 1) * len(sets), sets=sets)


# What is not a number

SHARES = (1e-3, 1e-2, 0.1, 0.3, 0.6, 1.0)


def poisoned(array: Array, share: float) -> Doubles:
    """The array (n, ..., k), of any numbers, as float64 with NaN, infinity or minus infinity, in turn, at 0 of the last
    axis of some rows; one row at least."""
    numbers = np.array(array, np.float64)
    rows = draws.generator(5).permutation(len(numbers))[: max(1, round(share * len(numbers)))]
    numbers[rows, ..., 0] = np.resize([np.nan, np.inf, -np.inf], len(rows)).reshape(-1, *[1] * (numbers.ndim - 2))
    return numbers


def _poisoned_room(poison: Callable[[RawScene], None]) -> TrialCase:
    scene = scene_of(room(), poison=poison)
    return TrialCase(scene, walk(scene))


@stress("nan-positions", "positions that are not numbers", SHARES, unit="share", refusable=True)
def nan_positions(magnitude: float) -> TrialCase:
    """The room with NaN or infinity as x of a share of `magnitude` of its positions."""

    def poison(raw: RawScene) -> None:
        raw.parts[0].positions = poisoned(raw.parts[0].positions, magnitude)

    return _poisoned_room(poison)


@stress("nan-indices", "indices of vertices that are not there", SHARES, unit="share", refusable=True)
def nan_indices(magnitude: float) -> TrialCase:
    """The room with indices of 2^31 - 1 and of -5, each in a third of a share of `magnitude` of its triangles."""

    def poison(raw: RawScene) -> None:
        rows = np.isnan(poisoned(np.zeros((len(raw.parts[0].indices), 1)), magnitude)[:, 0])
        raw.parts[0].indices[rows, 1] = 2**31 - 1
        raw.parts[0].indices[np.roll(rows, 1), 2] = -5

    return _poisoned_room(poison)


@stress("nan-normals", "normals that are not numbers", SHARES, unit="share", refusable=True)
def nan_normals(magnitude: float) -> TrialCase:
    """The room with NaN or infinity as x of a share of `magnitude` of its normals."""

    def poison(raw: RawScene) -> None:
        up = np.tile([0.0, 1.0, 0.0], (len(raw.parts[0].positions), 1))
        raw.parts[0].normals = poisoned(up, magnitude)

    return _poisoned_room(poison)


@stress("nan-uvs", "texture coordinates that are not numbers", SHARES, unit="share", refusable=True)
def nan_uvs(magnitude: float) -> TrialCase:
    """The room with NaN or infinity as u of a share of `magnitude` of its texture coordinates."""

    def poison(raw: RawScene) -> None:
        raw.parts[0].uvs = poisoned(raw.parts[0].positions[:, :2], magnitude)

    return _poisoned_room(poison)


@stress("nan-colours", "vertex colours that are not numbers", SHARES, unit="share", refusable=True)
def nan_colours(magnitude: float) -> TrialCase:
    """The room with NaN or infinity as red of a share of `magnitude` of its vertex colours."""

    def poison(raw: RawScene) -> None:
        if (colours := raw.parts[0].colours) is not None:
            raw.parts[0].colours = poisoned(colours, magnitude).astype(np.float32)

    return _poisoned_room(poison)


@stress("nan-tangents", "tangents that are not numbers", SHARES, unit="share", refusable=True)
def nan_tangents(magnitude: float) -> TrialCase:
    """The room with NaN or infinity as x of a share of `magnitude` of its tangents."""

    def poison(raw: RawScene) -> None:
        tangent = np.tile([1.0, 0.0, 0.0, 1.0], (len(raw.parts[0].positions), 1))
        raw.parts[0].tangents = poisoned(tangent, magnitude)

    return _poisoned_room(poison)


@stress("nan-transforms", "instances whose placement is not a number", SHARES, unit="share", refusable=True)
def nan_transforms(magnitude: float) -> TrialCase:
    """Four instances of the room; a share of `magnitude` has NaN or infinity as first column of its matrix."""

    def poison(raw: RawScene) -> None:
        raw.parts[0].transforms = poisoned(np.tile(np.eye(4), (4, 1, 1)), magnitude)

    return _poisoned_room(poison)


@stress("nan-lights", "lights whose numbers are none", SHARES, unit="share", refusable=True)
def nan_lights(magnitude: float) -> TrialCase:
    """The room with six more lights; a share of `magnitude` has NaN or infinity in colour, position or direction."""

    def poison(raw: RawScene) -> None:
        values = poisoned(np.ones((6, 3)), magnitude)
        raw.lights += [Light("point", _triple(value), (0.0, 1.0, 0.0)) for value in values[:2]]
        raw.lights += [Light("point", (1.0, 1.0, 1.0), _triple(value)) for value in values[2:4]]
        raw.lights += [replace(SUN, direction=_triple(value), shadows=False) for value in values[4:]]

    return _poisoned_room(poison)


@stress("nan-materials", "materials whose numbers are none", SHARES, unit="share", refusable=True)
def nan_materials(magnitude: float) -> TrialCase:
    """The room with NaN or infinity in a share of `magnitude` of its base colour, roughness, metalness and emission."""

    def poison(raw: RawScene) -> None:
        red, rough, metal, glow = poisoned(np.full((4, 1), 0.5), magnitude)[:, 0]
        raw.materials[0] = replace(
            DOUBLE, base_colour=(red, 0.5, 0.5, 1.0), roughness=rough, metallic=metal, emissive=(glow, 0.0, 0.0)
        )

    return _poisoned_room(poison)


@stress("nan-path", "poses of a path that are not numbers", SHARES, unit="share", refusable=True)
def nan_path(magnitude: float) -> TrialCase:
    """Two frames of a path file of 12 poses; a share of `magnitude` has NaN or infinity as x.

    Raises PathError for a file that is refused.
    """
    import tempfile

    scene = scene_of(room())
    poses = poisoned(np.tile([0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 1.0], (12, 1)), magnitude)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "path.txt")
        lines = [f"{16 * k} {' '.join(str(x) for x in pose)}\n" for k, pose in enumerate(poses)]
        file.write_text("".join(lines), encoding="utf-8")
        try:
            path = make_path(scene, str(file), 2, 0)
        except PathError as error:
            raise PathError(str(error).replace(str(file), "The path")) from error
    return TrialCase(scene, tuple(Pose(p, q) for p, q in zip(path.positions[:2], path.orientations[:2], strict=True)))
