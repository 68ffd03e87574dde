"""Random numbers of NumPy's generator that are the same on every processor."""

from __future__ import annotations

import numpy as np

from shading_atlas_bench.arithmetic.functions import exp

# Where the ziggurats of NumPy's normal and exponential draws end. Inside, a draw is an integer times a number of a
# table; beyond, it is a logarithm of the C library, whose last bits depend on the processor.
NORMAL_END = 3.6541528853610088
EXPONENTIAL_END = 7.69711747013104972


class Generator(np.random.Generator):
    """NumPy's generator with the same draws, but normal, exponential and gamma ones stop at their ziggurat's end.

    One normal draw in 3,900 and one exponential draw in 2,200 are beyond it and become the end itself. Whether a draw
    is taken or drawn again hangs on the C library's exponential of 53 bits: once in 1e14 draws may processors differ.
    """

    def uniform(self, low=0.0, high=1.0, size=None):
        """Like NumPy's."""
        wide = np.subtract(high, low)
        return low + wide * self.random(np.shape(wide) if size is None and np.ndim(wide) else size)

    def standard_normal(self, size=None):
        """Like NumPy's, but at most 3.654 from 0."""
        return np.clip(super().standard_normal(size), -NORMAL_END, NORMAL_END)

    def normal(self, loc=0.0, scale=1.0, size=None):
        """Like NumPy's, but at most 3.654 deviations from its mean."""
        shape = np.broadcast_shapes(np.shape(loc), np.shape(scale)) or None
        return loc + scale * self.standard_normal(shape if size is None else size)

    def exponential(self, scale=1.0, size=None):
        """Like NumPy's, but at most 7.697 times its mean."""
        return scale * np.minimum(super().standard_exponential(size), EXPONENTIAL_END)

    def gamma(self, shape, scale=1.0, size=None):
        """Like NumPy's for a single shape above 1, but at most what the largest normal draw makes of it."""
        base = shape - 1 / 3
        cube = 1 + NORMAL_END / np.sqrt(9 * base)
        return scale * np.minimum(super().standard_gamma(shape, size), base * (cube * cube * cube))

    def lognormal(self, mean=0.0, sigma=1.0, size=None):
        """The exponential of a normal draw."""
        return exp(self.normal(mean, sigma, size))


def generator(seed: int | list[int]) -> Generator:
    """The generator that NumPy's default_rng makes of a seed."""
    return Generator(np.random.PCG64(seed))
