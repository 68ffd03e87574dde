"""The layout the metrics share: float planes with margins, worked on in pieces of 16 pixels; sums of partial sums."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Doubles, Floats
from shading_atlas_bench.kernels.constants import constants_of

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device

DEFINED = constants_of(Path(__file__).with_name("wide.cl"))
PIECE = DEFINED.whole("PIECE")
MARGIN = DEFINED.whole("MARGIN")
ROWS = DEFINED.whole("ROWS")


@dataclass(frozen=True)
class Layout:
    """A plane is float32 (height, stride): a margin of 16 pixels, the row, room up to a multiple of 32, a margin.

    Of 32, so that two whole pieces lie under each piece of a plane of half the size.
    """

    width: int
    height: int

    @property
    def pieces(self) -> int:
        """Pieces of 16 pixels in a row."""
        return -(-self.width // PIECE)

    @property
    def items(self) -> int:
        """Work-items of a kernel that handles one piece each."""
        return self.height * self.pieces

    def row_items(self, rows: int) -> int:
        """Work-items of a kernel that handles the pieces of ROWS rows each, for `rows` rows."""
        return -(-rows // ROWS) * self.pieces

    @property
    def stride(self) -> int:
        """Elements from one row to the next."""
        return -(-self.width // (2 * PIECE)) * 2 * PIECE + 2 * MARGIN

    def empty(self, device: Device, planes: int = 1) -> Array:
        """Uninitialised planes, float32 (planes, height, stride)."""
        return device.empty((planes, self.height, self.stride), np.float32)

    def image(self, planes: Array) -> Floats:
        """The pixels without margins, float32 (planes, height, width) on the host."""
        return planes.get()[:, :, MARGIN : MARGIN + self.width]


def padded_taps(taps: Doubles) -> Floats:
    """A filter's taps, float64 (n), between ROWS - 1 zeros on either side, float32, as `filtered_down` wants them."""
    return np.pad(taps, ROWS - 1).astype(np.float32)


def total(partial: Array) -> float:
    """The sum of partial sums, float32 (n), in float64."""
    return float(np.sum(partial.get(), dtype=np.float64))
