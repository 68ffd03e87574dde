"""Cases of scanning and ranking: whole numbers, so nothing may differ."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.kernels.case import Cost, Result, Trial, case, seeded
from shading_atlas_bench.kernels.common.rank import rank_by_class, rank_by_class_twin
from shading_atlas_bench.kernels.common.scan import exclusive_scan, exclusive_scan_twin

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device


@case({"scan.run_sums": Cost("n", "4*n", "n"), "scan.run_offsets": Cost("n", "8*n", "n")}, 1 << 22)
def scan(device: Device, kind: str, size: int) -> Trial:
    """Adversarial: a total just below 2^31, and a size that no chunk divides."""
    size -= kind == "adversarial"
    most = (2**31 - 1) // size if kind == "adversarial" else 8
    values = seeded(kind).integers(0, most, size).astype(np.int32)
    uploaded = device.upload(values)

    def results() -> list[Result]:
        offsets, total = exclusive_scan(device, uploaded, size)
        expected, expected_total = exclusive_scan_twin(values)
        return [Result(offsets.get()[:size], expected), Result(np.array([total]), np.array([expected_total]))]

    return Trial({"n": size}, lambda: exclusive_scan(device, uploaded, size), results)


@case(
    {
        "rank.count_classes": Cost("n", "4*n + 4*c*runs"),
        "rank.scan_runs": Cost("c*runs", "8*c*runs", "c*runs"),
        "rank.rank_items": Cost("n", "8*n + 8*c*runs"),
    },
    1 << 21,
)
def rank(device: Device, kind: str, size: int) -> Trial:
    """Adversarial: everything in one class of many."""
    classes, count = seeded(kind).integers(-1, 81, size).astype(np.int32), 81
    if kind == "adversarial":
        classes, count = np.full(size, 999, np.int32), 1000
    uploaded = device.upload(classes)

    def run() -> tuple[Array, Array]:
        return rank_by_class(device, uploaded, size, count, "rank")

    def results() -> list[Result]:
        ranks, totals = run()
        expected, expected_totals = rank_by_class_twin(classes, count)
        return [Result(ranks.get()[:size], expected), Result(totals.get(), expected_totals)]

    return Trial({"n": size, "c": count, "runs": device.chunks}, run, results)
