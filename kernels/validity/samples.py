"""An atlas from the list of its samples, and which of these the checks look at one by one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Bytes, Floats, Ints, Longs

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device

UNOWNED, BORDER = -1, -2  # in the plane: of texels without a sample, and of those around the atlas
FAR, CHOSEN = 1, 2  # marks
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
        """Of host arrays, which nobody may write to meanwhile."""
        typed = ((texel, np.int64), (triangle, np.int32), (bary, np.float32))
        return cls(len(texel), *(device.lent(np.asarray(values, dtype)) for values, dtype in typed))


@dataclass(frozen=True)
class PlacedSamples:
    """plane: int32 (height + 2, width + 2), with a border of one texel around the atlas: the number of the sample in
    each texel, of several any, UNOWNED or BORDER. marks: uint8 (n), FAR where a weight is below -1 or not a number,
    CHOSEN where the sample is inside its triangle, whose turn it is. outside, far: how many samples lie outside the
    atlas, and are FAR."""

    plane: Array
    marks: Array
    outside: int
    far: int


def place_samples(
    device: Device, samples: SampleList, width: int, height: int, turn: int, turns: int, stage: str
) -> PlacedSamples:
    """Samples of an atlas of width x height texels; triangles whose number leaves `turn` over `turns` have theirs."""
    kernels = device.build("validity/samples.cl", UNOWNED=UNOWNED, BORDER=BORDER, FAR=FAR, CHOSEN=CHOSEN)
    plane = device.recycled((height + 2, width + 2), np.int32)
    marks, counts = device.recycled(samples.count, np.uint8), device.zeros(2, np.int32)
    device.launch(stage, kernels.clear_plane, height + 2, width, height, plane, local=1)
    arrays = (samples.texel, samples.triangle, samples.bary, plane, marks, counts)
    device.launch(stage, kernels.place_samples, samples.count, samples.count, width, height, turn, turns, *arrays)
    outside, far = counts.get().tolist()
    return PlacedSamples(plane, marks, outside, far)


def sample_plane_twin(texel: Longs, width: int, height: int) -> Ints:
    """The plane of `place_samples`; of several samples in one texel the last counts."""
    plane = np.full((height + 2, width + 2), BORDER, np.int32)
    plane[1:-1, 1:-1] = UNOWNED
    listed = np.flatnonzero((texel >= 0) & (texel < width * height))
    plane[texel[listed] // width + 1, texel[listed] % width + 1] = listed
    return plane


def sample_marks_twin(triangle: Ints, bary: Floats, turn: int, turns: int) -> Bytes:
    """The marks of `place_samples`."""
    b1, b2 = bary.T
    with np.errstate(all="ignore"):
        far = ~(np.minimum(np.minimum(b1, b2), 1 - b1 - b2) >= -1)
        inside = (np.minimum(b1, b2) >= -ROUNDING) & (b1 + b2 <= 1 + ROUNDING)
    return np.where(far, FAR, 0).astype(np.uint8) | np.where(inside & (triangle % turns == turn), CHOSEN, 0).astype(
        np.uint8
    )
