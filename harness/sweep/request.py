"""What `bench sweep` is asked for, checked."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from shading_atlas_bench.harness.sweep.timing import StopRule
from shading_atlas_bench.harness.workload.settings import Settings, SettingsError


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
    checks = [
        (0 < percent <= 100, f"--precision is {percent:g}: give per cent, above 0 and up to 100."),
        (repetitions >= 1, f"--repetitions is {repetitions}: give at least 1."),
        (budget >= 0, f"--budget is {budget:g}: give 0 seconds or more."),
        (1 <= workers <= 64, f"--workers is {workers}: give 1 to 64."),
    ]
    for fine, sentence in checks:
        if not fine:
            raise SettingsError(sentence)
    return SweepRequest(settings, tuple(vary), StopRule(percent / 100, repetitions, budget), workers)
