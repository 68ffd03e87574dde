"""How noisy the machine is: a warning in the report is better than a quiet doubt about its times."""

from __future__ import annotations

import os
import time

import numpy as np
import psutil

from shading_atlas_bench.harness.measure.machine import load

SPREAD = 0.25  # interquartile range over median of equal work, above which times are called noisy
BUSY = 0.5  # processes per core that run before the suite does anything


class OthersWatch:
    """Which share of the cores other programs take, the hypervisor's among them, from one look to the next."""

    def __init__(self) -> None:
        self._last = self._now()

    @staticmethod
    def _now() -> tuple[float, float, float]:
        """Seconds by the clock, of all cores' work for anybody, and of this process."""
        spent = psutil.cpu_times()
        idle = spent.idle + getattr(spent, "iowait", 0.0)
        guests = getattr(spent, "guest", 0.0) + getattr(spent, "guest_nice", 0.0)  # also counted as a user's
        return time.perf_counter(), sum(spent) - idle - guests, time.process_time()

    def look(self) -> float:
        """The share that others took since the last look, 0 to 1."""
        last, self._last = self._last, self._now()
        passed, busy, own = (after - before for before, after in zip(last, self._last, strict=True))
        return min(1.0, max(0.0, busy - own) / (passed * (os.cpu_count() or 1))) if passed > 0 else 0.0


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
