"""Clusters of consecutive triangles with boxes: what is outside the frustum or hidden costs next to nothing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic import arrays
from shading_atlas_bench.arithmetic.arrays import Doubles, Ints
from shading_atlas_bench.kernels.raster.camera import Camera
from shading_atlas_bench.kernels.raster.render_target import RenderTarget
from shading_atlas_bench.kernels.triangles import Triangles

if TYPE_CHECKING:
    from pyopencl.array import Array
    from pyopencl.typing import KernelArg

    from shading_atlas_bench.kernels.device import Device, Kernels

NEVER = -(1 << 30)  # long before the first draw
EVER = np.iinfo(np.int32).max  # a max_age that leaves no cluster out


@dataclass(frozen=True)
class Chosen:
    """Numbers of clusters, ascending: the first counts[c] from where chunk c of them all begins.

    listed: int32 (clusters). counts: int32 (chunks).
    """

    listed: Array
    counts: Array

    @classmethod
    def allocate(cls, device: Device, clusters: int) -> Chosen:
        """An uninitialised list."""
        return cls(device.recycled(clusters, np.int32), device.recycled(device.chunks, np.int32))

    def numbers(self, clusters: int) -> Ints:
        """Those listed of `clusters`, int32 (n), on the host."""
        listed, counts = self.listed.get(), self.counts.get()
        starts = clusters * np.arange(len(counts)) // len(counts)
        return np.concatenate([listed[start : start + count] for start, count in zip(starts, counts, strict=True)])


@dataclass(frozen=True)
class Clusters:
    """Runs of `size` triangles in file order.

    groups: float32 (count * size / 8, 9, 8), positions of 8 triangles each: x, y, z of corner 0, then 1, then 2.
    flags: uint32 (count * size / 8), their flags, 4 bits each.
    boxes: float32 (count, 8): low corner, 0, high corner, 0.
    last_seen: int32 (count), the number of the draw that showed the cluster last.
    culls: whether those outside a view are left out.
    """

    device: Device
    count: int
    size: int
    groups: Array
    flags: Array
    boxes: Array
    last_seen: Array
    culls: bool = True

    @classmethod
    def build(
        cls, device: Device, triangles: Triangles, size: int, stage: str = "raster/clusters", culls: bool = True
    ) -> Clusters:
        """Raises ValueError where a triangle's corner is not finite, or beyond 1e18."""
        count = -(-triangles.count // size)
        groups = device.empty((count * size // 8, 9, 8), np.float32)
        flags = device.empty(count * size // 8, np.uint32)
        boxes = device.empty((count, 8), np.float32)
        clusters = cls(device, count, size, groups, flags, boxes, device.empty(count, np.int32), culls)
        device.fill(clusters.last_seen, NEVER)
        inputs = (triangles.positions, triangles.indices, triangles.flags)
        arguments = (triangles.count, count, *inputs, groups, flags, boxes)
        device.launch(stage, clusters._kernels(8).build_clusters, count, *arguments, local=1 if device.is_cpu else None)
        wrong = np.flatnonzero(boxes.get()[:count, 3]) if count else np.zeros(0, np.intp)
        if len(wrong):
            first, last = wrong[0] * size, min(wrong[0] * size + size, triangles.count) - 1
            where = f"A corner of one of the triangles {first} to {last}"
            raise ValueError(f"{where} is NaN, infinite or beyond 1e18: remove such triangles first.")
        return clusters

    def cull_frustum(self, camera: Camera, now: int, max_age: int, stage: str) -> tuple[Chosen, Chosen]:
        """Clusters that may be in the frustum: those seen at most `max_age` draws ago, and the others.

        Where the clusters do not cull, the first has them all.
        """
        recent, others = (Chosen.allocate(self.device, self.count) for _ in range(2))
        inputs = (
            *camera.arguments(),
            camera.width,
            camera.height,
            self.boxes,
            self.culls,
            self.last_seen,
            now,
            max_age,
        )
        results = (recent.listed, recent.counts, others.listed, others.counts)
        self._launch_chunks("choose_clusters", 8, stage, *inputs, *results)
        return recent, others

    def cull_occluded(self, chosen: Chosen, picture: RenderTarget, stage: str) -> None:
        """Strike from the list those that the picture so far hides."""
        camera = picture.camera
        inputs = (*camera.arguments(), camera.width, camera.height, self.boxes)
        drawn = (picture.tiles_x, picture.block_depth, picture.tile_depth)
        self._launch_chunks("cull_occluded", picture.tile, stage, *inputs, *drawn, chosen.listed, chosen.counts)

    def note_seen(self, picture: RenderTarget, now: int, stage: str) -> None:
        """Remember which clusters draw number `now` shows."""
        height, width = picture.camera.height, picture.camera.width
        arguments = (height, width, picture.triangle, now, self.last_seen)
        local = 1 if self.device.is_cpu else None
        self.device.launch(stage, self._kernels(8).note_seen, -(-height // 8), *arguments, local=local)

    def _launch_chunks(self, name: str, tile: int, stage: str, *arguments: KernelArg) -> None:
        chunks, kernel = self.device.chunks, self._kernels(tile).by_name[name]
        self.device.launch(stage, kernel, chunks, chunks, self.count, *arguments, local=1)

    def _kernels(self, tile: int) -> Kernels:
        return self.device.build("raster/clusters.cl", CLUSTER=self.size, TILE=tile)


def boxes_twin(triangles: Triangles, size: int) -> Doubles:
    """The clusters' boxes, float64 (count, 2, 3): low and high corner."""
    corners = triangles.host_positions[triangles.host_indices].astype(np.float64)
    starts = np.arange(0, triangles.count, size)
    low = np.minimum.reduceat(corners.min(axis=1), starts)
    return np.stack([low, np.maximum.reduceat(corners.max(axis=1), starts)], axis=1)


def in_frustum_twin(boxes: Doubles, camera: Camera) -> arrays.Array:
    """The clusters, int (n), whose box, of `boxes` as from `boxes_twin`, is not wholly outside one of the frustum's
    planes; the kernel may keep a few more."""
    choose = np.array([[i >> 2 & 1, i >> 1 & 1, i & 1] for i in range(8)])
    corners = camera.project(boxes[:, choose, np.arange(3)])
    x, y, z, w = np.moveaxis(corners, -1, 0)
    x, y = x / (camera.width * 128), y / (camera.height * 128)
    inside = [w - x, w + x, w - y, w + y, w - z, z]
    return np.flatnonzero(np.all([(side >= 0).any(axis=1) for side in inside], axis=0))
