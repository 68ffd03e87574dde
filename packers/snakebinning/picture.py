"""A picture of the packing: superblocks, strips in them, and the triangles in their slots."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from shading_atlas_bench.arithmetic.arrays import Bytes, Ints


def draw_packing(strips: NDArray[np.void], blocks: NDArray[np.void], owner: Ints) -> Bytes:
    """uint8 (H, W, 3): superblocks in dark colours, strips in a lighter shade, samples in one of their triangle's.

    strips, blocks: STRIP and SUPERBLOCK records. owner: int (H, W), triangle per texel or -1.
    """
    picture = np.zeros((*owner.shape, 3), np.uint8)
    hues = np.array(
        [[(40 + 97 * k) % 130, (90 + 61 * k) % 130, (20 + 37 * k) % 130] for k in range(max(1, len(blocks)))]
    )
    for block, hue in zip(blocks, hues, strict=False):
        picture[block["y"] : block["y"] + block["height"], block["x"] : block["x"] + block["width"]] = hue // 2
    for strip in strips[strips["superblock"] >= 0]:
        block = blocks[strip["superblock"]]
        top = block["y"] + strip["y"]
        lines = slice(top, top + strip["rows"] * strip["lines"])
        picture[lines, block["x"] : block["x"] + block["width"]] = hues[strip["superblock"]] + strip["bin"] * 7 % 30
    picture += np.where(owner < 0, 0, 40 + 50 * (owner & 1)).astype(np.uint8)[..., None]
    return picture
