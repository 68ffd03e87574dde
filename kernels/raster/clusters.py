"""Clusters of consecutive triangles with boxes: what lies outside the frustum costs next to nothing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from kernels.common.scan import exclusive_scan
from kernels.raster.camera import Camera
from kernels.triangles import Triangles

if TYPE_CHECKING:
    from pyopencl.array import Array

    from kernels.device import Device

CLUSTER = 64  # triangles; a multiple of 8. Any other gives the same picture.


@dataclass(frozen=True)
class Clusters:
    """Runs of `size` triangles in file order.

    groups: float32 (count * size / 8, 9, 8), positions of 8 triangles each: x, y, z of corner 0, then 1, then 2.
    flags: uint8 (count * size), the triangles' flags. boxes: float32 (count, 8): low corner, 0, high corner, 0.
    """

    count: int
    size: int
    groups: Array
    flags: Array
    boxes: Array

    @classmethod
    def build(
        cls, device: Device, triangles: Triangles, size: int = CLUSTER, stage: str = "raster/clusters"
    ) -> Clusters:
        """Raises ValueError where a triangle's corner is not finite."""
        count = -(-triangles.count // size)
        groups = device.empty((count * size // 8, 9, 8), np.float32)
        flags = device.empty(count * size, np.uint8)
        boxes = device.empty((count, 8), np.float32)
        kernel = device.build("raster/clusters.cl", CLUSTER=size).build_clusters
        inputs = (triangles.positions, triangles.indices, triangles.flags)
        local = 1 if device.is_cpu else None
        device.launch(stage, kernel, count, triangles.count, count, *inputs, groups, flags, boxes, local=local)
        wrong = np.flatnonzero(np.isnan(boxes.get()[:count, 3])) if count else []
        if len(wrong):
            first, last = wrong[0] * size, min(wrong[0] * size + size, triangles.count) - 1
            raise ValueError(
                f"A corner of triangles {first} to {last} is NaN or infinite: remove such triangles first."
            )
        return cls(count, size, groups, flags, boxes)

    def in_frustum(self, device: Device, camera: Camera, stage: str = "raster/cull") -> tuple[Array, int]:
        """The clusters that may have a part inside the camera's frustum, ascending: int32 (n), and n."""
        kernels = device.build("raster/clusters.cl", CLUSTER=self.size)
        visible = device.empty(self.count, np.int32)
        size = (camera.width, camera.height)
        arguments = (self.count, *camera.arguments(), *size, self.boxes, visible)
        device.launch(stage, kernels.clusters_in_frustum, self.count, *arguments)
        offsets, total = exclusive_scan(device, visible, self.count, stage)
        chosen = device.empty(total, np.int32)
        device.launch(stage, kernels.list_clusters, self.count, self.count, visible, offsets, chosen)
        return chosen, total


def boxes_twin(triangles: Triangles, size: int = CLUSTER) -> np.ndarray:
    """The clusters' boxes, float64 (count, 2, 3): low and high corner."""
    corners = triangles.host_positions[triangles.host_indices].astype(np.float64)
    starts = np.arange(0, triangles.count, size)
    low = np.minimum.reduceat(corners.min(axis=1), starts)
    return np.stack([low, np.maximum.reduceat(corners.max(axis=1), starts)], axis=1)


def in_frustum_twin(boxes: np.ndarray, camera: Camera) -> np.ndarray:
    """The clusters whose box is not wholly outside one of the frustum's planes; the kernel may keep a few more."""
    choose = np.array([[i >> 2 & 1, i >> 1 & 1, i & 1] for i in range(8)])
    corners = camera.project(boxes[:, choose, np.arange(3)])
    x, y, z, w = np.moveaxis(corners, -1, 0)
    x, y = x / (camera.width * 128), y / (camera.height * 128)
    inside = [w - x, w + x, w - y, w + y, w - z, z]
    return np.flatnonzero(np.all([(side >= 0).any(axis=1) for side in inside], axis=0))
