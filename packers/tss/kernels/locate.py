"""From a point on a triangle to its position in the atlas."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.kernels.constants import constants_of
from shading_atlas_bench.kernels.samples import WIDTH, Samples
from shading_atlas_bench.packers.tss.kernels.layout import unpack_place
from shading_atlas_bench.packers.tss.kernels.pattern import locate_in_l_twin
from shading_atlas_bench.packers.tss.kernels.perspective import to_screen

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic import arrays
    from shading_atlas_bench.arithmetic.arrays import Bools, Doubles, Floats, Ints, Longs
    from shading_atlas_bench.kernels.device import Device

HERE = Path(__file__).parent

DEFINED = constants_of(HERE / "locate.cl")
UNPLACED = DEFINED.whole("UNPLACED")


@dataclass(frozen=True)
class Located:
    """Where primitives lie, on the device.

    inverse: float32 (n, 4), as from `invert_depths`; pieces, starts: int32 (n), parts along an edge and first primitive
    of each triangle. records: int32 (m, 4), of each primitive: an L has its level (0: a single texel) and its place;
    right triangles have -1 - the corner where the longest edge begins, two places, and texels before | after the foot
    << 10 | height << 20; UNPLACED primitives have no place.
    """

    inverse: Array
    pieces: Array
    starts: Array
    records: Array


def locate(device: Device, samples: Samples, located: Located, stage: str) -> Array:
    """float32 (2, room): column and row of each sample's surface point, where texel (0, 0) has its centre at (0, 0);
    NaN without a place."""
    room = -(-samples.count // WIDTH) * WIDTH
    places = device.recycled((2, room), np.float32)
    if samples.count:
        points = (samples.count, room, samples.triangle, samples.bary1, samples.bary2)
        tables = (located.inverse, located.pieces, located.starts, located.records)
        kernel = device.build(HERE / "locate.cl").locate
        device.launch(stage, kernel, -(-samples.count // 8), *points, *tables, places)
    return places


def locate_twin(bary: Floats, inverse: Floats, pieces: Ints, starts: Ints, records: Ints) -> Doubles:
    """The same, float64 (n, 2).

    bary: (n, 2). inverse (n, 3), pieces (n), starts (n): of each point's triangle. records: (m, 4), of all primitives.
    """
    piece, local = find_piece_twin(to_screen(bary.astype(np.float64), inverse.astype(np.float64)), pieces)
    record = records[starts + piece].astype(np.int64)
    halves, placed = record[:, 0] < 0, record[:, 0] != UNPLACED
    in_l = locate_in_l_twin(local, np.maximum(record[:, 0], 0))
    in_half, second = _locate_in_half(local, record)
    offset = np.where(halves[:, None], in_half, in_l)
    column, row, sign = unpack_place(np.where(halves & second, record[:, 2], record[:, 1]))
    place = np.stack([column, row], axis=1) + sign[:, None] * offset
    return np.where(placed[:, None], place, np.nan)


def find_piece_twin(screen: Doubles, pieces: arrays.Array) -> tuple[Longs, Doubles]:
    """Number of the piece that holds each point, int (n), and its weights there (n, 2).

    screen: (n, 2), weights on the screen of corners 1 and 2. pieces: int (n), along an edge.
    """
    scaled = screen * pieces[:, None]
    row = np.clip(scaled[:, 1].astype(int), 0, pieces - 1)
    column = np.clip(scaled[:, 0].astype(int), 0, pieces - 1 - row)
    inside = scaled - np.stack([column, row], axis=1)
    turned = (inside.sum(axis=1) > 1) & (column + row < pieces - 1)
    number = pieces**2 - (pieces - row) ** 2 + 2 * column + turned
    return number, np.where(turned[:, None], 1 - inside, inside)


def _locate_in_half(local: Doubles, record: Longs) -> tuple[Doubles, Bools]:
    """Offsets (n, 2) in a right triangle, and whether it is the second; meaningless where the record is of an L."""
    weights = np.column_stack([1 - local.sum(axis=1), local])
    first = np.clip(-1 - record[:, 0], 0, 2)
    row = np.arange(len(local))
    end, apex = weights[row, (first + 1) % 3], weights[row, (first + 2) % 3]
    before, after, height = record[:, 3] & 1023, record[:, 3] >> 10 & 1023, record[:, 3] >> 20 & 1023
    along, up = end * (before + after) + apex * before - before, apex * height
    second = ((along >= 0) & (after > 0)) | (before == 0)
    wide = np.where(second, after, before) > height
    across = np.abs(along)
    return np.stack([np.where(wide, across, up), np.where(wide, up, across)], axis=1), second
