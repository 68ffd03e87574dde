"""What `bench sweep` is asked for, checked."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from shading_atlas_bench.harness.sweep.timing import StopRule
from shading_atlas_bench.harness.workload.settings import LONGEST, Range, Settings


@dataclass(frozen=True)
class SweepRequest:
    """A sweep. vary: the `--vary` arguments. workers: processes side by side; times compare only with one."""

    settings: Settings
    vary: tuple[str, ...] = ()
    rule: StopRule = field(default_factory=StopRule)
    workers: int = 1

    @property
    def timed(self) -> bool:
        """Whether times can be compared."""
        return self.workers == 1


def read_request(
    settings: Settings, vary: Iterable[str], percent: float, repetitions: int, budget: float, workers: int
) -> SweepRequest:
    """The options of `bench sweep` as one value. Raises SettingsError for numbers out of range."""
    Range("--precision", 0.001, 100, "per cent").check(percent)
    Range("--repetitions", 1, 10_000).check(repetitions)
    Range("--budget", 0, LONGEST, "seconds").check(budget)
    Range("--workers", 1, 64).check(workers)
    return SweepRequest(settings, tuple(vary), StopRule(percent / 100, repetitions, budget), workers)
