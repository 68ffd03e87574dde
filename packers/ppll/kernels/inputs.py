"""Lists of fragments."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.kernels.inputs.lists import random_rows
from shading_atlas_bench.kernels.inputs.soups import perspective
from shading_atlas_bench.packers.ppll.kernels.lists import Lists

if TYPE_CHECKING:
    from shading_atlas_bench.kernels.device import Device

SIZE = (24, 16)
PROJECTION = perspective(80, SIZE[0] / SIZE[1])


def normal_lists(
    device: Device, rng: np.random.Generator, most: int = 6, near: float = 1.0, size: tuple[int, int] = SIZE
) -> Lists:
    """Lists of fragments that lie in their pixels; a fifth of the distances occurs twice."""
    pixels = size[0] * size[1]
    counts = rng.integers(0, most, pixels) * (rng.random(pixels) < 0.8)
    pixel = np.repeat(np.arange(pixels), counts)
    distance = near + rng.integers(0, 40, len(pixel)).astype(np.float32) / 16
    distance = distance[np.lexsort((distance, pixel))]
    tangent = 1 / PROJECTION[0, 0] / (size[0] / 2)
    x = (pixel % size[0] + rng.uniform(0.1, 0.9, len(pixel)) - size[0] / 2) * tangent * distance
    y = (size[1] / 2 - pixel // size[0] - rng.uniform(0.1, 0.9, len(pixel))) * tangent * distance
    rows = np.zeros((len(pixel), 5), np.uint32)
    rows[:, 0] = rng.integers(0, 1 << 8, len(pixel)) | 200 << 24
    rows[:, 1] = np.arange(len(pixel))  # a name, to tell fragments apart
    rows[:, 2:] = np.stack([x, y, distance], axis=1).astype(np.float32).view(np.uint32)
    return Lists.upload(device, *size, np.concatenate([[0], np.cumsum(counts)]), rows)


def random_lists(
    device: Device, rng: np.random.Generator, width: int = 24, height: int = 16, most: int = 6, words: int = 2
) -> Lists:
    """Lists of colours and depths, a fifth of them opaque."""
    offsets, rows = random_rows(rng, width, height, most, words)
    return Lists.upload(device, width, height, offsets, rows)
