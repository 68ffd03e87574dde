"""Arithmetic whose results are the same on every processor: the ground that everything else may stand on.

NumPy's `@`, `einsum` and `linalg` sum in an order that depends on the processor, and its sin, exp or power, like those
of the C library, come in variants whose last bits differ. What is here is built from + - * / and square roots alone,
which IEEE 754 defines to the last bit and NumPy never fuses, in a fixed order; of float64, but for pictures of float32.

As well defined, and used as they are: comparisons, rounding, `%`, `frexp` and `ldexp`, casts, `np.cross`, `np.sum` and
`np.mean` (pairwise sums in C, eight at a time on every processor), `np.linalg.norm` along an axis (squares, such a sum
and a root), `np.interp`, `np.quantile`, sorting, `Generator.random` and `Generator.integers`.
"""
