"""Structural similarity on luma (Wang et al. 2004): Gaussian window 11x11, sigma 1.5, K = (0.01, 0.03), range 255.

As in the authors' program and the papers of this field: BT.601 luma of the sRGB values, population covariance, the mean
over all pixels whose window lies inside the picture.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Bytes, Doubles
from shading_atlas_bench.arithmetic.functions import exp
from shading_atlas_bench.kernels.constants import constants_of
from shading_atlas_bench.kernels.metrics.colour import luma
from shading_atlas_bench.kernels.metrics.planes import Layout, padded_taps, total

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device

DEFINED = constants_of(Path(__file__).with_name("ssim.cl"))
RADIUS = DEFINED.whole("RADIUS")
SMALLEST_SIDE = 2 * RADIUS + 1
SIGMA = 1.5
C1, C2 = 2.55 * 2.55, 7.65 * 7.65  # (K * 255) squared
ORIGIN = 128.0  # subtracted from luma


def window() -> Doubles:
    """The taps of the Gaussian window, float64 (11), sum 1."""
    taps = exp(-np.square(np.arange(-RADIUS, RADIUS + 1)) / (2 * SIGMA * SIGMA))
    weights: Doubles = taps / taps.sum()
    return weights


class Ssim:
    """SSIM of pictures of one size against a reference.

    Pictures are uint8 (h, w, 4) device arrays, sRGB. Raises ValueError if a side is below 11 pixels.
    """

    def __init__(self, device: Device, width: int, height: int) -> None:
        if min(width, height) < SMALLEST_SIDE:
            raise ValueError(f"SSIM needs {SMALLEST_SIDE} pixels a side, and the picture has {width}x{height}.")
        self.device, self.layout = device, Layout(width, height)
        self.kernels = device.build("metrics/ssim.cl")
        self.taps = device.upload(padded_taps(window()))
        self.luma_reference, self.luma_test = (self.layout.empty(device) for _ in range(2))
        self.rows, self.moments = self.layout.empty(device, 3), self.layout.empty(device, 2)
        self.inner = self.layout.row_items(height - 2 * RADIUS)
        self.partial = device.empty(self.inner, np.float32)

    def _rows(self, image: Array, plane: Array, against: float) -> tuple[int, int, int]:
        at = self.layout
        size = (at.width, at.height, at.stride)
        self.device.launch("metrics/ssim/luma", self.kernels.centred_luma, at.items, *size, image, plane)
        arrays = (self.luma_reference, plane, self.taps, self.rows)
        self.device.launch("metrics/ssim/rows", self.kernels.window_rows, at.items, *size, against, *arrays)
        return size

    def reference(self, image: Array) -> None:
        """Take the picture that all others are compared with: uint8 (h, w, 4), sRGB."""
        size = self._rows(image, self.luma_reference, 0.0)
        kernel = self.kernels.reference_moments
        self.device.launch("metrics/ssim/columns", kernel, self.inner, *size, self.rows, self.taps, self.moments)

    def compare(self, test: Array) -> None:
        """Start comparing `test`, uint8 (h, w, 4), sRGB; `loss` gives what came out."""
        size = self._rows(test, self.luma_test, 1.0)
        self.device.launch(
            "metrics/ssim/columns",
            self.kernels.dissimilarity_sums,
            self.inner,
            *(*size, self.moments, self.rows, self.taps, ORIGIN, C1, C2, self.partial),
        )

    def loss(self) -> float:
        """1 less the mean SSIM of the last compared picture, exactly 0 for identical ones."""
        return total(self.partial) / ((self.layout.width - 2 * RADIUS) * (self.layout.height - 2 * RADIUS))


def windowed(image: Doubles) -> Doubles:
    """The mean of a plane (h, w) under the Gaussian window wherever it lies inside, float64 (h - 10, w - 10)."""
    for axis in (1, 0):
        image = np.lib.stride_tricks.sliding_window_view(image, SMALLEST_SIDE, axis) @ window()
    return image


def similarity_twin(reference: Doubles, test: Doubles) -> tuple[Doubles, Doubles]:
    """Contrast-structure and luminance similarity of two float64 (h, w) planes, each (h - 10, w - 10)."""
    mu_a, mu_b = windowed(reference), windowed(test)
    variance_a = windowed(reference**2) - mu_a**2
    variance_b = windowed(test**2) - mu_b**2
    covariance = windowed(reference * test) - mu_a * mu_b
    contrast_structure = (2 * covariance + C2) / (variance_a + variance_b + C2)
    return contrast_structure, (2 * mu_a * mu_b + C1) / (mu_a**2 + mu_b**2 + C1)


def ssim_twin(test: Bytes, reference: Bytes) -> float:
    """The mean SSIM of `test` against `reference`, uint8 (h, w, 3 or 4), sRGB."""
    contrast_structure, luminance = similarity_twin(luma(reference), luma(test))
    return float(np.mean(contrast_structure * luminance))
