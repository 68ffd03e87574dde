"""The twin of strip.cl: slots of a strip."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TypeAlias

import numpy as np

from shading_atlas_bench.arithmetic.functions import hypot
from shading_atlas_bench.packers.snakebinning.kernels.bins import UNIT

Lengths: TypeAlias = tuple[int, int, int]  # before and after the height's foot, and height, in 1/8 texel
ENLARGE = {"exact": 0, "paper": 1}


@dataclass(frozen=True)
class SlotShape:
    """What the slots of a strip have in common, by the names of its fields (see strip.cl)."""

    before8: int = 0
    after8: int = 0
    height8: int = 0
    inset: int = 0
    extent: int = 0
    lines: int = 0
    odd: int = 0
    period: int = 0
    texels: int = 0

    @classmethod
    def of(cls, strip: np.void) -> SlotShape:
        """That of a STRIP record."""
        return cls(*(int(strip[field.name]) for field in fields(cls)))

    @property
    def lengths(self) -> Lengths:
        """Of the largest triangle."""
        return self.before8, self.after8, self.height8


def needed_columns(tip: int, lengths: Lengths, inset: int, line: int, enlarge: str) -> tuple[int, int]:
    """First and last column of a line of a slot that a triangle needs, whose tip is above `tip`; see strip.cl.

    exact: texels less than one away, in both directions, from some point of the triangle. The nearest such point is on
    the line below, because the sides lean inwards. paper: inside the triangle with its sides half a texel further out.
    """
    before, after, height = lengths
    if enlarge == "exact" or height == 0:
        lean = max(line - 1, 0) / max(height, 1)
        first, last = (tip - before) / UNIT + before * lean, (tip + after) / UNIT - after * lean
        return inset + int(np.floor(first + 1e-9)), inset + int(np.ceil(last - 1e-9))
    first = (tip - before) / UNIT + before * line / height - 0.5 * hypot(1, before / height)
    last = (tip + after) / UNIT - after * line / height + 0.5 * hypot(1, after / height)
    return inset + int(np.ceil(first)), inset + int(np.floor(last))


def lines_of(height: int) -> int:
    """Lines of texels from the longest edge to the one at or above the tip."""
    return -(-height // UNIT) + 1


def slot_shape(before: int, after: int, height: int, enlarge: str = "exact") -> SlotShape:
    """What follows from a strip's largest triangle; a point, of lengths 0, has one texel."""
    after = max(after + -(before + after) % UNIT, UNIT - before) if height > 0 else 0
    lines = lines_of(height)
    lengths = (before, after, height)
    first, last = needed_columns(before, lengths, 0, 0, enlarge)
    columns = [needed_columns(before, lengths, -first, line, enlarge) for line in range(lines)]
    both = [(a, b) for a, b in zip(columns, columns[::-1], strict=True) if a[0] <= a[1] and b[0] <= b[1]]
    most = max([last - first - 1, *(a[1] + b[1] for a, b in both)])
    least = min([last - first, *(a[0] + b[0] for a, b in both)])
    widths = [max(0, end - start + 1) for start, end in columns]
    period = max(most + 2 - least, *widths)
    return SlotShape(*lengths, -first, last - first, lines, most + 1, period, sum(widths))


def row_width(shape: SlotShape, slots: int) -> int:
    """Columns of so many slots in a row."""
    return (slots - 1) // 2 * shape.period + (shape.extent if slots % 2 else shape.odd) + 1


def slots_in(shape: SlotShape, width: int) -> int:
    """Most slots in a row of this width."""
    slots = 0
    while row_width(shape, slots + 1) <= width:
        slots += 1
    return slots
