"""Triangles to places in the atlas: the strip of their bin, and their rank in it, which is primitive order (3.3)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.kernels.common.rank import rank_by_class

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.packers.snakebinning.kernels.footprint import Footprints
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
        arrays = (device.empty(room, np.int32), device.zeros((room, 2), np.int32), device.zeros(room, np.uint32))
        device.fill(arrays[0], -1)
        return cls(*arrays, device.zeros((room, 4), np.uint16))


def find_new(device: Device, triangles: Array, count: int, rebuilt: int, places: Places, strips: Array) -> Array:
    """Of `count` triangles, int32, those without a valid slot: uint8 (count) on the device.

    rebuilt: frame since which slots count, unless their strip has moved since.
    """
    is_new = device.recycled(count, np.uint8)
    kernel = device.build(HERE / "place.cl").find_new
    known = (triangles, places.placed_at, places.slots, strips)
    device.launch(STAGE, kernel, count, count, rebuilt, *known, is_new)
    return is_new


def place_triangles(
    device: Device,
    frame: int,
    triangles: Array,
    count: int,
    is_new: Array,
    footprints: Footprints,
    targets: Array,
    blocks: Superblocks,
    places: Places,
) -> None:
    """Give those of `count` triangles, int32, that are new (uint8) or in strips that have moved slots, in list order.

    targets: int32 (BINS). No place where the strip has no slot left. A triangle wider than its strip's slots is drawn
    as wide as these.
    """
    kernels = device.build(HERE / "place.cl")
    classes = device.recycled(count, np.int32)
    known = (triangles, is_new, footprints.bins, targets, blocks.strip_of, blocks.strips)
    device.launch(STAGE, kernels.find_strips, count, count, frame, *known, classes)
    ranks, _ = rank_by_class(device, classes, count, blocks.numbers["strips"], STAGE)
    corners = blocks.live_superblocks()
    corners = device.upload(np.stack([corners["x"], corners["y"]], axis=1))
    listed = (count, frame, triangles, classes, ranks, blocks.strips, corners)
    arrays = (footprints.lengths, places.placed_at, places.slots, places.places, places.drawn)
    device.launch(STAGE, kernels.place_triangles, count, *listed, *arrays)


def place_twin(
    rank: np.ndarray, strip: np.ndarray, corner: np.ndarray, lengths: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Places and drawn lengths (n, 3) of triangles with ranks (n) in their parts of strips (STRIP records, n), whose
    superblocks begin at `corner` (n, 2); lengths (n, 3) in 1/8 texel."""
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


def parts_twin(strips: np.ndarray, number: np.ndarray, rank: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Parts of the strips `number` (n) that ranks (n) lie in, -1 beyond their slots, and ranks in these."""
    number, rank = number.copy(), rank.copy()
    for i in range(len(number)):
        while number[i] >= 0:
            part = strips[number[i]]
            room = part["rows"] * part["per_row"] if part["superblock"] >= 0 else 0
            if rank[i] < room:
                break
            number[i], rank[i] = part["more"], rank[i] - room
    return number, rank


def list_records(
    device: Device, triangles: Array, count: int, places: Places, footprints: Footprints, strips: Array
) -> tuple[np.ndarray, np.ndarray]:
    """What a client needs of `count` triangles, int32, and what their mapping did, on the host.

    records: uint32 (count, 4): place, before | after << 16, height, and the word of weights and roles; zeros for one
    without a place. cuts: float32 (count), texels by which the lengths of a triangle in another bin's strip differ from
    its own, -1 in its own bin's.
    """
    records, cuts = device.recycled((max(1, count), 4), np.uint32), device.recycled(count, np.float32)
    kernel = device.build(HERE / "place.cl").list_records
    arrays = (triangles, places.places, places.drawn, footprints.words, footprints.bins, footprints.lengths)
    device.launch("structs/records", kernel, count, count, *arrays, places.slots, strips, records, cuts)
    return records.get()[:count], cuts.get()[:count]
