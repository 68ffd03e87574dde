"""The compact list of shading samples: packers and the reference emit it, the one shading kernel reads it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic import arrays

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device

WIDTH = 32  # samples per step of the widest kernel; lists are allocated in whole steps


@dataclass
class Samples:
    """Shading samples on the device, structure of arrays; only the first `count` entries mean anything.

    triangle: int32 (n), index into the scene's triangles.
    bary1, bary2: float32 (n), weights of the triangle's vertices 1 and 2 in object space; vertex 0 has the rest.
        They may lie outside the triangle where a texel beyond its edge is needed for bilinear lookups.
    footprint: float32 (n), the longer side of the surface area that the sample stands for, in scene units;
        it selects the mip level.
    texel: int32 (n), row * width + column of the sample in its target plane.
    """

    count: int
    triangle: Array
    bary1: Array
    bary2: Array
    footprint: Array
    texel: Array

    @classmethod
    def allocate(cls, device: Device, count: int) -> Samples:
        """Room for `count` samples, rounded up to whole steps of WIDTH."""
        room = max(1, -(-count // WIDTH)) * WIDTH
        triangle, texel = (device.recycled(room, np.int32) for _ in range(2))
        bary1, bary2, footprint = (device.recycled(room, np.float32) for _ in range(3))
        return cls(count, triangle, bary1, bary2, footprint, texel)

    @classmethod
    def upload(
        cls,
        device: Device,
        triangle: arrays.Array,
        bary1: arrays.Array,
        bary2: arrays.Array,
        footprint: arrays.Array,
        texel: arrays.Array,
    ) -> Samples:
        """Samples from host arrays (n) of any numbers: triangle, bary1, bary2, footprint, texel, as the fields say."""
        samples = cls.allocate(device, len(triangle))
        for array, values in (
            (samples.triangle, triangle),
            (samples.bary1, bary1),
            (samples.bary2, bary2),
            (samples.footprint, footprint),
            (samples.texel, texel),
        ):
            padded = np.zeros(array.shape, array.dtype)
            padded[: len(values)] = values
            array.set(padded)
        return samples

    @classmethod
    def of_points(cls, device: Device, triangle: arrays.Array, bary: arrays.Array) -> Samples:
        """Surface points from host arrays of any numbers, triangle (n) and bary (n, 2); footprints and texels are 0."""
        samples, count = cls.allocate(device, len(triangle)), len(triangle)
        parts = (samples.triangle, triangle), (samples.bary1, bary[:, 0]), (samples.bary2, bary[:, 1])
        for array, values in parts:
            with device.written(array) as shown:
                shown[:count] = values
                shown[count:] = 0
        device.fill(samples.footprint, 0)
        device.fill(samples.texel, 0)
        return samples
