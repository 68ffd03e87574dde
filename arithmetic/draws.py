"""Random numbers of NumPy's generator that are the same on every processor."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TypeAlias, overload

import numpy as np
from numpy.typing import ArrayLike

from shading_atlas_bench.arithmetic.arrays import Doubles
from shading_atlas_bench.arithmetic.functions import exp

# Where the ziggurats of NumPy's normal and exponential draws end. Inside, a draw is an integer times a number of a
# table; beyond, it is a logarithm of the C library, whose last bits depend on the processor.
NORMAL_END = 3.6541528853610088
EXPONENTIAL_END = 7.69711747013104972

Size: TypeAlias = int | Sequence[int]  # of an array of draws, as NumPy's functions take it


class Generator:
    """Those draws of NumPy's generator that are the same on every processor; normal, exponential and gamma ones stop at
    their ziggurat's end.

    One normal draw in 3,900 and one exponential draw in 2,200 are beyond it and become the end itself. Whether a draw
    is taken or drawn again hangs on the C library's exponential of 53 bits: once in 1e14 draws may processors differ.
    random, integers, choice, permutation: NumPy's own.
    """

    def __init__(self, seed: int | Sequence[int]) -> None:
        self._numpy = np.random.Generator(np.random.PCG64(seed))
        self.random, self.integers = self._numpy.random, self._numpy.integers
        self.choice, self.permutation = self._numpy.choice, self._numpy.permutation

    @overload
    def uniform(self, low: float, high: float) -> float: ...
    @overload
    def uniform(self, low: ArrayLike, high: ArrayLike, size: Size) -> Doubles: ...
    def uniform(self, low: ArrayLike, high: ArrayLike, size: Size | None = None) -> float | Doubles:
        """Like NumPy's, of shape `size`, a number without it. low, high: of any shapes that broadcast with it."""
        least, most = np.asarray(low, np.float64), np.asarray(high, np.float64)
        return least + (most - least) * self.random(size)

    @overload
    def normal(self, loc: float = 0.0, scale: float = 1.0) -> float: ...
    @overload
    def normal(self, loc: float, scale: float, size: Size) -> Doubles: ...
    @overload
    def normal(self, *, size: Size) -> Doubles: ...
    def normal(self, loc: float = 0.0, scale: float = 1.0, size: Size | None = None) -> float | Doubles:
        """Like NumPy's, of shape `size`, a number without it, but at most 3.654 deviations from its mean."""
        return loc + scale * np.clip(self._numpy.standard_normal(size), -NORMAL_END, NORMAL_END)

    def exponential(self, scale: float, size: Size) -> Doubles:
        """Like NumPy's, of shape `size`, but at most 7.697 times its mean."""
        return scale * np.clip(self._numpy.standard_exponential(size), None, EXPONENTIAL_END)

    def gamma(self, shape: float, scale: float, size: Size) -> Doubles:
        """Like NumPy's for a `shape` above 1, an array of shape `size`, but at most what the largest normal draw makes
        of it."""
        base = shape - 1 / 3
        cube = 1 + NORMAL_END / math.sqrt(9 * base)
        return scale * np.clip(self._numpy.standard_gamma(shape, size), None, base * (cube * cube * cube))

    def lognormal(self, mean: float, sigma: float, size: Size) -> Doubles:
        """The exponential of normal draws, of shape `size`."""
        return exp(self.normal(mean, sigma, size))


def generator(seed: int | Sequence[int]) -> Generator:
    """The generator that NumPy's default_rng makes of a seed."""
    return Generator(seed)
