"""Which bins are used, by how many triangles, and how wide these are."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.kernels.common.scan import exclusive_scan
from shading_atlas_bench.packers.snakebinning.kernels.bins import BINS

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device

HERE = Path(__file__).parent

STAGE = "structs/bins"
MAP_WORDS = BINS // 32


class BinCounts:
    """Triangles per bin, int32 (BINS), and the longest of their lengths before and after the foot, int32 (BINS, 2).

    used: the bins with triangles, int32, ascending; used_count of them. Everything on the device.
    """

    def __init__(self, device: Device) -> None:
        self.device, self.kernels = device, device.build(HERE / "count.cl")
        self.counts, self.widest = device.zeros(BINS, np.int32), device.zeros((BINS, 2), np.int32)
        self.bits = device.zeros(MAP_WORDS, np.uint32)
        self.used, self.used_count = device.empty(0, np.int32), 0

    def count(self, triangles: Array, number: int, bins: Array, lengths: Array) -> None:
        """Count `number` triangles, int32, by bins int32 (T) and lengths uint16 (T, 4); the last ones are forgotten."""
        launch, kernels, tables = self.device.launch, self.kernels, (self.counts, self.widest, self.bits)
        launch(STAGE, kernels.forget_bins, self.used_count, self.used_count, self.used, *tables)
        launch(STAGE, kernels.count_bins, number, number, triangles, bins, lengths, *tables)
        ones = self.device.recycled(MAP_WORDS, np.int32)
        launch(STAGE, kernels.count_bits, MAP_WORDS, MAP_WORDS, self.bits, ones)
        offsets, self.used_count = exclusive_scan(self.device, ones, MAP_WORDS, STAGE)
        self.used = self.device.recycled(self.used_count, np.int32)
        launch(STAGE, kernels.list_bits, MAP_WORDS, MAP_WORDS, self.bits, offsets, self.used)


def count_bins_twin(bins: np.ndarray, lengths: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Used bins, their triangles and widest lengths (k, 2), for the bins and lengths (n, 4) of n triangles."""
    used, which, counts = np.unique(bins, return_inverse=True, return_counts=True)
    widest = np.zeros((len(used), 2), np.int64)
    np.maximum.at(widest, which, lengths[:, :2])
    return used, counts, widest
