"""Stretch (Sander et al. 2001) per visible pixel: 1 is one texel to one pixel, above 1 is undersampled.

With J = d texel / d pixel and its singular values s1 <= s2, in texels per pixel: Linf = 1 / s1 and
L2 = sqrt((s1^-2 + s2^-2) / 2). Any map, also piecewise and perspective-correct ones, is measured as it is looked up.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Doubles, Floats, Ints
from shading_atlas_bench.kernels.metrics.planes import Layout

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device

DEGENERATE = 1e-6  # |det J| below this share of the sum of squares: a collapsed map


def stretch(device: Device, triangle: Array, texels: Array) -> tuple[float | None, float | None, int]:
    """The frame's L2 and Linf stretch, and the number of pixels with a degenerate map, which count in neither.

    triangle: int32 (h, w) device array, ids, -1 where empty. texels: float32 (h, w, 2) device array, column and row in
    the atlas, NaN where unknown. Derivatives are differences to the neighbours left or right, above or below, in the
    same triangle: the shorter of two, because maps may be cut within a triangle. Pixels that lack either direction are
    left out. L2 is the root of the mean square, Linf the largest; None if no pixel can be measured.
    """
    height, width = triangle.shape
    at = Layout(width, height)
    sums, counts = device.empty((at.items, 2), np.float32), device.empty((at.items, 2), np.int32)
    kernel = device.build("metrics/stretch.cl").stretch
    device.launch("metrics/stretch", kernel, at.items, width, height, triangle, texels, DEGENERATE, sums, counts)
    valid, degenerate = (int(n) for n in counts.get().sum(axis=0, dtype=np.int64))
    if valid == 0:
        return None, None, degenerate
    squares = sums.get()
    l2 = np.sqrt(squares[:, 0].sum(dtype=np.float64) / valid)
    return float(l2), float(np.sqrt(squares[:, 1].max())), degenerate


def _derivative(values: Doubles, triangle: Ints, axis: int) -> Doubles:
    """The shorter difference along an axis within one triangle, float64 (h, w, 2), NaN where there is no neighbour."""
    gap = np.where(np.diff(triangle, axis=axis)[..., None] == 0, np.diff(values, axis=axis), np.nan)
    missing = np.full_like(np.take(values, [0], axis), np.nan)
    backward, forward = np.concatenate([missing, gap], axis), np.concatenate([gap, missing], axis)
    lengths = [np.nan_to_num((part**2).sum(axis=-1, keepdims=True), nan=np.inf) for part in (backward, forward)]
    return np.where(lengths[0] <= lengths[1], backward, forward)


def stretch_twin(triangle: Ints, texels: Floats) -> tuple[float | None, float | None, int]:
    """The same for host arrays, in float64."""
    values = np.where(triangle[..., None] >= 0, texels.astype(np.float64), np.nan)
    jacobian = np.stack([_derivative(values, triangle, axis) for axis in (1, 0)], axis=-1).reshape(-1, 2, 2)
    jacobian = jacobian[np.isfinite(jacobian).all(axis=(1, 2))]
    squares = (jacobian**2).sum(axis=(1, 2))
    valid = np.abs(np.linalg.det(jacobian)) > DEGENERATE * squares
    degenerate = int(len(jacobian) - valid.sum())
    if not valid.any():
        return None, None, degenerate
    s = np.linalg.svd(jacobian[valid], compute_uv=False)
    return float(np.sqrt((s**-2.0).mean())), float(1 / s[:, 1].min()), degenerate
