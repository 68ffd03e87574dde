"""The equal-spacing triangle pattern and its L: which sample of a triangle lies in which cell.

A triangle has corners 0, 1, 2; a point of it has weights 1 - a - b, a, b. At level l its samples are the vertices of
the hardware tessellator's pattern with all factors l: rings around the centre, ring k with smallest weight 2k / 3l.
Three squares unfold it (Tessellated Shading Streaming, section 3.2), d = floor(l / 2):

    0 ─────── cut ─────── 1        corner 0 at (0, 0), corner 1 at (l, 0), corner 2 at (0, l)
    │ square 0  │ square 1 │       even l: neighbouring squares share a line of cells, and the cut between the
    │           │          │               squares of corners 1 and 2 has its line twice
    ├───────────┼──────────┘       odd l:  squares lie side by side, and the hand of corner 1 is one row thicker: a copy
    │ square 2  │                          of the line of square 2 that the cut runs along
    │           │
    2 ──────────┘
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from shading_atlas_bench.kernels.constants import constants_of

if TYPE_CHECKING:
    from shading_atlas_bench.arithmetic import arrays
    from shading_atlas_bench.arithmetic.arrays import Bools, Doubles, Ints, Longs

LEVELS = constants_of(Path(__file__).with_name("limits.cl")).whole("LEVELS")


def vertex_count(level: int) -> int:
    """Samples of the pattern: equation 1, v(l)."""
    half, odd = level // 2, level % 2
    return 3 * (half + 1) * (half + odd) + (1 - odd)


def triangle_count(level: int) -> int:
    """Triangles of the pattern: equation 2, t(l)."""
    half, odd = level // 2, level % 2
    return odd + 3 * (level + odd) * half


def cell_count(level: int) -> int:
    """Cells of the L: the samples and the copies along the cut, level // 2 of them (even) or one more (odd)."""
    return vertex_count(level) + (level + 1) // 2


@dataclass(frozen=True)
class Cells:
    """The cells of one level's L, by row and column: column, row int32 (n); weights of corners 1 and 2 float64 (n, 2);
    whether the cell is a copy, bool (n)."""

    column: Ints
    row: Ints
    weights: Doubles
    copy: Bools


@cache
def cells_of(level: int) -> Cells:
    """The L of a level from 1; level 0 is a single sample at the centre."""
    if level == 0:
        zero = np.zeros(1, np.int32)
        return Cells(zero, zero, np.full((1, 2), 1 / 3), np.zeros(1, bool))
    half, odd = level // 2, level % 2
    first, second = (k.reshape(-1) for k in np.meshgrid(np.arange(half + 1), np.arange(half + 1)))
    near, far = _weights(first, second, level)
    tip = 1 - near - far
    shared = half + odd  # columns and rows that a square has to itself
    one, two = first < shared, second < shared
    parts = [
        (first, second, near, far, first < 0),
        (level - first[one], second[one], tip[one], far[one], _on_cut(first, second, half, odd)[one]),
        (first[two], level - second[two], near[two], tip[two], first[two] < 0),
    ]
    if odd:
        line = first == half
        parts.append((level - second[line], level - first[line], near[line], tip[line], line[line]))
    column, row, a, b, copy = (np.concatenate(values) for values in zip(*parts, strict=True))
    order = np.lexsort((column, row))
    weights = np.stack([a, b], axis=1)[order]
    return Cells(column[order].astype(np.int32), row[order].astype(np.int32), weights, copy[order])


def _weights(first: Longs, second: Longs, level: int) -> tuple[Doubles, Doubles]:
    """Weights of the neighbouring corners that a square's columns and its rows lead to: equations 3 and 4, solved."""
    column, row = np.maximum(first, second), np.minimum(first, second)
    smallest, median = 2 * row / (3 * level), column / level - row / (3 * level)
    upper = first >= second
    return np.where(upper, median, smallest), np.where(upper, smallest, median)


def _on_cut(first: Longs, second: Longs, half: int, odd: int) -> Bools:
    """Cells of square 1 that square 2 has as well: its last row of an even level, but for the centre."""
    on_cut: Bools = (second == half) & (first < half) & (odd == 0)
    return on_cut


def locate_in_l_twin(weights: arrays.Array, level: NDArray[np.integer[Any]]) -> Doubles:
    """Column and row in the L, float64 (n, 2), of points with weights (n, 2) of corners 1 and 2: equation 4.

    level: int (n). On the cut between the squares of corners 1 and 2 an odd level goes to the thicker hand.
    """
    a, b = weights[:, 0], weights[:, 1]
    all_three = np.stack([1 - a - b, a, b])
    tip = all_three.argmax(axis=0)
    across, down = np.choose(tip, [a, all_three[0], a]), np.choose(tip, [b, b, all_three[0]])
    low, high = np.minimum(across, down), np.maximum(across, down)
    column, row = (high + low / 2) * level, low * 1.5 * level
    x, y = np.where(across >= down, column, row), np.where(across >= down, row, column)
    over = (tip == 2) & (across >= down) & (level % 2 == 1) & (x > level // 2 + SLACK)
    place = np.stack([np.where(tip == 1, level - x, x), np.where(tip == 2, level - y, y)], axis=1)
    place[over] = np.stack([level - y, level - x], axis=1)[over]
    return np.where(level[:, None] > 0, place, 0)


# Of a cell: rounding must not send a sample of the cut's line to its copy.
SLACK = constants_of(Path(__file__).with_name("locate.cl")).number("SLACK")
