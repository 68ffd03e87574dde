"""An atlas from the list of its samples, and which of these the checks look at one by one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Bools, Floats, Ints, Longs

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device

NO_SAMPLE = -1  # in the plane
ROUNDING = 1e-4  # of weights: so far outside its triangle a sample still counts as inside; also in samples.cl


@dataclass(frozen=True)
class SampleList:
    """A list of samples for kernels to read; without any, each array has one element.

    texel: int64 (count), row * width + column. triangle: int32 (count), 0 or more. bary: float32 (count, 2).
    """

    count: int
    texel: Array
    triangle: Array
    bary: Array

    @classmethod
    def lent(cls, device: Device, texel: Longs, triangle: Ints, bary: Floats) -> SampleList:
        """Of host arrays, texel (n), triangle (n) and bary (n, 2), which nobody may write to meanwhile."""
        typed = ((texel, np.int64), (triangle, np.int32), (bary, np.float32))
        return cls(len(texel), *(device.lent(np.asarray(values, dtype)) for values, dtype in typed))


@dataclass(frozen=True)
class PlacedSamples:
    """plane: int32 (height, width), the number of the sample in each texel, of several any, NO_SAMPLE where there is
    none. chosen: uint8 (n), 1 where a sample is inside its triangle, which has its turn, else 0. far: uint8 (n), 1
    where a weight is below -1 or not a number. outside, distant: how many samples lie outside the atlas, and are far.
    """

    plane: Array
    chosen: Array
    far: Array
    outside: int
    distant: int


def place_samples(
    device: Device, samples: SampleList, width: int, height: int, has_turn: Bools, stage: str
) -> PlacedSamples:
    """Samples of an atlas of width x height texels. has_turn: bool (T), by triangle, on the host."""
    kernel = device.build("validity/samples.cl").place_samples
    plane = device.recycled((height, width), np.int32)
    device.fill(plane, NO_SAMPLE, stage)
    chosen, far = (device.recycled(samples.count, np.uint8) for _ in range(2))
    counts = device.zeros(2, np.int32)
    arrays = (samples.texel, samples.triangle, samples.bary, device.lent(has_turn), plane, chosen, far, counts)
    device.launch(stage, kernel, samples.count, samples.count, width * height, *arrays)
    outside, distant = counts.get().tolist()
    return PlacedSamples(plane, chosen, far, outside, distant)


def sample_plane_twin(texel: Longs, width: int, height: int) -> Ints:
    """The plane of `place_samples`, texel (n); of several samples in one texel the last counts."""
    plane = np.full(width * height, NO_SAMPLE, np.int32)
    listed = np.flatnonzero((texel >= 0) & (texel < width * height))
    plane[texel[listed]] = listed
    return plane.reshape(height, width)


def choose_samples_twin(triangle: Ints, bary: Floats, has_turn: Bools) -> tuple[Bools, Bools]:
    """Which samples, triangle (n) and bary (n, 2), `place_samples` chooses, and which are far: bool (n) each.

    has_turn: bool (T), by triangle.
    """
    b1, b2 = bary.T
    with np.errstate(all="ignore"):
        far = ~(np.minimum(np.minimum(b1, b2), 1 - b1 - b2) >= -1)
        inside = (np.minimum(b1, b2) >= -ROUNDING) & (b1 + b2 <= 1 + ROUNDING)
    return inside & has_turn[triangle], far
