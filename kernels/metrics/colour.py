"""Colour as the metrics need it: the sRGB curve, the matrix to XYZ relative to white, CIELAB, luma (float64)."""

from __future__ import annotations

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Bytes, Doubles
from shading_atlas_bench.arithmetic.functions import power
from shading_atlas_bench.arithmetic.matrices import dot, transform

# The sRGB primaries and white D65 as published with FLIP (IEC 61966-2-1 in exact fractions), rows X, Y, Z.
RGB_TO_XYZ = np.array(
    [
        [10135552 / 24577794, 8788810 / 24577794, 4435075 / 24577794],
        [2613072 / 12288897, 8788810 / 12288897, 887015 / 12288897],
        [1425312 / 73733382, 8788810 / 73733382, 70074185 / 73733382],
    ]
)
# XYZ relative to the white of RGB (1, 1, 1), so that white is (1, 1, 1).
RGB_TO_RELATIVE = RGB_TO_XYZ / RGB_TO_XYZ.sum(axis=1, keepdims=True)
LUMA = np.array([0.299, 0.587, 0.114])


def linear_values() -> Doubles:
    """The linear value of every sRGB byte, float64 (256)."""
    s = np.arange(256) / 255
    return np.where(s <= 0.04045, s / 12.92, power((s + 0.055) / 1.055, 2.4))


def lab_from_relative(xyz: Doubles) -> Doubles:
    """CIELAB, float64 (..., 3), of XYZ relative to white, (..., 3)."""
    f = np.where(xyz > 216 / 24389, power(np.maximum(xyz, 0), 1 / 3), xyz * 841 / 108 + 4 / 29)
    return np.stack([116 * f[..., 1] - 16, 500 * (f[..., 0] - f[..., 1]), 200 * (f[..., 1] - f[..., 2])], axis=-1)


def lab_from_srgb(image: Bytes) -> Doubles:
    """CIELAB, float64 (h, w, 3), of an sRGB image, uint8 (h, w, 3 or 4)."""
    return lab_from_relative(transform(RGB_TO_RELATIVE, linear_values()[image[..., :3]]))


def luma(image: Bytes) -> Doubles:
    """BT.601 luma, float64 (h, w), 0..255, not rounded, of the sRGB values of an image, uint8 (h, w, 3 or 4)."""
    return dot(image[..., :3], LUMA)
