"""The elementary functions of `common/elementary.cl`, on their own: launcher and twin."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Array, Doubles, Floats

if TYPE_CHECKING:
    from shading_atlas_bench.kernels.device import Device

# Largest errors in units of the last place of float32: of log2 (of at least 2^-10), of 2^x, and of pi for angles.
LOG2_ULP, EXP2_ULP, ANGLE_ULP = 3.0, 2.0, 2.0


def elementary(device: Device, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
    """log2 |y|, 2^x and the angle of (x, y) in -pi..pi.

    x, y: float32 (n), n a multiple of 8, -126 <= x < 127, |y| normal. Returns float32 (n) each.
    """
    results = [device.empty(len(x), np.float32) for _ in range(3)]
    kernel = device.build("doctor/elementary.cl").elementary
    groups = len(x) // 8
    device.launch("elementary", kernel, groups, groups, device.upload(x), device.upload(y), *results)
    log2_y, exp2_x, angle = (result.get() for result in results)
    return log2_y, exp2_x, angle


def elementary_twin(x: Array, y: Array) -> tuple[Doubles, Doubles, Doubles]:
    """The same in float64."""
    x, y = x.astype(np.float64), y.astype(np.float64)
    return np.log2(np.abs(y)), np.exp2(x), np.arctan2(y, x)
