"""A picture of the allocation: which block lies where, coloured by its size."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.packers.sas.kernels.allocate import SuperblockGrid
from shading_atlas_bench.packers.sas.kernels.layout import unpack_location

if TYPE_CHECKING:
    from shading_atlas_bench.arithmetic.arrays import Bytes, Words


def draw_allocation(grid: SuperblockGrid, words: Words) -> Bytes:
    """Blocks of location words as uint8 (H, W, 3), black where no block lies.

    Red grows with the logarithm of a block's width, green with that of its height; blue changes from block to block, so
    that neighbours can be told apart.
    """
    side = 1 << grid.top
    picture = np.zeros((grid.rows * side, grid.columns * side, 3), np.uint8)
    x, y, w, h = unpack_location(words[words > 0])
    scale = 175 / max(grid.top, 1)
    for k, (left, upper, width, height) in enumerate(zip(x, y, w, h, strict=True)):
        colour = (80 + scale * width, 80 + scale * height, 60 + k * 89 % 180)
        picture[upper : upper + (1 << height), left : left + (1 << width)] = colour
    return picture
