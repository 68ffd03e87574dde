"""Triangle set-up: which triangles are worth drawing, snapped to the pixel grid and sorted into tiles."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Doubles, Floats, Ints, Longs
from shading_atlas_bench.kernels.constants import constants_of
from shading_atlas_bench.kernels.raster.camera import SUBPIXELS, Camera
from shading_atlas_bench.kernels.raster.clusters import Chosen, Clusters
from shading_atlas_bench.kernels.raster.coverage import covers_twin
from shading_atlas_bench.kernels.raster.render_target import RenderTarget
from shading_atlas_bench.kernels.triangles import Triangles

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device

DEFINED = constants_of(Path(__file__).with_name("record.cl"))
RECORD = DEFINED.whole("RECORD")  # ints
MASK_BIT = DEFINED.whole("MASK_BIT")
# Sub-pixels from the image's centre, beyond which triangles are clipped.
GUARD = constants_of(Path(__file__).with_name("camera.cl")).whole("GUARD")
# Inside where >= 0 of (x, y, z, w): the near plane, then the guard band's right, left, bottom and top.
CLIPPING_PLANES = np.array([[0, 0, -1, 1], [-1, 0, 0, GUARD], [1, 0, 0, GUARD], [0, -1, 0, GUARD], [0, 1, 0, GUARD]])


@dataclass
class Scratch:
    """Memory that set-up keeps from draw to draw, because fresh memory costs as much as writing to it.

    records, entries: how many each chunk has room for; they grow to what the views need. arrays: int32 (n), by name.
    """

    device: Device
    records: int
    entries: int
    arrays: dict[str, Array] = field(default_factory=dict)

    def ints(self, name: str, count: int) -> Array:
        """int32 (count) or longer, whose contents are left from before."""
        if name not in self.arrays or self.arrays[name].size < count:
            self.arrays.pop(name, None)
            self.arrays[name] = self.device.empty(count + count // 4, np.int32)
        return self.arrays[name]

    def fits(self, *needed: Array) -> bool:
        """Wait for set-ups to say what they `needed`, see Bins; where there was not room for all, make it, to set up
        again."""
        records, entries = np.max([array.get() for array in needed], axis=(0, 1)).tolist()
        fits = bool(records <= self.records and entries <= self.entries)
        if records > self.records:
            self.records = records + records // 4
        if entries > self.entries:
            self.entries = entries + entries // 4
        return fits


@dataclass(frozen=True)
class Bins:
    """Records (see record.cl) and, for each tile, the numbers of those whose box touches it, in triangle order.

    They are entries[bins[tile, chunk, 0]] to entries[bins[tile, chunk, 1]] of each chunk in turn.
    records, entries: int32, each chunk's from where its room in Scratch begins. bins: int32 (tiles, chunks, 2).
    needed: int32 (chunks, 2), how many records and entries each chunk had; if any is beyond its room, bins are missing.
    """

    records: Array
    entries: Array
    bins: Array
    needed: Array


def set_up(
    device: Device,
    clusters: Clusters,
    chosen: Chosen,
    picture: RenderTarget,
    resumes: bool,
    scratch: Scratch,
    stage: str,
) -> Bins:
    """Set up the `chosen` clusters; if the picture `resumes`, leave out what it hides already.

    Waits for nothing: ask `Scratch.fits` afterwards. The bins last until the scratch memory is used again.
    """
    chunks, tile, tiles_x, tiles = device.chunks, picture.tile, picture.tiles_x, picture.tiles
    size = (picture.camera.width, picture.camera.height)
    kernels = device.build("raster/setup.cl", CLUSTER=clusters.size, TILE=tile)
    counts, bins = scratch.ints("counts", tiles * chunks), scratch.ints("bins", 2 * tiles * chunks)
    records = scratch.ints("records", chunks * scratch.records * RECORD)
    entries = scratch.ints("entries", chunks * scratch.entries)
    needed = device.recycled((chunks, 2), np.int32)
    inputs = (clusters.count, chosen.listed, chosen.counts, clusters.groups, clusters.flags)
    shape = (*picture.camera.arguments(), *size, tiles_x, tiles, resumes, picture.block_depth)
    results = (scratch.records, scratch.entries, records, entries, counts, bins, needed)
    device.launch(f"{stage}/setup", kernels.set_up, chunks, chunks, *inputs, *shape, *results, local=1)
    return Bins(records, entries, bins, needed)


def set_up_twin(triangles: Triangles, camera: Camera) -> Ints:
    """The records, int32 (n, RECORD) as in record.cl, of all triangles in order, as `set_up` without an earlier pass.

    In float64, so corners may lie a sub-pixel from the kernel's, and triangles that this makes face away, or miss the
    last sample in their box, may be in one result only.
    """
    corners = camera.project(triangles.host_positions[triangles.host_indices])
    middle = np.array([camera.width, camera.height]) * (SUBPIXELS // 2)
    records = []
    for number, (polygon, flags) in enumerate(zip(corners, triangles.host_flags, strict=True)):
        whole = bool((polygon @ CLIPPING_PLANES.T >= 0).all())
        if not whole and (polygon[:, 2] <= 0).all():
            continue
        polygon = polygon if whole else clip_twin(polygon)
        snapped = (np.rint(polygon[:, :2] / polygon[:, 3:]) + middle).astype(np.int64)
        depths = (polygon[:, 2] / polygon[:, 3]).astype(np.float32)
        for i in range(2, len(polygon)):
            fan = [0, i - 1, i]
            records += record_twin(snapped[fan], depths[fan], number, int(flags), camera, whole)
    return np.array(records, np.int32).reshape(-1, RECORD)


def clip_twin(polygon: Doubles) -> Doubles:
    """The part of a convex polygon (n, 4) in front of the near plane and in the guard band (Sutherland-Hodgman)."""
    for plane in CLIPPING_PLANES:
        kept, inside = [], polygon @ plane
        for i, j in zip(range(len(polygon)), np.roll(range(len(polygon)), -1), strict=True):
            if inside[i] >= 0:
                kept.append(polygon[i])
            if (inside[i] >= 0) != (inside[j] >= 0):
                kept.append(polygon[i] + (polygon[j] - polygon[i]) * (inside[i] / (inside[i] - inside[j])))
        polygon = np.array(kept).reshape(-1, 4)
    return polygon


def record_twin(
    corners: Longs, depths: Floats, number: int, flags: int, camera: Camera, whole: bool
) -> list[list[int]]:
    """The record of a triangle or a piece of one, int64 (3, 2) and float32 (3), or none where there is nothing to draw:
    it faces away, its box holds no pixel's centre, or it is `whole` and covers none of the up to 2 x 2 in its box."""
    (ab, ac) = corners[1:] - corners[0]
    area = ab[0] * ac[1] - ab[1] * ac[0]
    if area == 0 or (area > 0 and not flags & Triangles.DOUBLE_SIDED):
        return []
    if area < 0:
        corners, depths = corners[[0, 2, 1]], depths[[0, 2, 1]]
    last = np.array([camera.width, camera.height]) - 1
    left, top = np.maximum((corners.min(axis=0) + SUBPIXELS // 2 - 1) // SUBPIXELS, 0)
    right, bottom = np.minimum((corners.max(axis=0) - SUBPIXELS // 2) // SUBPIXELS, last)
    if left > right or top > bottom:
        return []
    small = whole and (np.ptp(corners, axis=0) < 1 << 14).all() and max(right - left, bottom - top) < 2
    if small and not covers_twin(corners, np.array([left, right]), np.array([[top], [bottom]])).any():
        return []
    identity = number | (MASK_BIT if flags & Triangles.MASKED else 0)
    return [[*corners.ravel(), *depths.view(np.int32), identity, left | top << 16, right | bottom << 16]]
