"""Ranks of items within their class, in list order."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic import arrays

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device


def rank_by_class(
    device: Device, classes: Array, count: int, class_count: int, stage: str, runs: int | None = None
) -> tuple[Array, Array]:
    """Number of earlier items with the same class, and items per class.

    classes: int32 (count), -1 for an item without a class. Returns ranks int32 (count), -1 likewise, and totals int32
    (class_count). The same result for every number of `runs`.
    """
    kernels = device.build("common/rank.cl")
    run = max(1, -(-count // (runs or device.chunks)))
    runs = max(1, -(-count // run))
    table = device.empty((runs, class_count), np.int32)
    ranks, totals = device.empty(count, np.int32), device.empty(class_count, np.int32)
    device.launch(stage, kernels.count_classes, runs, count, run, runs, class_count, classes, table, local=1)
    device.launch(stage, kernels.scan_runs, class_count, runs, class_count, table, totals)
    device.launch(stage, kernels.rank_items, runs, count, run, runs, class_count, classes, table, ranks, local=1)
    return ranks, totals


def rank_by_class_twin(classes: arrays.Array, class_count: int) -> tuple[arrays.Array, arrays.Array]:
    """The same on the host."""
    totals = np.bincount(classes[classes >= 0], minlength=class_count)
    order = np.argsort(classes, kind="stable")
    ordered = classes[order]
    ranks = np.empty(len(classes), np.int64)
    ranks[order] = np.arange(len(classes)) - np.searchsorted(ordered, ordered)
    return np.where(classes < 0, -1, ranks), totals
