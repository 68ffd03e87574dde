"""Bins: slots of equal size, each for two primitives that nest when one of them is turned by 180 degrees.

    L of level l           slot 2 (d + 1) x (3 d + 2), for odd l (3 d + 4), d = floor(l / 2)
    right triangle p x q   slot (p + 3) x (q + 3); p and q are rounded up to sizes 1 to 16, then 8 per doubling
    single texel           slot 2 x 1

All bins there can be, by falling height of their slots, are known beforehand; a frame only counts their items.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.kernels.constants import constants_of
from shading_atlas_bench.packers.tss.kernels.pattern import LEVELS

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic.arrays import Ints
    from shading_atlas_bench.kernels.device import Device

DEFINED = constants_of(Path(__file__).with_name("limits.cl"))
# Texels along a side of a right triangle, but for the last one.
LONGEST = DEFINED.whole("LONGEST")
EXACT = 16  # sizes up to this one have a class each
PER_DOUBLING = 8


def size_classes() -> tuple[Ints, Ints]:
    """The class of each size 0 to LONGEST, int32 (LONGEST + 1), and the largest size of each class, int32 (C)."""
    largest = list(range(1, EXACT + 1))
    while largest[-1] < LONGEST:
        step = (1 << (int(largest[-1]).bit_length() - 1)) // PER_DOUBLING
        largest.append(min(largest[-1] + step, LONGEST))
    return np.searchsorted(largest, np.arange(LONGEST + 1)).astype(np.int32), np.array(largest, np.int32)


@dataclass(frozen=True)
class Bins:
    """width, height: int32 (B), of a bin's slots. of_level: int32 (65), bin by level, 0 for a single texel.

    of_size: int32 (C, C), bin by class of q and of p, for p >= q. size_class: int32 (1024).
    """

    width: Ints
    height: Ints
    of_level: Ints
    of_size: Ints
    size_class: Ints

    @classmethod
    def make(cls) -> Bins:
        """All bins, sorted by height, then width, both falling."""
        size_class, largest = size_classes()
        half = np.arange(LEVELS + 1) // 2
        odd = np.arange(LEVELS + 1) % 2
        q, p = np.nonzero(np.tri(len(largest), dtype=bool).T)
        width = np.concatenate([2 * (half + 1), largest[p] + 3])
        height = np.concatenate([3 * half + 2 + 2 * odd, largest[q] + 3])
        width[0], height[0] = 2, 1
        order = np.lexsort((-width, -height))
        bin_of = np.argsort(order).astype(np.int32)
        of_size = np.full((len(largest), len(largest)), -1, np.int32)
        of_size[q, p] = bin_of[LEVELS + 1 :]
        sizes = (width[order].astype(np.int32), height[order].astype(np.int32))
        return cls(*sizes, bin_of[: LEVELS + 1], of_size, size_class)

    @property
    def count(self) -> int:
        """How many bins there are, B."""
        return len(self.width)

    def upload(self, device: Device) -> BinTables:
        """The same on the device."""
        width, height = device.upload(self.width), device.upload(self.height)
        of_level, of_size = device.upload(self.of_level), device.upload(self.of_size)
        return BinTables(width, height, of_level, of_size, device.upload(self.size_class), len(self.of_size))


@dataclass(frozen=True)
class BinTables:
    """Bins on the device, arrays as in Bins; size_classes: how many there are, C."""

    width: Array
    height: Array
    of_level: Array
    of_size: Array
    size_class: Array
    size_classes: int
