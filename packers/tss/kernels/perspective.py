"""Perspective of samples: uniform on screen instead of on the surface (equation 5 and its inverse)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic import arrays
    from shading_atlas_bench.arithmetic.arrays import Doubles, Floats
    from shading_atlas_bench.kernels.device import Device

HERE = Path(__file__).parent


def invert_depths(device: Device, depths: Array, pieces: Array, count: int, scale: float, stage: str) -> Array:
    """Inverse depths float32 (count, 4) of each triangle's corners, the largest 1, and 0.

    depths, pieces: as from `measure_triangles`. scale: texels per pixel. The ratio of the largest to the smallest is at
    most a quarter of the triangle's height in texels, where it leaves the view also of its pieces, and 1 below 4:
    samples outside the triangle stay before the horizon, and a bilinear lookup is off by 1/16 of a texel at most.
    """
    inverse = device.recycled((count, 4), np.float32)
    kernel = device.build(HERE / "perspective.cl").invert_depths
    device.launch(stage, kernel, count, count, depths, pieces, float(scale), inverse)
    return inverse


def invert_depths_twin(depths: Floats, pieces: arrays.Array, scale: float) -> Doubles:
    """The same on the host, float64 (n, 3)."""
    height = depths[:, 3].astype(np.float64) * scale
    height = np.where(height < 0, np.minimum(-height, pieces), height)
    ratio = np.maximum(height / 4, 1)
    corner = depths[:, :3].astype(np.float64)
    corner = np.maximum(corner, (corner.max(axis=1) / ratio)[:, None])
    inverse: Doubles = corner.min(axis=1, keepdims=True) / corner
    return inverse


def to_screen(bary: Doubles, inverse: Doubles) -> Doubles:
    """Screen weights (n, 2) from object weights (n, 2) of corners 1 and 2, with inverse depths (n, 3): equation 5."""
    parts = np.column_stack([1 - bary.sum(axis=1), bary]) / inverse
    screen: Doubles = parts[:, 1:] / parts.sum(axis=1, keepdims=True)
    return screen


def to_object(screen: Doubles, inverse: Doubles) -> Doubles:
    """Object weights (n, 2) from screen weights (n, 2) of corners 1 and 2, with inverse depths (n, 3): the inverse of
    `to_screen`."""
    parts = np.column_stack([1 - screen.sum(axis=1), screen]) * inverse
    total = np.maximum(parts.sum(axis=1), inverse.min(axis=1) / 4)  # outside the triangle it could reach the horizon
    bary: Doubles = parts[:, 1:] / total[:, None]
    return bary
