"""The primitives of a frame: the triangles of the set, those that are too large cut into pieces."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.kernels.common.scan import exclusive_scan
from shading_atlas_bench.packers.tss.kernels.footprint import measure_triangles, project_twin, shape_twin
from shading_atlas_bench.packers.tss.kernels.perspective import to_object

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic import arrays
    from shading_atlas_bench.arithmetic.arrays import Doubles, Floats, Longs
    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.kernels.triangles import Triangles

HERE = Path(__file__).parent

STAGE = "structs/primitives"


@dataclass(frozen=True)
class Primitives:
    """On the device. A triangle is given by its row: its place in `ids`.

    count: of primitives, in the order of their triangles. ids: int32 (rows). depths, pieces: as from
    `measure_triangles`. starts: int32 (rows), each triangle's first primitive. parents: int32 (count), rows.
    shapes: float32 (count, 4), level, base, height and foot in pixels. firsts: int32 (count), the corner where the
    longest edge begins; see camera.cl.
    """

    count: int
    rows: int
    ids: Array
    depths: Array
    pieces: Array
    starts: Array
    parents: Array
    shapes: Array
    firsts: Array


def list_primitives(
    device: Device, ids: Array, rows: int, triangles: Triangles, camera: Array, scale: float, threshold: float
) -> Primitives:
    """The primitives of the first `rows` triangles of `ids`, int32.

    camera: float32 (21), see `camera_floats`. scale, threshold: see `measure_triangles`.
    """
    kernels = device.build(HERE / "primitives.cl")
    depths, pieces = measure_triangles(device, ids, rows, triangles, camera, scale, threshold, "structs/footprint")
    numbers = device.recycled(rows, np.int32)
    device.launch(STAGE, kernels.count_pieces, rows, rows, pieces, numbers)
    starts, count = exclusive_scan(device, numbers, rows, STAGE)
    parents, firsts = device.recycled(count, np.int32), device.recycled(count, np.int32)
    shapes = device.recycled((count, 4), np.float32)
    device.launch(STAGE, kernels.list_pieces, rows, rows, numbers, starts, parents)
    known = (parents, starts, pieces, depths, ids, triangles.indices, triangles.positions, camera)
    device.launch(STAGE, kernels.measure_primitives, -(-count // 8), count, *known, shapes, firsts)
    return Primitives(count, rows, ids, depths, pieces, starts, parents, shapes, firsts)


def piece_corners(pieces: Longs, index: Longs) -> Doubles:
    """Screen weights, float64 (n, 3, 2), of the triangle's corners 1 and 2 at the corners of its piece `index` (n).

    pieces: int (n), along an edge. Pieces are numbered in rows towards corner 2, upright and turned ones in turn.
    """
    left = pieces * pieces - index
    row = pieces - np.ceil(np.sqrt(left)).astype(int)
    inside = (pieces - row) * (pieces - row) - left
    column, turned = inside // 2, inside % 2
    origin = np.stack([column + turned, row + turned], axis=1) / pieces[:, None]
    step = ((1 - 2 * turned) / pieces)[:, None, None]
    corners: Doubles = origin[:, None] + step * np.array([[0, 0], [1, 0], [0, 1]])
    return corners


def measure_primitives_twin(
    corners: Floats, pieces: Longs, index: Longs, inverse: Doubles, camera: Floats
) -> dict[str, arrays.Array]:
    """Shapes by name (see `shape_twin`) of pieces of triangles.

    corners: (n, 3, 3), each triangle's. pieces, index: int (n), parts along an edge and the piece's number.
    inverse: (n, 3), as from `invert_depths_twin` at scale 1. camera: float32 (21).
    """
    at = piece_corners(pieces, index)
    weights = np.stack([to_object(at[:, k], inverse) for k in range(3)], axis=1)
    full = np.concatenate([1 - weights.sum(axis=2, keepdims=True), weights], axis=2)
    return shape_twin(project_twin(full @ corners.astype(np.float64), camera)[0])
