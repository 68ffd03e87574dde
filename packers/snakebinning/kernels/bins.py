"""The bin space of SnakeBinning (section 3.2): angles alpha and beta next to the longest edge, and the height on it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.functions import log2, power, tan
from shading_atlas_bench.kernels.constants import constants_of

if TYPE_CHECKING:
    from shading_atlas_bench.arithmetic.arrays import Array, Floats, Ints

DEFINED = constants_of(Path(__file__).with_name("bins.cl"))
ANGLES = DEFINED.whole("ANGLES")  # bins of alpha, 15 to 90 degrees, and of beta, 0 to 60 degrees
HEIGHTS = DEFINED.whole("HEIGHTS")
COLUMN = DEFINED.whole("COLUMN")  # heights padded to whole words of 32 bins
BINS = DEFINED.whole("BINS")
POINTS = DEFINED.whole("POINTS")  # bin of the triangles that are drawn as one texel: the padding after the first column
SHORTEST = 1.0  # texels: a strip has at least two rows of texels, so lower triangles are drawn this high
UNIT = constants_of(Path(__file__).with_name("footprint.cl")).whole("UNIT")  # lengths are stored in 1/8 texel
LARGEST_ATLAS = 8192  # texels per side: the largest position is (8192 - 1) * 8, which 16 bits hold

ALPHA_EDGES = 15 + 2.5 * np.arange(ANGLES + 1)  # degrees
BETA_EDGES = 2.0 * np.arange(ANGLES + 1)


def edge_table() -> Floats:
    """float32 (64): cotangents of the lower edges of bins 1 to 29, of alpha and from 32 on of beta."""
    table = np.zeros(64, np.float32)
    table[:29] = 1 / tan(np.radians(ALPHA_EDGES[1:-1]))
    table[32:61] = 1 / tan(np.radians(BETA_EDGES[1:-1]))
    return table


@dataclass(frozen=True)
class HeightBins:
    """Heights from SHORTEST to `highest` texels in HEIGHTS bins, with edges spaced logarithmically or linearly.

    A bin holds heights up to its upper edge; the first holds those of SHORTEST, which is what lower ones are drawn as.
    That of POINTS is 0.
    """

    highest: float
    logarithmic: bool = True

    @property
    def scale(self) -> float:
        """Bins per doubling of the height, or per texel."""
        span = log2(self.highest / SHORTEST) if self.logarithmic else self.highest - SHORTEST
        return float(np.float32((HEIGHTS - 1) / max(float(span), 1e-3)))

    def tops(self) -> Ints:
        """int32 (COLUMN): upper edge of each bin in 1/8 texel, rounded up, at most `highest`."""
        steps = np.arange(COLUMN) / self.scale
        edges = SHORTEST * power(2.0, steps) if self.logarithmic else SHORTEST + steps
        edges[POINTS] = 0
        tops: Ints = np.ceil(np.minimum(edges, self.highest) * UNIT - 1e-9).astype(np.int32)
        return tops


def bin_of(alpha: Array | int, beta: Array | int, height: Array | int) -> Array:
    """Numbers of bins from their indices alpha, beta and height, int of any shapes that broadcast."""
    bins: Array = (np.asarray(alpha) * ANGLES + beta) * COLUMN + height
    return bins


def indices_of(bins: Array | int) -> tuple[Array, Array, Array]:
    """Indices (alpha, beta, height) of bins, int of any shape."""
    column, height = np.divmod(np.asarray(bins), COLUMN)
    alpha, beta = np.divmod(column, ANGLES)
    return alpha, beta, height
