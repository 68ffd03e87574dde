"""A scene's triangles on the device."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic import arrays
from shading_atlas_bench.arithmetic.arrays import Bytes, Floats, Ints

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device


@dataclass(frozen=True)
class Triangles:
    """positions float32 (V, 3), indices int32 (T, 3) and flags uint8 (T) on the device.

    host_positions, host_indices, host_flags: the same on the host.
    flags, per triangle: DOUBLE_SIDED, MASKED, BLENDED (what is behind shows through), FADED (masked, and the alpha of
    its vertices counts).
    """

    DOUBLE_SIDED = 1
    MASKED = 2
    BLENDED = 4
    FADED = 8

    count: int
    positions: Array
    indices: Array
    flags: Array
    host_positions: Floats
    host_indices: Ints
    host_flags: Bytes

    @classmethod
    def upload(cls, device: Device, positions: arrays.Array, indices: arrays.Array, flags: arrays.Array) -> Triangles:
        """Copy host arrays to the device: positions float (V, 3), indices int (T, 3), flags int (T)."""
        positions = np.ascontiguousarray(positions, np.float32)
        indices = np.ascontiguousarray(indices, np.int32)
        flags = np.ascontiguousarray(flags, np.uint8)
        return cls(
            len(indices),
            device.upload(positions),
            device.upload(indices),
            device.upload(flags),
            positions,
            indices,
            flags,
        )
