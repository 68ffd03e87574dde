"""Positions in the atlas: bins on shelves, and in them each item at a position computed from its rank."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.kernels.constants import constants_of
from shading_atlas_bench.packers.tss.kernels.bins import Bins

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic import arrays
    from shading_atlas_bench.arithmetic.arrays import Ints, Longs
    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.packers.tss.kernels.bins import BinTables

HERE = Path(__file__).parent

STAGE = "structs/layout"
DEFINED = constants_of(HERE / "layout.cl")
REGION = DEFINED.whole("REGION")


@dataclass(frozen=True)
class Items:
    """What primitives have to place, two items each, on the device.

    turns: int32 (n), when each primitive is placed. bins: int32 (n, 2), of the items, by turn, -1 for one that is not
    there. ranks: int32 (2 n), of each in its bin, in that order.
    """

    turns: Array
    bins: Array
    ranks: Array


def lay_out(device: Device, bins: BinTables, totals: Array, width: int) -> tuple[Array, int]:
    """Regions of all bins, int32 (B, 6), and how many rows of an atlas `width` texels wide they need.

    totals: int32 (B), items per bin. Rows are -1 if a slot is wider than the atlas. A region
    is: column, row, slots per column and slots of its part of the last shelf; row of its own shelves, slots in each.
    """
    count = len(totals)
    regions, used = device.zeros((count, REGION), np.int32), device.empty(1, np.int32)
    kernel = device.build(HERE / "layout.cl").lay_out
    device.launch(STAGE, kernel, 1, count, width, bins.width, bins.height, totals, regions, used, local=1)
    return regions, int(used.get()[0])


def place_items(device: Device, count: int, height: int, items: Items, bins: BinTables, regions: Array) -> Array:
    """Places int32 (count, 2) of the items of `count` primitives: -1 for none, or one outside the atlas' `height` rows.

    regions: as from `lay_out`. A place is column | row << 15 | turned << 30 of an item's first texel; those of a turned
    one run left and up from there.
    """
    places = device.recycled((count, 2), np.int32)
    listed = (items.turns, items.bins, items.ranks, bins.width, bins.height, regions)
    device.launch(STAGE, device.build(HERE / "layout.cl").place_items, 2 * count, 2 * count, height, *listed, places)
    return places


def lay_out_twin(bins: Bins, totals: Longs, width: int) -> tuple[Longs, int]:
    """The same on the host."""
    regions = np.zeros((bins.count, REGION), np.int64)
    x, y, shelf, fits = width, 0, 0, True
    for b in np.flatnonzero(totals):
        w, h, slots = int(bins.width[b]), int(bins.height[b]), -(-int(totals[b]) // 2)
        stack = shelf // h
        here = min(slots, (width - x) // w * stack) if stack and x + w <= width else 0
        row = width // w
        regions[b] = x, y, stack, here, y + shelf, row
        x += -(-here // max(stack, 1)) * w
        if slots == here:
            continue
        fits &= row > 0
        shelves = -(-(slots - here) // row) if row else 0
        y += shelf + (shelves - 1) * h
        x, shelf = (slots - here - (shelves - 1) * row) * w, h
    return regions, y + shelf if fits else -1


def place_items_twin(
    items: arrays.Array, ranks: Longs, width: Ints, height: Ints, regions: arrays.Array, rows: int
) -> Longs:
    """Places, as from `place_items`, of items, int (n), bins, -1 for none, with ranks int64 (n), in their own order.

    width, height: int32 (B), as in Bins. regions: int (B, 6), as from `lay_out`.
    """
    safe = np.maximum(items, 0)
    region, slot, turned = regions[safe].astype(np.int64), ranks // 2, ranks % 2
    w, h = width[safe], height[safe]
    here = slot < region[:, 3]
    stack, row = np.maximum(region[:, 2], 1), np.maximum(region[:, 5], 1)
    rest = slot - region[:, 3]
    x = np.where(here, region[:, 0] + slot // stack * w, rest % row * w)
    y = np.where(here, region[:, 1] + slot % stack * h, region[:, 4] + rest // row * h)
    lost = (items < 0) | (y + h > rows) | (~here & (region[:, 5] == 0))
    return np.where(lost, -1, pack_place(x + turned * (w - 1), y + turned * (h - 1), turned))


def pack_place(column: Longs, row: Longs, turned: Longs) -> Longs:
    """Places as one number each, int64: column, row and turned (0 or 1) of any shape."""
    places: Longs = column | row << 15 | turned << 30
    return places


def unpack_place(word: arrays.Array) -> tuple[Longs, Longs, Longs]:
    """Column, row, and the direction, 1 or -1, of places from 0 on, int of any shape."""
    place = word.astype(np.int64)
    return place & 0x7FFF, place >> 15 & 0x7FFF, 1 - 2 * (place >> 30 & 1)
