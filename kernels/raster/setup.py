"""Triangle set-up: which triangles are worth drawing, snapped to the pixel grid and sorted into tiles."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from kernels.common.scan import exclusive_scan
from kernels.raster.clusters import Clusters
from kernels.raster.picture import Picture

if TYPE_CHECKING:
    from pyopencl.array import Array

    from kernels.device import Device

RECORD = 12  # ints; see record.cl


@dataclass
class Scratch:
    """Memory that set-up keeps from draw to draw, because fresh memory costs as much as writing to it.

    capacity: records per chunk, which grows to what the views need.
    """

    device: Device
    capacity: int
    arrays: dict[str, Array] = field(default_factory=dict)

    def ints(self, name: str, count: int) -> Array:
        """At least `count` int32 whose contents are left from before."""
        if name not in self.arrays or self.arrays[name].size < count:
            self.arrays.pop(name, None)
            self.arrays[name] = self.device.empty(count + count // 4, np.int32)
        return self.arrays[name]


@dataclass(frozen=True)
class Bins:
    """Records (see record.cl) and, for each tile, the list of those whose box touches it.

    entries: record numbers, tile after tile; ends[(tile + 1) * chunks - 1] is where a tile's list ends.
    """

    records: Array
    entries: Array
    ends: Array


def set_up(
    device: Device,
    clusters: Clusters,
    chosen: Array,
    count: int,
    picture: Picture,
    resumes: bool,
    scratch: Scratch,
    stage: str,
) -> Bins:
    """Set up the `count` clusters listed in `chosen`; if the picture `resumes`, leave out what it hides already."""
    chunks, tile, tiles_x, tiles = device.chunks, picture.tile, picture.tiles_x, picture.tiles
    size = (picture.camera.width, picture.camera.height)
    kernels = device.build("raster/setup.cl", CLUSTER=clusters.size, TILE=tile)
    counts, tile_counts = (scratch.ints(name, tiles * chunks) for name in ("counts", "tile counts"))
    written = scratch.ints("written", chunks)
    inputs = (chosen, clusters.groups, clusters.flags, *picture.camera.arguments())
    shape = (*size, tiles_x, tiles, resumes, picture.block_depth)
    while True:
        capacity = scratch.capacity
        records = scratch.ints("records", chunks * capacity * RECORD)
        results = (capacity, records, counts, tile_counts, written)
        device.launch(f"{stage}/setup", kernels.set_up, chunks, chunks, count, *inputs, *shape, *results, local=1)
        offsets, total = exclusive_scan(device, tile_counts, tiles * chunks, f"{stage}/scan")
        most = int(written.get()[:chunks].max())
        if most <= capacity:
            break
        scratch.capacity = most + most // 4
    entries = scratch.ints("entries", total)
    arguments = (chunks, *size, tiles_x, capacity, records, written, offsets, entries)
    device.launch(f"{stage}/bin", kernels.fill_bins, chunks, *arguments, local=1)
    return Bins(records, entries, offsets)
