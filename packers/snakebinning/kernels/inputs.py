"""Used bins of SnakeBinning."""

import numpy as np

from shading_atlas_bench.packers.snakebinning.kernels.bins import HEIGHTS, bin_of


def crowd(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Used bins and their triangles: a cloud in bin space, as of a scene."""
    bins = bin_of(rng.integers(0, 30, count), rng.integers(0, 30, count), rng.integers(0, HEIGHTS, count) ** 2 // 1500)
    used = np.unique(bins)
    return used, np.maximum(1, rng.geometric(0.06, len(used)) - 10)
