"""How noisy the machine is: a warning in the report is better than a quiet doubt about its times."""

from __future__ import annotations

import os
import time

import numpy as np

from shading_atlas_bench.harness.measure.machine import load

SPREAD = 0.25  # interquartile range over median of equal work, above which times are called noisy
BUSY = 0.5  # processes per core that run before the suite does anything


def noise_warnings() -> list[str]:
    """Sentences about load and about the spread of 21 timings of the same few milliseconds of work; none when calm."""
    warnings = []
    cores = os.cpu_count() or 1
    busy = load()
    if busy > BUSY * cores:
        warnings.append(
            f"The machine was busy before the run: load {busy:.1f} on {cores} cores. Compare ratios, not times."
        )
    work = np.arange(1 << 19, dtype=np.float32)
    times = []
    for _ in range(21):
        start = time.perf_counter()
        for _ in range(4):
            np.sqrt(work)
        times.append(time.perf_counter() - start)
    low, middle, high = np.percentile(times, (25, 50, 75))
    if (high - low) / middle > SPREAD:
        warnings.append(
            f"The machine is noisy: equal work varied by {100 * (high - low) / middle:.0f} % (interquartile range)."
        )
    return warnings
