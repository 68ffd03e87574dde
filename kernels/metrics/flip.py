"""FLIP for low dynamic range: the error seen when flipping between two pictures (Andersson et al. 2020)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic import arrays
from shading_atlas_bench.arithmetic.arrays import Bytes, Doubles, Floats
from shading_atlas_bench.arithmetic.functions import exp, hypot, log, power
from shading_atlas_bench.arithmetic.matrices import inverse
from shading_atlas_bench.kernels.metrics.colour import RGB_TO_RELATIVE, lab_from_relative, linear_values
from shading_atlas_bench.kernels.metrics.planes import MARGIN, Layout, padded_taps, total

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device

PIXELS_PER_DEGREE = 67.02  # 0.7 m from a display 0.7 m and 3840 pixels wide
COLOUR_EXPONENT = 0.7
COLOUR_BEND = (0.4, 0.95)  # at this share of the largest difference the error is this
FEATURE_WIDTH = 0.082  # degrees
# Contrast sensitivity per channel: the sum of two Gaussians (a1, b1), (a2, b2) in degrees.
SENSITIVITY = {
    "luminance": (1.0, 0.0047),
    "red_green": (1.0, 0.0053),
    "yellow_1": (34.1, 0.04),
    "yellow_2": (13.5, 0.025),
}


@dataclass(frozen=True)
class Filters:
    """The 1D filters of FLIP at a resolution; each array holds the taps from -radius to radius, float64 (2 radius + 1).

    luminance, red_green, yellow_1, yellow_2: of the contrast sensitivity of each channel, blue-yellow as two Gaussians.
    smooth, edge, point: a Gaussian, and its first and second derivative, which find edges and points.
    yellow_share: of the first Gaussian in the blue-yellow filter. The filters of luminance and red-green are cut where
    they fall below 1e-7 of their centre.
    """

    luminance: Doubles
    red_green: Doubles
    yellow_1: Doubles
    yellow_2: Doubles
    yellow_share: float
    smooth: Doubles
    edge: Doubles
    point: Doubles

    @classmethod
    def at(cls, pixels_per_degree: float) -> Filters:
        """The filters for a resolution, in pixels per degree of visual angle."""
        radius = int(np.ceil(3 * np.sqrt(0.04 / (2 * np.pi * np.pi)) * pixels_per_degree))
        sharp = min(radius, int(np.ceil(np.sqrt(log(1e7) * 0.0053) / np.pi * pixels_per_degree)))

        def gaussian(b: float, reach: int) -> tuple[Doubles, float]:
            place = np.pi * np.arange(-reach, reach + 1) / pixels_per_degree
            values = exp(-place * place / b)
            return values / values.sum(), values.sum()

        (a1, b1), (a2, b2) = SENSITIVITY["yellow_1"], SENSITIVITY["yellow_2"]
        (yellow_1, sum_1), (yellow_2, sum_2) = gaussian(b1, radius), gaussian(b2, radius)
        weight_1, weight_2 = (a * np.sqrt(np.pi / b) * s * s for a, b, s in ((a1, b1, sum_1), (a2, b2, sum_2)))
        deviation = 0.5 * FEATURE_WIDTH * pixels_per_degree
        x = np.arange(-np.ceil(3 * deviation), np.ceil(3 * deviation) + 1)
        smooth = exp(-x * x / (2 * deviation * deviation))
        return cls(
            gaussian(SENSITIVITY["luminance"][1], sharp)[0],
            gaussian(SENSITIVITY["red_green"][1], sharp)[0],
            yellow_1,
            yellow_2,
            float(weight_1 / (weight_1 + weight_2)),
            smooth / smooth.sum(),
            _halves_sum_to_one(-x * smooth),
            _halves_sum_to_one((x * x / (deviation * deviation) - 1) * smooth),
        )

    @property
    def taps(self) -> Floats:
        """All filters one after the other, float32 (n), each between zeros, as from `padded_taps`."""
        whole = (self.luminance, self.red_green, self.yellow_1, self.yellow_2, self.smooth, self.edge, self.point)
        return np.concatenate([padded_taps(taps) for taps in whole])


def _halves_sum_to_one(values: Doubles) -> Doubles:
    """Scale the positive values to a sum of 1 and the negative ones to -1."""
    positive = values > 0
    scaled: Doubles = np.where(positive, values / values[positive].sum(), values / -values[~positive].sum())
    return scaled


def _hunt_lab(relative_xyz: Doubles) -> Doubles:
    lab = lab_from_relative(relative_xyz)
    return np.concatenate([lab[..., :1], 0.01 * lab[..., :1] * lab[..., 1:]], axis=-1)


def largest_colour_difference() -> float:
    """The difference of green and blue, the largest on an sRGB display, to the power .7."""
    green, blue = _hunt_lab(RGB_TO_RELATIVE.T[1]), _hunt_lab(RGB_TO_RELATIVE.T[2])
    return float(power(abs(green[0] - blue[0]) + hypot(*(green - blue)[1:]), COLOUR_EXPONENT))


class Flip:
    """FLIP of pictures of one size against a reference.

    Pictures are uint8 (h, w, 4) device arrays, sRGB. Raises ValueError where the filters would be wider than the
    planes' margins (beyond 118 pixels per degree).
    """

    def __init__(self, device: Device, width: int, height: int, pixels_per_degree: float = PIXELS_PER_DEGREE) -> None:
        filters = Filters.at(pixels_per_degree)
        blur = len(filters.yellow_1) // 2
        if blur > MARGIN:
            raise ValueError(f"FLIP at {pixels_per_degree:g} pixels per degree needs wider filters than there is room.")
        self.device, self.layout = device, Layout(width, height)
        self.kernels = device.build(
            "metrics/flip.cl",
            SHARP_RADIUS=len(filters.luminance) // 2,
            BLUR_RADIUS=blur,
            FEATURE_RADIUS=len(filters.smooth) // 2,
        )
        self.taps, self.share = device.upload(filters.taps), filters.yellow_share
        self.linear = device.upload(linear_values().astype(np.float32))
        self.to_xyz = device.upload(RGB_TO_RELATIVE.astype(np.float32))
        self.to_rgb = device.upload(inverse(RGB_TO_RELATIVE).astype(np.float32))
        self.largest = largest_colour_difference()
        self.planes, self.rows = self.layout.empty(device, 3), self.layout.empty(device, 7)
        self.reference_features, self.test_features = self.layout.empty(device, 5), self.layout.empty(device, 5)
        self.map = self.layout.empty(device)
        self.partial = device.empty(self.layout.items, np.float32)

    def _features(self, image: Array, features: Array) -> None:
        at, kernels, launch = self.layout, self.kernels, self.device.launch
        size = (at.width, at.height, at.stride)
        pieces = at.height * (at.stride // 16)
        launch("metrics/flip/opponents", kernels.opponents, pieces, *size, image, self.linear, self.to_xyz, self.planes)
        launch("metrics/flip/rows", kernels.filter_rows, at.items, *size, self.planes, self.taps, self.rows)
        colour = (self.share, self.to_rgb, self.to_xyz)
        filtered, stage = (self.rows, self.taps), "metrics/flip/columns"
        launch(stage, kernels.colour_columns, at.row_items(at.height), *size, *filtered, *colour, features)
        launch(stage, kernels.feature_columns, at.row_items(at.height), *size, *filtered, features)

    def reference(self, image: Array) -> None:
        """Take the picture that all others are compared with: uint8 (h, w, 4), sRGB."""
        self._features(image, self.reference_features)

    def compare(self, test: Array) -> None:
        """Start comparing `test`, uint8 (h, w, 4), sRGB; `mean` and `error_map` give what came out."""
        self._features(test, self.test_features)
        at = self.layout
        features = (self.test_features, self.reference_features)
        self.device.launch(
            "metrics/flip/difference",
            self.kernels.difference,
            at.items,
            *(at.width, at.height, at.stride, *features, self.largest, self.map, self.partial),
        )

    def mean(self) -> float:
        """The mean over the last compared picture, 0 (no difference) to 1."""
        return total(self.partial) / (self.layout.width * self.layout.height)

    def error_map(self) -> Floats:
        """The error of each pixel of the last compared picture, float32 (h, w), 0..1."""
        errors: Floats = self.layout.image(self.map)[0]
        return errors


def _separable(image: Doubles, along_x: Doubles, along_y: Doubles) -> Doubles:
    """Correlate (h, w) with two 1D filters; the border pixels are repeated."""
    for axis, taps in ((1, along_x), (0, along_y)):
        radius = len(taps) // 2
        pads = [(0, 0), (0, 0)]
        pads[axis] = (radius, radius)
        windows = np.lib.stride_tricks.sliding_window_view(np.pad(image, pads, "edge"), len(taps), axis)
        image = windows @ taps
    return image


def _features_twin(image: Bytes, filters: Filters) -> tuple[Doubles, Doubles, Doubles]:
    xyz = linear_values()[image[..., :3]] @ RGB_TO_RELATIVE.T
    x, y, z = np.moveaxis(xyz, -1, 0)
    share = filters.yellow_share
    luminance = _separable(y, filters.luminance, filters.luminance)
    red_green = _separable(x - y, filters.red_green, filters.red_green)
    yellow = share * _separable(y - z, filters.yellow_1, filters.yellow_1)
    yellow += (1 - share) * _separable(y - z, filters.yellow_2, filters.yellow_2)
    seen = np.stack([luminance + red_green, luminance, luminance - yellow], axis=-1)
    rgb = np.clip(seen @ np.linalg.inv(RGB_TO_RELATIVE).T, 0, 1)
    magnitudes = [
        np.hypot(_separable(y, taps, filters.smooth), _separable(y, filters.smooth, taps))
        for taps in (filters.edge, filters.point)
    ]
    edge, point = magnitudes
    return _hunt_lab(rgb @ RGB_TO_RELATIVE.T), edge, point


def flip_twin(test: Bytes, reference: Bytes, pixels_per_degree: float = PIXELS_PER_DEGREE) -> Doubles:
    """The FLIP error of each pixel, float64 (h, w), of two uint8 (h, w, 3 or 4) pictures."""
    filters = Filters.at(pixels_per_degree)
    lab_t, edge_t, point_t = _features_twin(test, filters)
    lab_r, edge_r, point_r = _features_twin(reference, filters)
    d = lab_t - lab_r
    colour = (np.abs(d[..., 0]) + np.hypot(d[..., 1], d[..., 2])) ** COLOUR_EXPONENT
    largest = largest_colour_difference()
    bend, value = COLOUR_BEND[0] * largest, COLOUR_BEND[1]
    high = value + (colour - bend) / (largest - bend) * (1 - value)
    colour_error = np.minimum(np.where(colour < bend, colour * value / bend, high), 1)
    feature = np.maximum(np.abs(edge_t - edge_r), np.abs(point_t - point_r)) / np.sqrt(2)
    error: Doubles = colour_error ** (1 - np.minimum(np.sqrt(feature), 1))
    return error


@cache
def _magma_table() -> Bytes:
    """The 256 colours of the map, uint8 (256, 3)."""
    import plotly.colors

    scale = plotly.colors.get_colorscale("Magma")
    stops = np.array([plotly.colors.hex_to_rgb(colour) for _, colour in scale], np.float64)
    positions = np.array([position for position, _ in scale])
    table = [np.interp(np.arange(256) / 255, positions, stops[:, k]) for k in range(3)]
    return np.rint(np.stack(table, axis=-1)).astype(np.uint8)


def magma(values: arrays.Array) -> Bytes:
    """FLIP's colours, black over violet and orange to pale yellow: uint8 (..., 3) of values 0..1."""
    return np.take(_magma_table(), (np.clip(values, 0, 1) * 255 + 0.5).astype(np.uint8), axis=0)
