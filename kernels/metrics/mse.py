"""Mean squared error of sRGB values, and the peak signal-to-noise ratio from it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Bytes
from shading_atlas_bench.arithmetic.functions import log
from shading_atlas_bench.kernels.metrics.planes import Layout

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device


LOG_10 = 2.302585092994046  # the natural logarithm of 10


class SquaredError:
    """The exact squared error of pictures of one size against a reference, uint8 (h, w, 4) device arrays."""

    def __init__(self, device: Device, width: int, height: int) -> None:
        self.device, self.layout = device, Layout(width, height)
        self.kernel = device.build("metrics/mse.cl").squared_error
        self.partial = device.empty(self.layout.items, np.int32)

    def compare(self, test: Array, reference: Array) -> None:
        """Start comparing `test` with `reference`, uint8 (h, w, 4), sRGB; `mean` gives what came out."""
        at = self.layout
        self.device.launch("metrics/mse", self.kernel, at.items, at.width, at.height, test, reference, self.partial)

    def mean(self) -> float:
        """The mean over pixels and the channels R, G, B, in squared 8-bit steps."""
        return int(np.sum(self.partial.get(), dtype=np.int64)) / (3 * self.layout.width * self.layout.height)


def mse_twin(test: Bytes, reference: Bytes) -> float:
    """The same for two uint8 (h, w, 3 or 4) host pictures."""
    return float(np.mean((test[..., :3].astype(np.float64) - reference[..., :3]) ** 2))


def psnr(mse: float) -> float | None:
    """Peak signal-to-noise ratio in dB; None for identical pictures, whose ratio is infinite."""
    return float(10 * log(255 * 255 / mse) / LOG_10) if mse > 0 else None
