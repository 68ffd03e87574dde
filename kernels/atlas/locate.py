"""Where in an atlas surface points lie, from their triangles' corners there."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic import arrays
from shading_atlas_bench.arithmetic.arrays import Doubles, Floats
from shading_atlas_bench.kernels.samples import WIDTH, Samples

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device


def locate(device: Device, samples: Samples, corners: Array, stage: str) -> Array:
    """float32 (2, room): column and row of each sample's surface point, where texel (0, 0) has its centre at (0, 0);
    NaN for triangles without a place.

    corners: float32 (n, 3, 2), column and row in the atlas of each triangle's corners, where texel (0, 0) has its
    centre at (0.5, 0.5), or float32 (n, 3, 3), column times w, row times w, and w, for perspective-correct lookups; NaN
    for a triangle without a place.
    """
    room = -(-samples.count // WIDTH) * WIDTH
    places = device.recycled((2, room), np.float32)
    if samples.count:
        kernel = device.build("atlas/locate.cl", CORNER=corners.shape[-1]).locate
        arrays = (samples.triangle, samples.bary1, samples.bary2, corners, places)
        device.launch(stage, kernel, -(-samples.count // 8), samples.count, room, *arrays)
    return places


def locate_twin(corners: Floats, triangle: arrays.Array, bary: arrays.Array) -> Doubles:
    """The same, float64 (n, 2). triangle: int (n). bary: (n, 2), weights of corners 1 and 2."""
    weights = np.concatenate([1 - bary.sum(axis=1, keepdims=True), bary], axis=1)
    place: Doubles = np.einsum("nk,nkc->nc", weights, corners[triangle].astype(np.float64))
    return (place[:, :2] / place[:, 2:] if place.shape[1] == 3 else place) - 0.5
