"""Marking the triangles that a picture shows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kernels.raster.rasteriser import Visibility

if TYPE_CHECKING:
    from pyopencl.array import Array

    from kernels.device import Device


def mark_visible(device: Device, visibility: Visibility, flags: Array, stage: str = "raster/mark") -> None:
    """Set `flags` (uint8 (T), on the device) to 1 for every triangle seen; others stay as they are."""
    pixels = visibility.width * visibility.height
    kernel = device.build("raster/mark.cl").mark_visible
    device.launch(stage, kernel, pixels, pixels, visibility.triangle, flags)


def mark_visible_twin(triangle: np.ndarray, flags: np.ndarray) -> np.ndarray:
    """The flags after marking the triangles of an image of ids (-1: none)."""
    marked = flags.copy()
    marked[triangle[triangle >= 0]] = 1
    return marked
