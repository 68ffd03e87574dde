"""Quality over bandwidth: a method's curve over the rates that it was coded at, and what equal quality costs."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from shading_atlas_bench.reports.store.columns import BY_NAME
from shading_atlas_bench.reports.store.labels import Key, Labels

Row = dict[str, Any]
STEPS = 100  # between two qualities that some method has, in which another may become the cheapest


@dataclass(frozen=True)
class RatePoint:
    """A method at one rate. crf: None where planes are not coded by one. mbit: megabits per second, the mean of
    everything sent after the keyframe, at the path's pace. quality: the mean over the frames."""

    crf: int | None
    mbit: float
    quality: float


@dataclass(frozen=True)
class EqualQuality:
    """How much more, or less, one method sends than another at equal quality: percent, the mean over the qualities that
    both reach, from `least` to `most`."""

    percent: float
    least: float
    most: float


def quality_name(measure: str) -> str:
    """What people call a measure of the rates."""
    return measure.upper()


def rate_curve(summaries: list[Row], key: Key, measure: str) -> list[RatePoint]:
    """A method's points from the rows of summary.csv, by their bandwidth; of one that no video codec takes, its only
    one."""
    own = [row for row in summaries if (row["method"], row["variant"]) == key]
    coded = [row for row in own if row["codec"] not in (None, "none")] or own
    points = [
        RatePoint(row["crf"], row["bytes_total_kbit_s"] / 1000, row[f"{measure}_mean"])
        for row in coded
        if row["bytes_total_kbit_s"] and row[f"{measure}_mean"] is not None
    ]
    return sorted(points, key=lambda point: point.mbit)


def bd_rate(anchor: list[RatePoint], test: list[RatePoint], better: str) -> EqualQuality | None:
    """The Bjontegaard delta rate of `test` against `anchor`: the mean difference of the logarithms of their bandwidths
    over the qualities that both reach, interpolated piecewise by cubics without overshoot (PCHIP, as in JVET's common
    test conditions).

    better: "higher" or "lower" quality. None where either has fewer than two points or is no better for more bandwidth,
    and where no quality is reached by both. Source: VCEG-M33 (2001) and JVET-T2010.
    """
    from scipy.interpolate import PchipInterpolator

    ends = []
    for curve in (anchor, test):
        ordered = curve if better == "higher" else curve[::-1]
        if len(curve) < 2 or any(b.quality <= a.quality for a, b in pairwise(ordered)):
            return None
        ends.append((ordered[0].quality, ordered[-1].quality, ordered))
    least, most = max(low for low, _, _ in ends), min(high for _, high, _ in ends)
    if least >= most:
        return None
    means = []
    for _, _, curve in ends:
        rate = PchipInterpolator([point.quality for point in curve], [math.log(point.mbit) for point in curve])
        means.append(float(rate.integrate(least, most)) / (most - least))
    return EqualQuality(100 * math.expm1(means[1] - means[0]), least, most)


@dataclass(frozen=True)
class Reach:
    """The method that needs least bandwidth for the qualities that nothing cheaper reaches, up to `quality`."""

    label: str
    quality: float


def least_bandwidth(summaries: list[Row], labels: Labels, measure: str) -> list[Reach]:
    """Which method needs least bandwidth for which quality, from the qualities that are cheapest to the best that any
    reaches."""
    better = BY_NAME[measure].better
    curves = {label: rate_curve(summaries, key, measure) for key, label in labels.items()}
    needs = {label: _bandwidth_for(curve, better) for label, curve in curves.items() if curve}
    reached = sorted({point.quality for curve in curves.values() for point in curve}, reverse=better == "lower")
    found: list[Reach] = []
    for low, high in pairwise([*reached[:1], *reached]):
        for quality in (*(low + (high - low) * step / STEPS for step in range(1, STEPS)), high):
            costs = {label: need(quality) for label, need in needs.items()}
            cheapest = min(costs, key=lambda label: costs[label])
            if found and found[-1].label == cheapest:
                found.pop()
            found.append(Reach(cheapest, quality))
    return found


def _bandwidth_for(curve: list[RatePoint], better: str) -> Callable[[float], float]:
    """What a quality or a better one takes: between a method's points in a straight line through the logarithms of
    bandwidth, and infinitely much beyond its best."""
    sign = 1 if better == "higher" else -1
    best: list[RatePoint] = []
    for point in curve:  # one that is no better than a cheaper one is of no use
        if not best or sign * point.quality > sign * best[-1].quality:
            best.append(point)

    def need(quality: float) -> float:
        above = next((n for n, point in enumerate(best) if sign * point.quality >= sign * quality), None)
        if above is None:
            return math.inf
        if above == 0:
            return best[0].mbit
        one, other = best[above - 1], best[above]
        share = (quality - one.quality) / (other.quality - one.quality)
        return float(one.mbit * (other.mbit / one.mbit) ** share)

    return need


def least_bandwidth_words(summaries: list[Row], labels: Labels, measure: str) -> str:
    """The same as a sentence; empty where fewer than two methods have points."""
    with_points = [label for key, label in labels.items() if rate_curve(summaries, key, measure)]
    if len(with_points) < 2:
        return ""
    towards = "up to" if BY_NAME[measure].better == "higher" else "down to"
    parts = [f"{reach.label} {towards} {reach.quality:.3g}" for reach in least_bandwidth(summaries, labels, measure)]
    return f"Least bandwidth for a {quality_name(measure)}: {', '.join(parts)}."
