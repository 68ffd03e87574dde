"""Whether a plane's alpha says which texels have a sample."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Bytes, Ints

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device


def compare_alpha(device: Device, texels: Array, plane: Array, stage: str) -> tuple[int, int]:
    """How many texels have a sample, and how many have an alpha that is not 255 then, or not 0 elsewhere.

    texels: uint8 (H, W, 4). plane: int32 (H, W), negative without a sample.
    """
    height, width = texels.shape[:2]
    counts = device.zeros(2, np.int32)
    kernel = device.build("validity/texels.cl").compare_alpha
    device.launch(stage, kernel, height, width, height, texels, plane, counts, local=1)
    owned, wrong = counts.get().tolist()
    return owned, wrong


def compare_alpha_twin(texels: Bytes, plane: Ints) -> tuple[int, int]:
    """The same of host arrays."""
    owned = plane >= 0
    return int(owned.sum()), int((texels[..., 3] != np.where(owned, 255, 0)).sum())
