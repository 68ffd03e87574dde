"""Square cells in rows: the side that a triangle asks for, and where its cell lies. Server and client both use it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Bools, Doubles, Ints

LEVELS = 7  # cells of 1, 2, 4 .. 64 texels a side


@dataclass(frozen=True)
class Cells:
    """A square cell of the atlas for each triangle: int32 (n) each.

    levels: of their sides, the logarithm to base 2. columns, rows: of their first texels.
    """

    levels: Ints
    columns: Ints
    rows: Ints

    @property
    def sides(self) -> Ints:
        """In texels."""
        return np.left_shift(np.int32(1), self.levels)

    def inside(self, height: int) -> Bools:
        """Which of them lie wholly in an atlas `height` texels high: bool (n)."""
        return self.rows + self.sides <= height

    def only(self, chosen: Bools) -> Cells:
        """Those that are chosen."""
        return Cells(self.levels[chosen], self.columns[chosen], self.rows[chosen])


def wanted_levels(pixels: Doubles, largest: int) -> Ints:
    """The levels of the smallest cells that are as long as triangles' longest edges, int32 (n).

    pixels: float64 (n), lengths of the longest edges. largest: texels that no side may exceed.
    """
    sides = np.left_shift(1, np.arange(LEVELS))
    highest = np.searchsorted(sides, largest, side="right") - 1
    return np.minimum(np.searchsorted(sides, pixels), highest).astype(np.int32)


def place_cells(levels: Ints, width: int) -> Cells:
    """Cells of these levels in an atlas `width` texels wide: the largest on top, those of one size in their order."""
    columns, rows, top = np.zeros_like(levels), np.zeros_like(levels), 0
    for level in reversed(range(LEVELS)):
        chosen = np.flatnonzero(levels == level)
        side, across = 1 << level, max(1, width >> level)
        number = np.arange(len(chosen))
        columns[chosen], rows[chosen] = number % across * side, top + number // across * side
        top += -(-len(chosen) // across) * side
    return Cells(levels, columns, rows)
