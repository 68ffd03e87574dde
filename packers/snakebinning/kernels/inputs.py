"""Used bins of SnakeBinning."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.packers.snakebinning.kernels.bins import BINS, HEIGHTS, bin_of
from shading_atlas_bench.packers.snakebinning.kernels.count import UsedBins

if TYPE_CHECKING:
    from shading_atlas_bench.arithmetic import arrays
    from shading_atlas_bench.arithmetic.arrays import Longs
    from shading_atlas_bench.kernels.device import Device


def crowd(rng: np.random.Generator, count: int) -> tuple[arrays.Array, Longs]:
    """Used bins, int (k), ascending, and their triangles, int64 (k): a cloud in bin space, as of a scene."""
    bins = bin_of(rng.integers(0, 30, count), rng.integers(0, 30, count), rng.integers(0, HEIGHTS, count) ** 2 // 1500)
    used = np.unique(bins)
    return used, np.maximum(1, rng.geometric(0.06, len(used)) - 10)


def table_of(used: arrays.Array, values: arrays.Array) -> arrays.Array:
    """int32 (BINS, ...): the values of the used bins, (k, ...), and zeros for the others."""
    table = np.zeros((BINS, *values.shape[1:]), np.int32)
    table[used] = values
    return table


def upload_bins(device: Device, used: arrays.Array, counts: arrays.Array, widest: arrays.Array) -> UsedBins:
    """Used bins, int (k), with their triangles, int (k), and widest lengths, int (k, 2)."""
    tables = (device.upload(table_of(used, values)) for values in (counts, widest))
    return UsedBins(device.upload(used.astype(np.int32)), len(used), *tables)
