"""Pareto fronts, and which method wins where: only what the intervals allow to be said."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from shading_atlas_bench.reports.store.csv_files import median_interval


@dataclass(frozen=True)
class Candidate:
    """One cell of a sweep as a choice: what it costs and how wrong it is.

    method: what it is called without what was varied, so that a method in two settings competes with itself.
    low, cost, high: the cost and its 95 % interval; low and high are None where it has none, and equal to the cost
        where it is exact. error: lower is better. errors: the same of each frame, by frame.
    """

    method: str
    low: float | None
    cost: float
    high: float | None
    error: float
    errors: dict[int, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Range:
    """Costs from `start` to `end` (None: and more) where one method wins, or is `alone` in reach; None: nobody."""

    start: float
    end: float | None
    method: str | None
    alone: bool = False


def pareto_front(points: Sequence[tuple[float, float]]) -> list[int]:
    """Indices of the points (cost, error) that no other point beats, by cost; lower is better in both.

    A point is beaten by one that is no worse in either and better in one; equal points are all on the front.
    """
    order = sorted(range(len(points)), key=lambda index: points[index])
    front: list[int] = []
    lowest = math.inf
    for index in order:
        if points[index][1] < lowest or (front and points[index] == points[front[-1]]):
            front.append(index)
            lowest = points[index][1]
    return front


def ranges_won(candidates: Sequence[Candidate]) -> list[Range]:
    """Who wins with how much to spend, from the lowest cost that any candidate may have.

    At a budget, a method is judged by its best candidate whose whole cost interval is within the budget. It wins if
    that candidate has a lower error than every candidate of every other method whose interval begins within the budget:
    the 95 % interval of the median difference, frame by frame, lies above zero. Where no other method has a candidate
    that begins within the budget, it is alone.

    Of a candidate without an interval nobody knows where it begins and ends: it may be within every budget, so it has
    to be beaten at all of them, and it is within none for sure, so it wins nothing.
    """
    known = [_Bounded.of(candidate) for candidate in candidates]
    steps = sorted({end for each in known for end in (each.low, each.high) if math.isfinite(end)})
    seen: dict[tuple[int, int], bool] = {}
    found: list[Range] = []
    for step, following in zip(steps, [*steps[1:], None], strict=True):
        method, alone = _winner(known, step, seen)
        if found and (found[-1].method, found[-1].alone) == (method, alone):
            found[-1] = Range(found[-1].start, following, method, alone)
        else:
            found.append(Range(step, following, method, alone))
    return found


@dataclass(frozen=True)
class _Bounded:
    """What is asked of a candidate, with an interval of all costs where it has none."""

    method: str
    low: float
    high: float
    error: float
    errors: dict[int, float]

    @classmethod
    def of(cls, candidate: Candidate) -> _Bounded:
        low, high = candidate.low, candidate.high
        if low is None or high is None:
            low, high = -math.inf, math.inf
        return cls(candidate.method, low, high, candidate.error, candidate.errors)


def _winner(known: list[_Bounded], budget: float, seen: dict[tuple[int, int], bool]) -> tuple[str | None, bool]:
    """The method that wins at a budget, if any, and whether it is alone."""
    possible = [candidate for candidate in known if candidate.low <= budget]
    certain = [candidate for candidate in known if candidate.high <= budget]
    methods = {candidate.method for candidate in possible}
    if len(methods) == 1 and certain:
        return methods.pop(), True
    for method in {candidate.method for candidate in certain}:
        best = min((c for c in certain if c.method == method), key=lambda candidate: candidate.error)
        if all(_beats(best, rival, seen) for rival in possible if rival.method != method):
            return method, False
    return None, False


def _beats(a: _Bounded, b: _Bounded, seen: dict[tuple[int, int], bool]) -> bool:
    """Whether the 95 % interval of the median of b - a, frame by frame, is above zero."""
    key = (id(a), id(b))
    if key not in seen:
        low, _ = median_interval(
            sorted(b.errors[frame] - a.errors[frame] for frame in a.errors.keys() & b.errors.keys())
        )
        seen[key] = low is not None and low > 0
    return seen[key]
