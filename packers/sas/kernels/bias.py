"""The allocation bias: how much smaller than they appear blocks must be for a frame's request to fit."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from shading_atlas_bench.packers.sas.kernels.footprint import SIZES, STEPS

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic.arrays import Ints, Longs
    from shading_atlas_bench.kernels.device import Device

HERE = Path(__file__).parent

STAGE = "structs/bias"


@dataclass(frozen=True)
class Request:
    """How large the blocks are that visible patches ask for.

    sizes: int32 (n), of their sides without a bias, as from `measure_sides`. bias: in eighths.
    """

    sizes: Array
    bias: int


def needed_superblocks(device: Device, histogram: Array, top: int) -> Longs:
    """Superblocks that all patches of `histogram` need at each bias of 0, 1/8, 2/8 ... 127/8: int64 (128).

    histogram: int32 (128, 128) as from `measure_sides`, summed in place. top: log2 of a superblock's side. A superblock
    serves blocks of one size; a side of s steps becomes level clamp(ceil((s - bias) / 8), 0, top).
    """
    kernels = device.build(HERE / "bias.cl")
    device.launch(STAGE, kernels.sum_rows, SIZES, histogram)
    device.launch(STAGE, kernels.sum_columns, SIZES, histogram)
    needed = device.empty(SIZES, np.int32)
    device.launch(STAGE, kernels.needed_superblocks, SIZES, histogram, top, needed)
    superblocks: Longs = needed.get().astype(np.int64)
    return superblocks


def needed_superblocks_twin(histogram: Ints, top: int) -> Longs:
    """The same on the host, from a histogram that is not summed."""
    needed = []
    height, width = np.nonzero(histogram)
    for bias in range(SIZES):
        w, h = levels_at(width, bias, top), levels_at(height, bias, top)
        blocks = np.bincount(h * (top + 1) + w, histogram[height, width], (top + 1) ** 2)
        level = np.arange(top + 1)
        room = 2.0 ** (2 * top - (level[:, None] + level).reshape(-1))
        needed.append(np.ceil(blocks / room).sum())
    return np.array(needed, np.int64)


def levels_at(steps: NDArray[np.integer[Any]], bias: int, top: int) -> NDArray[np.integer[Any]]:
    """Levels of sides of `steps` eighths, int of any shape, at a bias of `bias` eighths."""
    levels: NDArray[np.integer[Any]] = np.clip(-((bias - steps) // STEPS), 0, top)
    return levels
