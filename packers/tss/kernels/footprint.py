"""How large triangles appear to the server: the depths that perspective needs, and into how many pieces to cut them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.matrices import matvec
from shading_atlas_bench.kernels.constants import constants_of
from shading_atlas_bench.packers.tss.kernels.bins import LONGEST
from shading_atlas_bench.packers.tss.kernels.pattern import LEVELS

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic import arrays
    from shading_atlas_bench.arithmetic.arrays import Bools, Doubles, Floats, Longs
    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.kernels.triangles import Triangles

HERE = Path(__file__).parent

DEFINED = constants_of(HERE / "footprint.cl")
MOST_PIECES = DEFINED.whole("MOST_PIECES")  # along an edge
LEAST_HEIGHT = DEFINED.whole("LEAST_HEIGHT")  # texels, of a slanted triangle's pieces
CAMERA_FLOATS = 21


def camera_floats(view: Doubles, projection: Doubles, width: int, height: int) -> Floats:
    """What the kernels need to know of a camera, float32 (21); the layout is in camera.cl.

    view, projection: float64 (4, 4), the projection with reversed depth and an infinite far plane.
    """
    turn = view[:3, :3]
    eye = -matvec(turn.T, view[:3, 3])
    high = eye.astype(np.float32)
    tangents = (1 + np.abs(projection[:2, 2])) / np.abs(projection[[0, 1], [0, 1]])
    scale = np.array([projection[0, 0] * width / 2, projection[1, 1] * height / 2])
    last = [*tangents, 1 / np.sqrt(1 + (tangents * tangents).sum()), projection[2, 3]]
    return np.concatenate([high, eye - high, turn[0], turn[1], -turn[2], scale, last]).astype(np.float32)


def measure_triangles(
    device: Device,
    ids: Array,
    count: int,
    triangles: Triangles,
    camera: Array,
    scale: float,
    threshold: float,
    stage: str,
) -> tuple[Array, Array]:
    """Depths and pieces of `count` triangles.

    ids: int32 (count), into `triangles`. camera: float32 (21). scale: texels per pixel. threshold: longest edge over
    height above which a triangle is slanted.
    Returns depths float32 (count, 4): the three corners' distances along the view's axis, or what projects them to
    the view's border if they lie beyond it; and the triangle's height over its longest edge in pixels, negative if it
    leaves the view. And pieces int32 (count): the edges are cut into so many parts that none needs a level above 64 or
    a base over 1023 texels, but into 16 at most, and no slanted piece is to be lower than 16 texels. A triangle that
    leaves the view counts as if all of it were as near as its nearest point may be.
    """
    depths, pieces = device.recycled((count, 4), np.float32), device.recycled(count, np.int32)
    kernel = device.build(HERE / "footprint.cl").measure_triangles
    seen = (count, ids, triangles.indices, triangles.positions, camera, float(scale), float(threshold))
    device.launch(stage, kernel, -(-count // 8), *seen, depths, pieces)
    return depths, pieces


def project_twin(points: arrays.Array, camera: Floats) -> tuple[Doubles, Doubles, Bools]:
    """Screen positions float64 (..., 2) in pixels, depths (...) and whether they are bounded, of points (..., 3).

    camera: float32 (21), see `camera_floats`.
    """
    c = camera.astype(np.float64)
    from_eye = points.astype(np.float64) - c[:3] - c[3:6]
    x, y, depth = (from_eye @ c[k : k + 3] for k in (6, 9, 12))
    beside, above = np.abs(x) / c[17], np.abs(y) / c[18]
    least = np.maximum.reduce([c[19] * np.linalg.norm(from_eye, axis=-1), c[20] + 0 * x, beside, above])
    bounded = np.maximum(depth, least)
    return np.stack([x * c[15] / bounded, y * c[16] / bounded], axis=-1), bounded, depth < 0.9999 * least


def shape_twin(screen: Doubles) -> dict[str, arrays.Array]:
    """level, base, height, foot (float64 (n)) and first (int) of triangles (n, 3, 2) in pixels; see camera.cl."""
    edges = np.roll(screen, -1, axis=1) - screen
    squared = (edges**2).sum(axis=2)
    first = squared.argmax(axis=1)
    row = np.arange(len(screen))
    edge, base = edges[row, first], np.sqrt(squared[row, first])
    to = screen[row, (first + 2) % 3] - screen[row, first]
    twice = np.abs(edge[:, 0] * to[:, 1] - edge[:, 1] * to[:, 0])
    length = np.where(base > 0, base, 1)
    foot = np.where(base > 0, np.clip((edge * to).sum(axis=1) / length**2, 0, 1), 0.5)
    return {"level": np.sqrt(2 / 3 * twice), "base": base, "height": twice / length, "foot": foot, "first": first}


def measure_triangles_twin(corners: Floats, camera: Floats, scale: float, threshold: float) -> tuple[Doubles, Longs]:
    """The same on the host, for corners (n, 3, 3): depths float64 (n, 4), pieces int (n)."""
    screen, depth, bounded = project_twin(corners, camera)
    shape = shape_twin(screen)
    leaves = bounded.any(axis=1)
    nearby, nearby_height = _nearby(corners, camera)
    level = np.where(leaves, np.maximum(shape["level"], nearby), shape["level"])
    wanted = scale * np.maximum(level / LEVELS, shape["base"] / LONGEST)
    most = scale * np.where(leaves, nearby_height, shape["height"]) / LEAST_HEIGHT
    fewer = (shape["base"] > threshold * shape["height"]) & (most < wanted)
    parts = np.where(fewer, np.floor(most), np.ceil(wanted))
    height = np.where(leaves, -1, 1) * shape["height"]
    return np.column_stack([depth, height]), np.clip(parts, 1, MOST_PIECES).astype(int)


def _nearby(corners: Floats, camera: Floats) -> tuple[Doubles, Doubles]:
    """Level and height of triangles if all of them were as near as their nearest points may be."""
    p = corners.astype(np.float64) - camera[:3].astype(np.float64) - camera[3:6]
    normal = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    twice = np.linalg.norm(normal, axis=1)
    plane = np.abs((normal * p[:, 0]).sum(axis=1)) / np.where(twice > 0, twice, 1)
    longest = np.linalg.norm(p - np.roll(p, -1, axis=1), axis=2).max(axis=1)
    reach = np.linalg.norm(p, axis=2).max(axis=1) - longest
    scale = camera[15] / np.maximum(np.maximum(plane, reach), camera[20])
    return np.sqrt(2 / 3 * twice) * scale, twice / np.where(longest > 0, longest, 1) * scale
