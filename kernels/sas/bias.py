"""The allocation bias: how much smaller than they appear blocks must be for a frame's request to fit."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kernels.sas.footprint import KINDS, SIZES, STEPS

if TYPE_CHECKING:
    from pyopencl.array import Array

    from kernels.device import Device

STAGE = "structs/bias"


def needed_superblocks(device: Device, histogram: Array, top: int) -> np.ndarray:
    """Superblocks that all patches of `histogram` need at each bias of 0, 1/8, 2/8 ... 128/8: int64 (129).

    histogram: int32 (3, 128, 128) as from `measure_sides`, summed in place. top: log2 of a superblock's side. A
    superblock serves blocks of one size; a side of s steps becomes level clamp(ceil((s - bias) / 8), 0, top). Each
    triangle of a patch keeps a texel of its own, but at the last bias, where every block is one texel.
    """
    kernels = device.build("sas/bias.cl")
    device.launch(STAGE, kernels.sum_rows, KINDS * SIZES, histogram)
    device.launch(STAGE, kernels.sum_columns, KINDS * SIZES, histogram)
    needed = device.empty(SIZES + 1, np.int32)
    device.launch(STAGE, kernels.needed_superblocks, SIZES + 1, histogram, top, needed)
    return needed.get().astype(np.int64)


def needed_superblocks_twin(histogram: np.ndarray, top: int) -> np.ndarray:
    """The same on the host, from a histogram that is not summed."""
    needed = []
    more, height, width = np.nonzero(histogram)
    for bias in range(SIZES + 1):
        w, h = levels_of(width | height << 8 | more << 16, bias, top)
        blocks = np.bincount(h * (top + 1) + w, histogram[more, height, width], (top + 1) ** 2)
        level = np.arange(top + 1)
        room = 2.0 ** (2 * top - (level[:, None] + level).reshape(-1))
        needed.append(np.ceil(blocks / room).sum())
    return np.array(needed, np.int64)


def levels_of(sizes: np.ndarray, bias: int, top: int) -> tuple[np.ndarray, np.ndarray]:
    """Levels of the sides, across and down, of blocks for `sizes` as from `measure_sides`, at a bias in eighths.

    Each of a patch's triangles owns a texel: two need two texels, three have two rows of two. At a bias of 128 every
    block is one texel.
    """
    w, h = (np.clip(-((bias - (sizes >> shift & 0xFF)) // STEPS), 0, top) for shift in (0, 8))
    more, least = (sizes >> 16) * (bias < SIZES), min(1, top)
    wide = (more == 2) | ((more == 1) & (h == 0))
    return np.where(wide, np.maximum(w, least), w), np.where(more == 2, np.maximum(h, least), h)
