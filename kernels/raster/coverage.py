"""Which pixels a record covers, in exact integers: what coverage.cl computes 8 pixels at a time."""

from __future__ import annotations

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Array, Bools
from shading_atlas_bench.kernels.raster.camera import SUBPIXELS


def covers_twin(corners: Array, columns: Array, rows: Array) -> Bools:
    """Whether pixel centres lie inside a triangle or on one of its top or left edges.

    corners: int (3, 2), x and y in sub-pixels, clockwise on screen. columns, rows: pixels, of any shapes that
    broadcast, which is the result's shape.
    """
    corners = np.asarray(corners, np.int64)
    x, y = (np.asarray(pixels, np.int64) * SUBPIXELS + SUBPIXELS // 2 for pixels in (columns, rows))
    inside = np.ones(np.broadcast(x, y).shape, bool)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        along_x, along_y = a[1] - b[1], b[0] - a[0]
        owned = along_x > 0 or (along_x == 0 and along_y > 0)
        inside &= along_x * (x - a[0]) + along_y * (y - a[1]) >= (0 if owned else 1)
    return inside
