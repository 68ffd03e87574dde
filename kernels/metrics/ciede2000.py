"""The mean colour difference CIEDE2000 (Sharma, Wu and Dalal 2005), k_L = k_C = k_H = 1, in CIELAB with white D65."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic import arrays
from shading_atlas_bench.arithmetic.arrays import Doubles, Floats
from shading_atlas_bench.kernels.metrics.colour import RGB_TO_RELATIVE, linear_values
from shading_atlas_bench.kernels.metrics.planes import PIECE, Layout, total

if TYPE_CHECKING:
    from pyopencl import Kernel
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device


class Ciede2000:
    """The mean difference of pictures of one size from a reference, uint8 (h, w, 4) device arrays, sRGB."""

    def __init__(self, device: Device, width: int, height: int) -> None:
        self.device, self.layout = device, Layout(width, height)
        self.kernels = device.build("metrics/ciede2000.cl")
        self.linear = device.upload(linear_values().astype(np.float32))
        self.to_xyz = device.upload(RGB_TO_RELATIVE.astype(np.float32))
        self.lab = self.layout.empty(device, 3)
        self.partial = device.empty(self.layout.items, np.float32)

    def _launch(self, kernel: Kernel, image: Array, *rest: Array) -> None:
        at = self.layout
        colour = (image, self.linear, self.to_xyz)
        self.device.launch("metrics/delta_e", kernel, at.items, at.width, at.height, at.stride, *colour, *rest)

    def reference(self, image: Array) -> None:
        """Take the picture that all others are compared with: uint8 (h, w, 4), sRGB."""
        self._launch(self.kernels.lab_planes, image, self.lab)

    def compare(self, test: Array) -> None:
        """Start comparing `test`, uint8 (h, w, 4), sRGB; `mean` gives what came out."""
        self._launch(self.kernels.difference_sums, test, self.lab, self.partial)

    def mean(self) -> float:
        """The mean difference of the last compared picture; about 1 is just noticeable."""
        return total(self.partial) / (self.layout.width * self.layout.height)


def ciede2000(device: Device, a: arrays.Array, b: arrays.Array) -> Floats:
    """The difference of each pair of CIELAB colours, (n, 3) and (n, 3), as the kernel computes it: float32 (n)."""
    count = -(-len(a) // PIECE) * PIECE
    columns = [np.zeros((3, count), np.float32) for _ in range(2)]
    for column, colours in zip(columns, (a, b), strict=True):
        column[:, : len(a)] = np.asarray(colours).T
    out = device.empty(count, np.float32)
    kernel = device.build("metrics/ciede2000.cl").differences
    device.launch("metrics/delta_e", kernel, count // PIECE, count, *(device.upload(c) for c in columns), out)
    return out.get()[: len(a)]


def ciede2000_twin(a: Doubles, b: Doubles) -> Doubles:
    """The difference, float64 (...), of CIELAB colours, float64 (..., 3) each; hue angles in degrees as the standard
    writes them."""
    (l1, a1, b1), (l2, a2, b2) = np.moveaxis(a, -1, 0), np.moveaxis(b, -1, 0)

    def weight(chroma: Doubles) -> Doubles:
        share: Doubles = np.sqrt(chroma**7 / (chroma**7 + 25.0**7))
        return share

    stretch = 1.5 - 0.5 * weight((np.hypot(a1, b1) + np.hypot(a2, b2)) / 2)
    c1, c2 = np.hypot(stretch * a1, b1), np.hypot(stretch * a2, b2)
    h1, h2 = (np.degrees(np.arctan2(y, stretch * x)) % 360 for x, y in ((a1, b1), (a2, b2)))
    grey = c1 * c2 == 0
    apart = h2 - h1
    turn = np.where(apart > 180, -360, np.where(apart < -180, 360, 0))
    delta_h = 2 * np.sqrt(c1 * c2) * np.sin(np.radians(np.where(grey, 0, apart + turn) / 2))
    total_h = h1 + h2
    mean_h = np.where(np.abs(apart) <= 180, total_h, np.where(total_h < 360, total_h + 360, total_h - 360)) / 2
    mean_h = np.where(grey, total_h, mean_h)
    mean_l, mean_c = (l1 + l2) / 2, (c1 + c2) / 2

    def cosine(times: int, plus: int) -> Doubles:
        value: Doubles = np.cos(np.radians(times * mean_h + plus))
        return value

    t = 1 - 0.17 * cosine(1, -30) + 0.24 * cosine(2, 0) + 0.32 * cosine(3, 6) - 0.20 * cosine(4, -63)
    lightness = (l2 - l1) / (1 + 0.015 * (mean_l - 50) ** 2 / np.sqrt(20 + (mean_l - 50) ** 2))
    chroma, hue = (c2 - c1) / (1 + 0.045 * mean_c), delta_h / (1 + 0.015 * mean_c * t)
    rotation = -2 * weight(mean_c) * np.sin(np.radians(60 * np.exp(-(((mean_h - 275) / 25) ** 2))))
    difference: Doubles = np.sqrt(np.maximum(lightness**2 + chroma**2 + hue**2 + rotation * chroma * hue, 0))
    return difference
