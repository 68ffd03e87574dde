"""Atlases with texels that nothing owns."""

from __future__ import annotations

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Bytes


def random_atlas(rng: np.random.Generator, height: int, width: int, owned: float) -> Bytes:
    """Random colours, uint8 (h, w, 4); squares of texels owned or not, garbage in those that are not."""
    cells = rng.random((-(-height // 4), -(-width // 4))) < owned
    alpha = cells.repeat(4, axis=0).repeat(4, axis=1)[:height, :width] * 255
    colours = rng.integers(0, 256, (height, width, 3))
    return np.concatenate([colours, alpha[..., None]], axis=2).astype(np.uint8)
