"""Marking the triangles that a picture shows."""

from __future__ import annotations

from typing import TYPE_CHECKING

from shading_atlas_bench.arithmetic.arrays import Bytes, Ints
from shading_atlas_bench.kernels.raster.rasteriser import Visibility

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device


def mark_visible(device: Device, visibility: Visibility, flags: Array, stage: str = "raster/mark") -> None:
    """Set `flags` (uint8 (T), on the device) to 1 for every triangle seen; others stay as they are."""
    height, width = visibility.height, visibility.width
    kernel = device.build("raster/mark.cl").mark_visible
    local = 1 if device.is_cpu else None
    device.launch(stage, kernel, height, height, width, visibility.triangle, flags, local=local)


def mark_visible_twin(triangle: Ints, flags: Bytes) -> Bytes:
    """The flags, uint8 (T), after marking the triangles of an image of ids, int32 (h, w), -1 where there is none."""
    marked = flags.copy()
    marked[triangle[triangle >= 0]] = 1
    return marked
