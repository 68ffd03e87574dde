"""A small kernel that shows whether the device computes what it should: the launcher and the twin of `smoke.cl`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Array, Floats, Words

if TYPE_CHECKING:
    from shading_atlas_bench.kernels.device import Device

DEGREE = 12
ERROR_BOUND = 4e-6  # absolute, for |x| <= 1 and |coefficients| <= 1: 2 roundings of 2^-24 per step on sums up to 13


def smoke(device: Device, x: Floats, coefficients: Array) -> tuple[Floats, Words]:
    """The polynomial with `coefficients` (DEGREE + 1, constant first) at each x, and a hash of each place.

    x: float32 (n), n a multiple of 8. Returns float32 (n) and uint32 (n).
    """
    values, hashes = device.empty(len(x), np.float32), device.empty(len(x), np.uint32)
    kernels = device.build("doctor/smoke.cl")
    arrays = [device.upload(np.asarray(array, np.float32)) for array in (x, coefficients)]
    device.launch("smoke", kernels.smoke, len(x) // 8, len(x) // 8, *arrays, values, hashes)
    return values.get(), hashes.get()


def smoke_twin(x: Floats, coefficients: Array) -> tuple[Array, Array]:
    """The same in float64."""
    values = np.polynomial.polynomial.polyval(x.astype(np.float64), coefficients.astype(np.float64))
    place = np.arange(len(x), dtype=np.uint32)
    place = (place ^ (place >> np.uint32(7))) * np.uint32(0x9E3779B1)
    return values, place ^ (place << np.uint32(13) | place >> np.uint32(19))
