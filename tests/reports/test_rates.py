"""Curves over the rates, and what equal quality costs; against the published package and planted ratios."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import PchipInterpolator

from shading_atlas_bench.reports.analysis.rates import (
    STEPS,
    RatePoint,
    bd_rate,
    least_bandwidth,
    least_bandwidth_words,
    pchip_integral,
    rate_curve,
)


def curve(mbit: list[float], quality: list[float]) -> list[RatePoint]:
    return sorted((RatePoint(0, *point) for point in zip(mbit, quality, strict=True)), key=lambda point: point.mbit)


# Points of the example in the readme of PyPI's bjontegaard 1.3.0, and two more; its bd_rate(..., method="pchip").
PUBLISHED = [
    ([9487.76, 4593.60, 2486.44, 1358.24], [40.037, 38.615, 36.845, 34.851],
     [9787.80, 4469.00, 2451.52, 1356.24], [40.121, 38.651, 36.970, 34.987], -4.417485350589045),
    ([100, 200, 400, 900], [30, 33, 36, 39], [60, 150, 330, 700, 1500], [29, 32.5, 36, 38.5, 41], -15.99872735998945),
    ([100, 200, 400], [-0.12, -0.08, -0.05], [300, 800, 1600], [-0.11, -0.09, -0.045], 343.559281832456),
]  # fmt: skip


@pytest.mark.parametrize(("anchor_rate", "anchor_quality", "rate", "quality", "percent"), PUBLISHED)
def test_it_is_what_the_published_package_gives(anchor_rate, anchor_quality, rate, quality, percent):
    found = bd_rate(curve(anchor_rate, anchor_quality), curve(rate, quality), "higher")
    assert found is not None
    assert found.percent == pytest.approx(percent, rel=1e-9)
    errors = [[-value for value in values] for values in (anchor_quality, quality)]
    turned = bd_rate(curve(anchor_rate, errors[0]), curve(rate, errors[1]), "lower")
    assert turned is not None
    assert turned.percent == pytest.approx(percent, rel=1e-9), "a lower error is a higher quality"


steps = st.lists(st.floats(0.01, 10), min_size=2, max_size=6)


@given(rates=steps, qualities=steps, ratio=st.floats(0.01, 100))
def test_a_planted_ratio_is_found(rates, qualities, ratio):
    count = min(len(rates), len(qualities))
    mbit = [sum(rates[: n + 1]) for n in range(count)]
    quality = [sum(qualities[: n + 1]) for n in range(count)]
    found = bd_rate(curve(mbit, quality), curve([ratio * one for one in mbit], quality), "higher")
    assert found is not None
    assert found.percent == pytest.approx(100 * (ratio - 1), rel=1e-6, abs=1e-6)
    assert (found.least, found.most) == (quality[0], quality[-1])


@pytest.mark.parametrize(
    ("mbit", "quality"),
    [([1], [30]), ([], []), ([1, 2, 3], [30, 29, 31]), ([1, 2, 3], [30, 30, 31]), ([1, 2], [40, 50]), ([1, 2], [1, 2])],
)
def test_what_cannot_be_compared_has_no_number(mbit, quality):
    whole = curve([1, 2, 4], [28, 32, 36])
    assert bd_rate(whole, curve(mbit, quality), "higher") is None
    assert bd_rate(curve(mbit, quality), whole, "higher") is None


@given(
    widths=st.lists(st.floats(0.01, 10), min_size=1, max_size=6),
    values=st.lists(st.integers(-1000, 1000).map(lambda n: n / 100), min_size=7, max_size=7),
    ends=st.tuples(st.floats(0, 1), st.floats(0, 1)),
)
def test_the_cubics_are_those_of_scipy(widths, values, ends):
    x = [sum(widths[:n]) for n in range(len(widths) + 1)]
    y = values[: len(x)]
    low, high = (x[-1] * share for share in sorted(ends))
    expected = float(PchipInterpolator(x, y).integrate(low, high))
    assert pchip_integral(x, y, low, high) == pytest.approx(expected, rel=1e-9, abs=1e-9)


def summaries(**methods: Any) -> list[dict[str, Any]]:
    """Rows of summary.csv: of each method, by its rate, kbit/s and FLIP."""
    rows = []
    for method, rates in methods.items():
        for crf, (kbit, flip) in rates.items():
            codec = "none" if crf is None else "h264"
            row = {"method": method, "variant": "", "codec": codec, "crf": crf, "psnr_mean": None}
            rows.append(row | {"bytes_total_kbit_s": kbit, "flip_mean": flip})
    return rows


LABELS = {(name, ""): name for name in ("lists", "first", "second", "third")}


def test_a_curve_is_of_coded_rates_and_lists_have_one_point():
    rows = summaries(
        lists={None: (9000, 0.1)}, first={None: (10**6, 0.01), 5: (4000, 0.02), 40: (1000, 0.2), 45: (None, 0.3)}
    )
    rows.append(rows[1] | {"crf": 50, "bytes_total_kbit_s": 500, "flip_mean": None})
    assert rate_curve(rows, ("first", ""), "flip") == [RatePoint(40, 1, 0.2), RatePoint(5, 4, 0.02)]
    assert rate_curve(rows, ("lists", ""), "flip") == [RatePoint(None, 9, 0.1)]
    assert rate_curve(rows, ("second", ""), "flip") == []


STEEP = {5: (4000, 0.02), 25: (2000, 0.06), 40: (1000, 0.2)}


def reaches(**methods: Any) -> list[tuple[str, float]]:
    return [(one.label, one.quality) for one in least_bandwidth(summaries(**methods), LABELS, "flip")]


def test_the_cheapest_method_is_named_down_to_the_quality_that_it_reaches():
    double = {crf: (2 * kbit, flip) for crf, (kbit, flip) in STEEP.items()}
    finer = {crf: (10 * kbit, flip / 4) for crf, (kbit, flip) in STEEP.items()}
    assert reaches(first=double, second=STEEP) == [("second", 0.02)]
    assert reaches(first=finer, second=STEEP) == [("second", 0.02), ("first", 0.005)]
    assert reaches(first=STEEP, lists={None: (9000, 0.01)}) == [("first", 0.02), ("lists", 0.01)]
    assert reaches(first=STEEP, lists={None: (9000, 0.02)}) == [("first", 0.02)]
    assert reaches(lists={None: (9000, 0.02)}) == [("lists", 0.02)]
    assert reaches() == []
    useless = STEEP | {30: (1500, 0.3)}
    assert reaches(first=useless, second=double) == [("first", 0.02)]


def test_curves_that_cross_change_places_where_they_cross():
    """Straight lines through logarithms: 1 to 100 Mbit/s against 2 to 50, from 0.2 to 0.1, meet at 0.163."""
    found = reaches(first={40: (1000, 0.2), 5: (100_000, 0.1)}, second={40: (2000, 0.2), 5: (50_000, 0.1)})
    assert [label for label, _ in found] == ["first", "second"]
    crossing = 0.2 - 0.1 * math.log(2) / (math.log(100) - math.log(25))
    assert found[0][1] == pytest.approx(crossing, abs=0.1 / STEPS)


@given(
    points=st.lists(
        st.tuples(
            st.sampled_from(["first", "second", "third"]), st.integers(0, 51), st.floats(1, 1e6), st.floats(0, 1)
        ),
        max_size=12,
    )
)
def test_what_is_named_reaches_it_and_qualities_only_get_better(points):
    methods: dict[str, dict[int, tuple[float, float]]] = {}
    for method, crf, kbit, flip in points:
        methods.setdefault(method, {})[crf] = (kbit, flip)
    found = reaches(**methods)
    best = {method: min(flip for _, flip in rates.values()) for method, rates in methods.items()}
    assert all(quality >= best[label] for label, quality in found)
    qualities = [quality for _, quality in found]
    assert qualities == sorted(qualities, reverse=True)
    assert qualities[-1:] == ([min(best.values())] if best else [])


def test_the_sentence_needs_two_methods():
    finer = {crf: (10 * kbit, flip / 4) for crf, (kbit, flip) in STEEP.items()}
    said = least_bandwidth_words(summaries(first=finer, second=STEEP), LABELS, "flip")
    assert said == "Least bandwidth for a FLIP: second down to 0.02, first down to 0.005."
    assert least_bandwidth_words(summaries(first=finer), LABELS, "flip") == ""
    assert least_bandwidth_words(summaries(first=finer, second=STEEP), LABELS, "psnr") == ""
