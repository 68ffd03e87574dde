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
    ends = []
    for curve in (anchor, test):
        ordered = curve if better == "higher" else curve[::-1]
        if len(curve) < 2 or any(b.quality <= a.quality for a, b in pairwise(ordered)):
            return None
        ends.append((ordered[0].quality, ordered[-1].quality, ordered))
    least, most = max(low for low, _, _ in ends), min(high for _, high, _ in ends)
    if least >= most:
        return None
    means = [
        pchip_integral([p.quality for p in curve], [math.log(p.mbit) for p in curve], least, most) / (most - least)
        for _, _, curve in ends
    ]
    return EqualQuality(100 * math.expm1(means[1] - means[0]), least, most)


def pchip_integral(x: list[float], y: list[float], low: float, high: float) -> float:
    """The integral from `low` to `high`, both between the ends of ascending `x`, of the piecewise cubic through (x, y)
    that goes up and down only where they do (Fritsch and Butland 1984): what SciPy's PchipInterpolator gives, whose
    import takes as long as the rest of a report."""
    slopes = _pchip_slopes(x, y)

    def value(k: int, at: float) -> float:
        width = x[k + 1] - x[k]
        t = (at - x[k]) / width
        rise = (3 - 2 * t) * t * t
        bend = t * (1 - t) * ((1 - t) * slopes[k] - t * slopes[k + 1])
        return y[k] + (y[k + 1] - y[k]) * rise + width * bend

    total = 0.0
    for k in range(len(x) - 1):
        a, b = max(low, x[k]), min(high, x[k + 1])
        if a < b:  # Simpson's rule is exact for cubics
            total += (b - a) / 6 * (value(k, a) + 4 * value(k, (a + b) / 2) + value(k, b))
    return total


def _pchip_slopes(x: list[float], y: list[float]) -> list[float]:
    """The slope at each point: between two intervals the harmonic mean of theirs, 0 at a turn; at the ends that of a
    parabola through three points, held to the first interval's direction and to three times its slope."""
    widths = [b - a for a, b in pairwise(x)]
    secants = [(b - a) / width for (a, b), width in zip(pairwise(y), widths, strict=True)]
    if len(secants) == 1:
        return secants * 2
    inner = []
    for (h0, h1), (d0, d1) in zip(pairwise(widths), pairwise(secants), strict=True):
        w0, w1 = 2 * h1 + h0, h1 + 2 * h0
        inner.append((w0 + w1) / (w0 / d0 + w1 / d1) if d0 * d1 > 0 else 0.0)
    first = _end_slope(widths[0], widths[1], secants[0], secants[1])
    last = _end_slope(widths[-1], widths[-2], secants[-1], secants[-2])
    return [first, *inner, last]


def _end_slope(h0: float, h1: float, d0: float, d1: float) -> float:
    slope = ((2 * h0 + h1) * d0 - h0 * d1) / (h0 + h1)
    if slope * d0 <= 0:
        return 0.0
    return 3 * d0 if d0 * d1 <= 0 and abs(slope) > 3 * abs(d0) else slope


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
