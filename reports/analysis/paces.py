"""Whether two runs' times differ, where each run is one process on a machine that is not always as fast.

Frames of one process are no independent samples of a machine: a rank test over them calls every change of its pace a
change of the code. So a difference must be there in the times and in their ratios to the reference's, which the same
process drew in the same frames; it must be larger than what either moves by along the run, and than what the reference
itself differs by.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from shading_atlas_bench.reports.store.disturbance import OTHERS, REFERENCE, is_disturbed, of_frames
from shading_atlas_bench.reports.store.middle import median

ALPHA = 0.01  # of each rank test
LEAST = 0.10  # of a difference; the same work timed in two processes easily differs by several per cent
PARTS = 3  # of a run, whose medians tell how it moves
FEWEST = 6  # pairs that have a chance of being told apart


@dataclass(frozen=True)
class Pace:
    """What a run knows of its machine, by frame: the reference's milliseconds, and the frames that others disturbed."""

    reference: dict[int, float] = field(default_factory=dict)
    disturbed: frozenset[int] = frozenset()

    @classmethod
    def of(cls, statistics: list[dict[str, Any]]) -> Pace:
        """From the rows of the store's statistics."""
        others = of_frames(statistics, OTHERS)
        busy = frozenset(frame for frame, taken in others.items() if is_disturbed(taken))
        return cls(of_frames(statistics, REFERENCE), busy)


def sure_change(times: dict[int, tuple[float, float]], a: Pace, b: Pace) -> float | None:
    """How the times of run b stand to those of run a, as far as that is sure: the factor, nearer to 1 of that of the
    times and that of their ratios to the reference's; None where it is not.

    times: milliseconds in a and b, by frame. Frames that were disturbed in either run, and those without a reference,
    are left out.
    """
    kept = [
        frame
        for frame, (before, after) in times.items()
        if before > 0 < after and a.reference.get(frame, 0) > 0 < b.reference.get(frame, 0)
        if frame not in a.disturbed | b.disturbed
    ]
    if len(kept) < FEWEST:
        return None
    plain = [math.log(times[frame][1] / times[frame][0]) for frame in sorted(kept)]
    paces = [math.log(b.reference[frame] / a.reference[frame]) for frame in sorted(kept)]
    ratios = [time - pace for time, pace in zip(plain, paces, strict=True)]
    shifts = median(plain), median(ratios)
    if shifts[0] * shifts[1] <= 0 or max(p_value(plain), p_value(ratios)) >= ALPHA:
        return None
    least = min(map(abs, shifts))
    if least < max(math.log1p(LEAST), _movement(plain), _movement(ratios), abs(median(paces))):
        return None
    return math.exp(math.copysign(least, shifts[0]))


def _movement(values: Sequence[float]) -> float:
    """How far apart the medians of a run's parts are."""
    count = len(values)
    parts = [values[count * n // PARTS : count * (n + 1) // PARTS] for n in range(PARTS)]
    medians = [median(part) for part in parts]
    return max(medians) - min(medians)


def p_value(differences: Sequence[float]) -> float:
    """Of the Wilcoxon signed-rank test, two-sided; 1 where all are equal."""
    from scipy.stats import wilcoxon

    differing = [difference for difference in differences if difference]
    return float(wilcoxon(differing).pvalue) if differing else 1.0
