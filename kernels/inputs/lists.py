"""Fragments listed pixel by pixel."""

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Longs, Words


def random_rows(
    rng: np.random.Generator, width: int = 24, height: int = 16, most: int = 6, words: int = 2
) -> tuple[Longs, Words]:
    """Offsets, int64 (width * height + 1), and rows, uint32 (n, words): a colour, a depth and what else there is room
    for, nearest first; a fifth of them opaque."""
    counts = rng.integers(0, most, width * height) * (rng.random(width * height) < 0.7)
    pixel = np.repeat(np.arange(len(counts)), counts)
    depth = rng.uniform(0.01, 0.2, len(pixel)).astype(np.float32)
    depth = depth[np.lexsort((-depth, pixel))]
    rows = rng.integers(0, 2**32, (len(pixel), words), dtype=np.uint64).astype(np.uint32)
    rows[:, 1] = depth.view(np.uint32)
    rows[:, 0] |= 1 << 24
    rows[rng.random(len(rows)) < 0.2, 0] |= 255 << 24
    return np.concatenate([[0], np.cumsum(counts)]), rows
