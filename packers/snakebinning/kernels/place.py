"""Triangles to places in the atlas: the strip of their bin, and their rank in it, which is primitive order (3.3)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from shading_atlas_bench.kernels.common.rank import rank_by_class

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic import arrays
    from shading_atlas_bench.arithmetic.arrays import Floats, Words
    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.packers.snakebinning.kernels.footprint import Footprints
    from shading_atlas_bench.packers.snakebinning.kernels.pieces import TriangleList
    from shading_atlas_bench.packers.snakebinning.kernels.superblocks import Superblocks

HERE = Path(__file__).parent

STAGE = "structs/place"


@dataclass(frozen=True)
class Places:
    """Per triangle of the scene, on the device, kept from frame to frame.

    placed_at: int32 (T), frame in which it got its slot, -1 for never. slots: int32 (T, 2), part of a strip and rank in
    it. places: uint32 (T), 0 for none, else column of the tip in 1/8 texel from the centre of the first, line of the
    longest edge << 16, turned << 29, 1 << 31. drawn: uint16 (T, 4), lengths in 1/8 texel as they are in the atlas:
    before and after the foot of the height, and the height.
    """

    placed_at: Array
    slots: Array
    places: Array
    drawn: Array

    @classmethod
    def allocate(cls, device: Device, count: int) -> Places:
        """For a scene of `count` triangles without places."""
        room = max(1, count)
        placed_at, slots = device.empty(room, np.int32), device.zeros((room, 2), np.int32)
        places = device.zeros(room, np.uint32)
        device.fill(placed_at, -1)
        return cls(placed_at, slots, places, device.zeros((room, 4), np.uint16))


@dataclass(frozen=True)
class Placement:
    """Where triangles lie in the atlas: their shapes and bins, the strips of bins, and places in these."""

    footprints: Footprints
    superblocks: Superblocks
    places: Places


def find_new(device: Device, listed: TriangleList, made_at: int, placement: Placement) -> Array:
    """Of the triangles listed, those without a valid slot: uint8 (n) on the device.

    made_at: frame since which slots count, unless their strip has moved since.
    """
    count, places = listed.count, placement.places
    is_new = device.recycled(count, np.uint8)
    kernel = device.build(HERE / "place.cl").find_new
    slots = (places.placed_at, places.slots, placement.superblocks.strips)
    device.launch(STAGE, kernel, count, count, made_at, listed.ids, *slots, is_new)
    return is_new


def place_triangles(
    device: Device, frame: int, listed: TriangleList, is_new: Array, targets: Array, placement: Placement
) -> None:
    """Give those of the triangles listed that are new or in strips that have moved slots, in list order.

    is_new: uint8 (n), as from `find_new`. targets: int32 (BINS). No place where the strip has no slot left. A triangle
    wider than its strip's slots is drawn as wide as these.
    """
    kernels, count = device.build(HERE / "place.cl"), listed.count
    footprints, blocks, places = placement.footprints, placement.superblocks, placement.places
    classes = device.recycled(count, np.int32)
    strips = (footprints.bins, targets, blocks.strip_of, blocks.strips)
    device.launch(STAGE, kernels.find_strips, count, count, frame, listed.ids, is_new, *strips, classes)
    ranks, _ = rank_by_class(device, classes, count, blocks.numbers["strips"], STAGE)
    live = blocks.live_superblocks()
    corners = device.upload(np.stack([live["x"], live["y"]], axis=1))
    ranked = (count, frame, listed.ids, classes, ranks, blocks.strips, corners, footprints.lengths)
    written = (places.placed_at, places.slots, places.places, places.drawn)
    device.launch(STAGE, kernels.place_triangles, count, *ranked, *written)


def place_twin(
    rank: arrays.Array, strip: NDArray[np.void], corner: arrays.Array, lengths: arrays.Array
) -> tuple[arrays.Array, arrays.Array]:
    """Places, int (n), and drawn lengths, int (n, 3), of triangles with ranks, int (n), in their parts of strips, STRIP
    records (n), whose superblocks begin at `corner`, int (n, 2); lengths, int (n, 3), in 1/8 texel."""
    row, column = np.divmod(rank, np.maximum(strip["per_row"], 1))
    turned = column % 2
    x = corner[:, 0] + column // 2 * strip["period"]
    y = corner[:, 1] + strip["y"] + row * strip["lines"]
    foot = 8 * strip["inset"] + strip["before8"]
    tip = 8 * x + np.where(turned, 8 * strip["odd"] - foot, foot)
    line = y + turned * (strip["lines"] - 1)
    largest = np.stack([strip["before8"], strip["after8"], strip["height8"]], axis=1)
    drawn = np.minimum(lengths, largest)
    for side in (1, 0):
        short = np.maximum(8 - drawn[:, 0] - drawn[:, 1], 0)
        drawn[:, side] += np.minimum(short, largest[:, side] - drawn[:, side])
    places = tip | line << 16 | turned << 29 | 1 << 31
    return np.where(strip["superblock"] < 0, 0, places), drawn


def parts_twin(strips: NDArray[np.void], number: arrays.Array, rank: arrays.Array) -> tuple[arrays.Array, arrays.Array]:
    """Parts, int (n), of the strips `number` that ranks, int (n), lie in, -1 beyond their slots, and ranks in these."""
    number, rank = number.copy(), rank.copy()
    for i in range(len(number)):
        while number[i] >= 0:
            part = strips[number[i]]
            room = part["rows"] * part["per_row"] if part["superblock"] >= 0 else 0
            if rank[i] < room:
                break
            number[i], rank[i] = part["more"], rank[i] - room
    return number, rank


def list_records(device: Device, listed: TriangleList, placement: Placement) -> tuple[Words, Floats]:
    """What a client needs of the triangles listed, and what their mapping did, on the host.

    records: uint32 (n, 4): place, before | after << 16, height, and the word of weights and roles; zeros for one
    without a place. cuts: float32 (n), texels by which the lengths of a triangle in another bin's strip differ from
    its own, -1 in its own bin's.
    """
    count, footprints, places = listed.count, placement.footprints, placement.places
    records, cuts = device.recycled((max(1, count), 4), np.uint32), device.recycled(count, np.float32)
    kernel = device.build(HERE / "place.cl").list_records
    shapes = (places.drawn, footprints.words, footprints.bins, footprints.lengths)
    slots = (places.slots, placement.superblocks.strips)
    device.launch("structs/records", kernel, count, count, listed.ids, places.places, *shapes, *slots, records, cuts)
    return records.get()[:count], cuts.get()[:count]
