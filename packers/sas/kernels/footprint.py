"""How many pixels the sides of a patch's rectangle subtend, from the server's eye."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.kernels.constants import constants_of

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic import arrays
    from shading_atlas_bench.arithmetic.arrays import Doubles, Floats, Ints
    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.packers.sas.kernels.visible import VisiblePatches

HERE = Path(__file__).parent

DEFINED = constants_of(HERE / "sizes.cl")
STEPS = DEFINED.whole("STEPS")  # per doubling of the size
SIZES = DEFINED.whole("SIZES")  # sizes 2^0 to 2^(127/8), 60 000 pixels


def measure_sides(
    device: Device, visible: VisiblePatches, points: Array, positions: Array, eye: Doubles, pixels_per_radian: float
) -> tuple[Array, Array]:
    """Sizes of the rectangles of visible patches and their histogram.

    points: int32 (P, 5), vertices at (0,0), (1,0), (1,1), (0,1) and the apex, -1 for none. positions: float32 (V, 3).
    eye: float64 (3).
    Returns sizes int32 (n), ceil(8 log2(pixels)) of width | of height << 8, and histogram int32 (128, 128) of
    their number by height and width. The width is the longer of the opposite sides (the one with the apex as the sum of
    its parts), the height likewise, in a fan at least the way from the apex to the middle of the opposite side. Pairs
    and fans are made a step larger than nothing where, without a bias, a triangle of theirs would own no texel: pairs
    have two texels at least, fans two columns, of two rows where there are no more columns.
    """
    kernels = device.build(HERE / "footprint.cl")
    sizes = device.empty(visible.count, np.int32)
    histogram = device.empty((SIZES, SIZES), np.int32)
    device.fill(histogram, 0, "structs/footprint")
    high = eye.astype(np.float32)
    low = (eye - high).astype(np.float32)
    seen_from = [*map(float, high), *map(float, low), float(pixels_per_radian)]
    items, read = -(-visible.count // 8), (visible.patches, points, positions)
    device.launch("structs/footprint", kernels.measure_sides, items, visible.count, *read, *seen_from, sizes, histogram)
    return sizes, histogram


def measure_sides_twin(
    patches: Ints, points: Ints, positions: Floats, eye: Doubles, pixels_per_radian: float
) -> Doubles:
    """Unrounded logarithms to base 2 of width and height in pixels, float64 (n, 2); those below one pixel are 0.

    patches: int32 (n), the visible ones. points, positions, eye: as for `measure_sides`.

    Where a pair or a fan needs a step for the texels of its triangles, it is exactly one, 1 / STEPS.
    """
    vertex = points[patches]
    p = positions[vertex].astype(np.float64) - eye
    a, b, c, d, apex = p.transpose(1, 0, 2)
    quad, fan = vertex[:, 2] >= 0, vertex[:, 4] >= 0

    def angle(start: arrays.Array, end: arrays.Array) -> Doubles:
        sine, cosine = np.linalg.norm(np.cross(start, end), axis=1), (start * end).sum(axis=1)
        angles: Doubles = np.arctan2(sine, cosine)
        return angles

    width = np.where(fan, angle(a, apex) + angle(apex, b), angle(a, b))
    width = np.where(quad, np.maximum(width, angle(d, c)), width)
    height = np.where(quad, np.maximum(angle(a, d), angle(b, c)), angle(a, d))
    height = np.where(fan, np.maximum(height, angle(apex, (c + d) / 2)), height)
    width, height = (np.log2(np.maximum(pixels_per_radian * side, 1)) for side in (width, height))
    width = np.where(quad & (fan | (height == 0)), np.maximum(width, 1 / STEPS), width)
    height = np.where(fan & (width <= 1), np.maximum(height, 1 / STEPS), height)
    return np.stack([width, height], axis=1)
