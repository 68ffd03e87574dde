"""Decoding of places: homogeneous atlas positions of each triangle's corners."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic import arrays
    from shading_atlas_bench.arithmetic.arrays import Doubles
    from shading_atlas_bench.kernels.device import Device

HERE = Path(__file__).parent


def locate_corners(device: Device, places: Array, drawn: Array, words: Array, count: int, stage: str) -> Array:
    """Column times w, row times w, and w of triangles' corners: float32 (count, 3, 3); NaN for one without a place.

    places uint32, drawn uint16 (.., 4) and words uint32: as in Places and Footprints. A surface point lies where the
    sum of the corners, weighted with its barycentrics, is after division by its w.
    """
    corners = device.empty((count, 3, 3), np.float32)
    kernel = device.build(HERE / "corners.cl").locate_corners
    device.launch(stage, kernel, count, count, places, drawn, words, corners)
    return corners


def locate_corners_twin(places: arrays.Array, drawn: arrays.Array, words: arrays.Array) -> Doubles:
    """The same on the host, float64."""
    sign = np.where(places >> 29 & 1, -1, 1) / 8
    tip, line = (places & 0xFFFF) / 8 + 0.5, (places >> 16 & 0x1FFF) + 0.5
    before, after, height = drawn[:, :3].astype(np.float64).T
    a, turned = (words >> 24 & 3).astype(int), (words >> 26 & 1).astype(int)
    b, c = (a + 1 + turned) % 3, (a + 2 - turned) % 3
    corners = np.empty((len(places), 3, 3))
    rows = np.arange(len(places))
    corners[rows, a, 0], corners[rows, a, 1] = tip - sign * before, line
    corners[rows, b, 0], corners[rows, b, 1] = tip + sign * after, line
    corners[rows, c, 0], corners[rows, c, 1] = tip, line + sign * height
    w = 255 / np.maximum(np.stack([words >> shift & 255 for shift in (0, 8, 16)], axis=1), 1)
    corners[..., :2] *= w[..., None]
    corners[..., 2] = w
    corners[places == 0] = np.nan
    return corners
