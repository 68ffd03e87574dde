"""The tiled rasteriser: which triangle is nearest at each pixel, and at which depth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from kernels.common.scan import exclusive_scan
from kernels.raster.camera import Camera
from kernels.raster.clusters import CLUSTER, Clusters
from kernels.triangles import Triangles

if TYPE_CHECKING:
    from pyopencl.array import Array

    from kernels.device import Device

TILE = 64  # pixels; a multiple of 8. Any other gives the same picture.
RECORD_BYTES = 48


@dataclass(frozen=True)
class Visibility:
    """What is nearest at each pixel, on the device, image row 0 on top.

    triangle: int32 (height, width), -1 where there is nothing. depth: float32 (height, width), near / distance for a
    perspective view, 1 at the near and 0 at the far end for an orthographic one, 0 where there is nothing.
    """

    width: int
    height: int
    triangle: Array
    depth: Array


class Rasteriser:
    """Draws one set of triangles from any camera.

    Front faces are counter-clockwise as seen; back faces are drawn only with Triangles.DOUBLE_SIDED. Corners are
    snapped to 1/256 pixel once; from there coverage is exact: a pixel belongs to a triangle if its centre lies inside,
    or on a top or left edge. Of equal depths the lowest triangle wins. `cluster` (triangles) and `tile` (pixels) change
    the speed only. Raises ValueError where a triangle has a corner that is not finite.
    """

    def __init__(
        self, device: Device, triangles: Triangles, mask: None = None, *, cluster: int = CLUSTER, tile: int = TILE
    ) -> None:
        self.device = device
        self.triangles = triangles
        self.tile = tile
        self.clusters = Clusters.build(device, triangles, cluster)
        # Records per chunk: all of a small scene's triangles; a large scene starts small and grows to what views need.
        self._capacity = max(256, min(2 * -(-triangles.count // device.chunks), 8192))

    def in_frustum(self, view: np.ndarray, projection: np.ndarray) -> tuple[Array, int]:
        """The clusters of consecutive triangles that may have a part in the frustum: int32 (n) ascending, and n."""
        return self.clusters.in_frustum(self.device, Camera.of(view, projection, 1, 1))

    def draw(
        self, view: np.ndarray, projection: np.ndarray, width: int, height: int, stage: str = "raster"
    ) -> Visibility:
        """Draw from a camera: view and projection float64 (4, 4), sizes in pixels, up to 8192.

        The projection has reversed depth: clip z = near and clip w = distance, or an orthographic one from 1 at the
        near to 0 at the far end. Raises ValueError for other sizes and for matrices that are not finite.
        """
        camera = Camera.of(view, projection, width, height)
        device, tile = self.device, self.tile
        triangle, depth = (device.empty((height, width), dtype) for dtype in (np.int32, np.float32))
        visibility = Visibility(width, height, triangle, depth)
        chosen, count = self.clusters.in_frustum(device, camera, f"{stage}/cull") if self.triangles.count else (None, 0)
        if count == 0:
            device.fill(triangle, -1, f"{stage}/draw")
            device.fill(depth, 0, f"{stage}/draw")
            return visibility
        records, written, offsets, total = self._set_up(camera, chosen, count, stage)
        entries = device.empty(total, np.int32)
        tiles_x, tiles = -(-width // tile), -(-width // tile) * -(-height // tile)
        kernels = device.build("raster/setup.cl", CLUSTER=self.clusters.size, TILE=tile)
        size = (width, height, tiles_x, self._capacity)
        arguments = (device.chunks, *size, records, written, offsets, entries)
        device.launch(f"{stage}/bin", kernels.fill_bins, device.chunks, *arguments, local=1)
        kernels = device.build("raster/tiles.cl", TILE=tile)
        arguments = (tiles, tiles_x, width, height, device.chunks, total, offsets, entries, records, triangle, depth)
        device.launch(f"{stage}/draw", kernels.draw_tiles, tiles, *arguments, local=1)
        return visibility

    def _set_up(self, camera: Camera, chosen: Array, count: int, stage: str) -> tuple[Array, Array, Array, int]:
        """Records of the chosen clusters, records per chunk, where each tile's part of a chunk begins, and the sum."""
        device, chunks = self.device, self.device.chunks
        width, height = camera.width, camera.height
        tiles_x, tiles = -(-width // self.tile), -(-width // self.tile) * -(-height // self.tile)
        kernel: Any = device.build("raster/setup.cl", CLUSTER=self.clusters.size, TILE=self.tile).set_up
        counts, tile_counts = device.empty(tiles * chunks, np.int32), device.empty(tiles * chunks, np.int32)
        written = device.empty(chunks, np.int32)
        inputs = (chosen, self.clusters.groups, self.clusters.flags, *camera.arguments())
        while True:
            records = device.empty((chunks * self._capacity, RECORD_BYTES // 4), np.int32)
            arguments = (width, height, tiles_x, tiles, self._capacity, records, counts, tile_counts, written)
            device.launch(f"{stage}/setup", kernel, chunks, chunks, count, *inputs, *arguments, local=1)
            offsets, total = exclusive_scan(device, tile_counts, tiles * chunks, f"{stage}/scan")
            most = int(written.get().max())
            if most <= self._capacity:
                return records, written, offsets, total
            self._capacity = most + most // 4
