"""A small room to pack: bumpy walls of quads, loose triangles and slivers, seen from inside, and frames of it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from shading_atlas_bench.harness.workload.pvs import potentially_visible
from shading_atlas_bench.harness.workload.upload import upload_scene
from shading_atlas_bench.harness.workload.views import CellFrustum, Pose, ViewCell, client_view
from shading_atlas_bench.kernels.device import Device
from shading_atlas_bench.packers.interface import Frame, ServerScene, View
from shading_atlas_bench.scenes.model import Light, Material, Scene

NEAR = 0.02
FOV = 60.0
SIZE = (320, 180)
CELL = ViewCell(0.08, 80)


def wall(origin, across, down, columns: int, rows: int, bump: float) -> tuple[np.ndarray, np.ndarray]:
    """A parallelogram of columns x rows quads, its inner vertices moved along the normal by up to `bump`."""
    v, u = np.meshgrid(np.linspace(0, 1, rows + 1), np.linspace(0, 1, columns + 1), indexing="ij")
    normal = np.cross(down, across) / np.linalg.norm(np.cross(down, across))
    height = bump * np.sin(7 * u + 3 * v) * np.sin(np.pi * u) * np.sin(np.pi * v)
    positions = np.asarray(origin) + u[..., None] * across + v[..., None] * down + height[..., None] * normal
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).reshape(-1, 1)
    quads = corner + np.array([[0, columns + 1, 1, 1, columns + 1, columns + 2]])
    return positions.reshape(-1, 3), quads.reshape(-1, 3)


def room(seed: int = 0, quads: int = 10) -> Scene:
    """About 12 quads^2 triangles: 6 x 3 x 6 units around the origin."""
    rng = np.random.default_rng(seed)
    x, y, z = np.array([6.0, 0, 0]), np.array([0, 3.0, 0]), np.array([0, 0, 6.0])
    low = -(x + y + z) / 2
    parts = [
        wall(low, x, z, 1, 1, 0),
        wall(low + y, z, x, quads, quads, 0.2),
        wall(low + y, x, -y, quads, 2 * quads, 0.1),
        wall(low + z, -z, y, 2 * quads, quads, 0.1),
        wall(low + x, z, y, quads, 2, 0),
    ]
    centres = rng.uniform(-1, 1, (quads * quads, 1, 3)) * [2.5, 1.2, 1] + [0, 0, -2]
    loose = centres + rng.normal(size=(len(centres), 3, 3)) * rng.choice([0.02, 0.2], (len(centres), 1, 1))
    loose[::5, 2] = loose[::5, 1] + 0.01 * loose[::5, 2]
    parts.append((loose.reshape(-1, 3), np.arange(3 * len(loose)).reshape(-1, 3)))
    starts = np.cumsum([0, *(len(p) for p, _ in parts[:-1])])
    positions = np.concatenate([p for p, _ in parts]).astype(np.float32)
    indices = np.concatenate([i + k for (_, i), k in zip(parts, starts, strict=True)]).astype(np.int32)
    colours = np.ones((len(positions), 4), np.float32)
    colours[:, :3] = 0.5 + 0.4 * np.sin(3 * positions)
    normals = np.tile(np.array([0, 1, 0], np.float32), (len(positions), 1))
    uvs, ids = positions[:, :2].copy(), np.zeros(len(indices), np.int32)
    scene = Scene("room", positions, indices, normals, uvs, colours, ids, [Material(double_sided=True)])
    scene.lights = [Light("point", (3.0, 3.0, 3.0), (0.0, 1.0, 0.0))]
    scene.content_hash = f"room-{seed}-{quads}"
    return scene


def server_of(device: Device, scene: Scene) -> ServerScene:
    return upload_scene(device, scene)


def pose_at(step: float) -> Pose:
    """A walk that turns: 3 cm and 2 degrees per step."""
    half = np.radians(2 * step) / 2
    return Pose(np.array([0.03 * step, 0, 2 - 0.01 * step]), np.array([0, np.sin(half), 0, np.cos(half)]))


def frame_of(scene: ServerScene, width: int, height: int, step: float = 0, pvs: np.ndarray | None = None) -> Frame:
    """Frame `step` of a walk; its set is that of the view cell, or `pvs`."""
    frustum = CellFrustum.around(CELL, FOV, *SIZE)
    if pvs is None:
        pvs = potentially_visible(scene, pose_at(step), CELL.radius, frustum, NEAR, 2.0).ids
    server = frustum.server_view(pose_at(step), NEAR)
    uploaded = scene.device.upload(pvs)
    return Frame(int(step), scene, server, CELL.radius, CELL.fov, pvs, uploaded, (), width, height)


def changing_sets(rng: np.random.Generator, count: int, kinds: list[str], share: float) -> Iterator[np.ndarray]:
    """Sets of triangles, int32, each changed from the one before as a kind says, in random order: by a "little", a
    share of all triangles; to "all" others; to "none"; to "one"."""
    chosen = rng.random(count) < 0.4
    for kind in rng.permutation(kinds):
        match kind:
            case "little":
                chosen = chosen ^ (rng.random(count) < share)
            case "all":
                chosen = ~chosen
            case "none":
                chosen = np.zeros(count, bool)
            case "one":
                chosen = np.arange(count) == rng.integers(count)
        yield np.flatnonzero(chosen).astype(np.int32)


def novel_view(step: int = 0) -> View:
    return client_view(pose_at(step + 0.5), FOV, *SIZE, NEAR)
