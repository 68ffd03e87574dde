"""Decoding of location words: the atlas position of each triangle's corners."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.packers.sas.kernels.layout import POINTS, corner_points, unpack_location

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic.arrays import Bytes, Doubles, Ints, Words
    from shading_atlas_bench.kernels.device import Device

HERE = Path(__file__).parent

# u, v of the corners 0, 1, 2 of a triangle with each code.
CODE_POINTS = POINTS[corner_points(np.arange(15))].astype(np.float32)


def locate_corners(device: Device, patches: Array, codes: Array, count: int, words: Array, stage: str) -> Array:
    """Atlas position, in texels, of the corners of triangles: float32 (count, 3, 2) of column and row.

    patches: int32 (count), each triangle's patch. codes: uint8 (count), its role and rotation. words: uint32 (P),
    locations. Corners lie at the centres of a block's outermost texels; NaN where the patch has no block.
    """
    corners = device.empty((count, 3, 2), np.float32)
    points = device.upload(CODE_POINTS)
    kernel = device.build(HERE / "corners.cl").locate_corners
    device.launch(stage, kernel, count, count, patches, codes, words, points, corners)
    return corners


def locate_corners_twin(patches: Ints, codes: Bytes, words: Words) -> Doubles:
    """The same on the host, float64."""
    x, y, w, h = unpack_location(words[patches])
    first = np.stack([x, y], axis=1) + 0.5
    steps = np.stack([1 << w, 1 << h], axis=1) - 1
    corners: Doubles = first[:, None] + steps[:, None] * POINTS[corner_points(codes)]
    corners[words[patches] == 0] = np.nan
    return corners
