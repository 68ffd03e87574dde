"""Which bins are used, by how many triangles, and how wide these are."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.kernels.common.scan import exclusive_scan
from shading_atlas_bench.packers.snakebinning.kernels.bins import BINS

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic import arrays
    from shading_atlas_bench.arithmetic.arrays import Longs
    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.packers.snakebinning.kernels.pieces import TriangleList

HERE = Path(__file__).parent

STAGE = "structs/bins"
MAP_WORDS = BINS // 32


@dataclass(frozen=True)
class UsedBins:
    """The bins that have triangles, on the device.

    numbers: int32, ascending, of which the first `count` mean something. triangles: int32 (BINS), how many each bin
    has. widest: int32 (BINS, 2), the longest of their lengths before and after the height's foot, in 1/8 texel.
    """

    numbers: Array
    count: int
    triangles: Array
    widest: Array


class BinCounts:
    """Counts triangles by their bins. used: the bins of the last count."""

    def __init__(self, device: Device) -> None:
        self.device, self.kernels = device, device.build(HERE / "count.cl")
        triangles, widest = device.zeros(BINS, np.int32), device.zeros((BINS, 2), np.int32)
        self.bits = device.zeros(MAP_WORDS, np.uint32)
        self.used = UsedBins(device.empty(0, np.int32), 0, triangles, widest)

    def count(self, listed: TriangleList, bins: Array, lengths: Array) -> UsedBins:
        """The bins of the triangles listed, whose bins are int32 (T) and lengths uint16 (T, 4), and of no others."""
        launch, kernels, last, number = self.device.launch, self.kernels, self.used, listed.count
        tables = (last.triangles, last.widest, self.bits)
        launch(STAGE, kernels.forget_bins, last.count, last.count, last.numbers, *tables)
        launch(STAGE, kernels.count_bins, number, number, listed.ids, bins, lengths, *tables)
        ones = self.device.recycled(MAP_WORDS, np.int32)
        launch(STAGE, kernels.count_bits, MAP_WORDS, MAP_WORDS, self.bits, ones)
        offsets, used = exclusive_scan(self.device, ones, MAP_WORDS, STAGE)
        numbers = self.device.recycled(used, np.int32)
        launch(STAGE, kernels.list_bits, MAP_WORDS, MAP_WORDS, self.bits, offsets, numbers)
        self.used = UsedBins(numbers, used, last.triangles, last.widest)
        return self.used


def count_bins_twin(bins: arrays.Array, lengths: arrays.Array) -> tuple[arrays.Array, arrays.Array, Longs]:
    """Used bins, int (k), ascending, their triangles, int (k), and widest lengths, int64 (k, 2), for the bins, int (n),
    and lengths, int (n, 4), of n triangles."""
    used, which, counts = np.unique(bins, return_inverse=True, return_counts=True)
    widest = np.zeros((len(used), 2), np.int64)
    np.maximum.at(widest, which, lengths[:, :2])
    return used, counts, widest
