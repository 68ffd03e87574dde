"""The answer at a glance: three digits, marks only where one method separates, sentences that say what lines say."""

from __future__ import annotations

import re
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from shading_atlas_bench.reports.analysis.answer import ANSWERED, Answer, answer_words, answers, three_digits
from shading_atlas_bench.reports.store.columns import FRAME_COLUMNS
from shading_atlas_bench.reports.store.csv_files import summarise

EMPTY = dict.fromkeys(column.name for column in FRAME_COLUMNS)
NAMES = [measure.name for measure in ANSWERED]


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0, "0"), (0.06434, "0.0643"), (0.999, "0.999"), (0.9999, "1.00"), (9.996, "10.0"), (57.64, "57.6"),
        (99.96, "100"), (5867.4, "5,870"), (123_456, "123,000"), (999_600, "1.00 M"), (1_341_354, "1.34 M"),
        (2.5e9, "2.50 G"), (0.00012, "0.000120"), (3e-7, "3.00e-07"), (-1.234, "-1.23"),
    ],
)  # fmt: skip
def test_numbers_have_three_digits(value, text):
    assert three_digits(value) == text


@given(st.floats(1e-3, 1e11))
def test_what_is_shown_is_within_half_a_digit(value):
    text, scale = three_digits(value).replace(",", ""), 1.0
    if found := re.fullmatch(r"(.*) ([MG])", text):
        text, scale = found[1], {"M": 1e6, "G": 1e9}[found[2]]
    assert float(text) * scale == pytest.approx(value, rel=0.00501)


def rows_of(frames: int = 9, **methods: dict[str, Any]) -> list[dict[str, Any]]:
    """Rows of methods whose values, of their one coding, vary a little from frame to frame, all in the same way."""
    rows = []
    for method, values in methods.items():
        for frame in range(frames):
            factor = 1 + 0.01 * (frame * 3 % 5)
            row = EMPTY | {"scene": "hall", "path": "walk", "method": method, "variant": "", "frame": frame}
            row |= {"codec": "h264", "crf": 25, "status": "ok", "frame_rate": 60.0, "client_ms": 1.0 * factor}
            rows.append(row | {name: value * factor for name, value in values.items()})
    return rows


def told(rows: list[dict[str, Any]]) -> tuple[dict[str, Answer], list[str]]:
    labels = {(row["method"], ""): row["method"] for row in rows}
    summaries = summarise(rows)
    lines = answers(rows, summaries, labels)
    return {labels[line.key]: line for line in lines}, answer_words(rows, summaries, labels)


FAST = {"wall_ms": 10.0, "flip": 0.2, "bytes_total": 5000, "samples": 1000}
FINE = {"wall_ms": 20.0, "flip": 0.1, "bytes_total": 9000, "samples": 1000}


def test_the_best_is_marked_and_said():
    lines, words = told(rows_of(fast=FAST, fine=FINE))
    assert lines["fast"].best == {"wall_ms", "bytes_total"}
    assert lines["fine"].best == {"flip"}
    assert words[0] == "fast has the least packing time and least bandwidth; fine has the lowest FLIP."
    assert words[1] == "Least bandwidth for a FLIP: fast down to 0.204, fine down to 0.102."
    shown = dict(zip(NAMES, lines["fast"].cells, strict=True))
    assert shown["wall_ms"] == "10.2 ±2%"
    assert shown["bytes_total"] == "2.45", "5 kB a frame at 60 per second, and a little"


def test_equal_methods_are_not_told_apart():
    lines, words = told(rows_of(one=FAST, other=FAST))
    assert not any(line.best for line in lines.values())
    assert words[0] == "Nobody is best in anything: nowhere do the intervals separate one method from all others."


def test_too_few_frames_call_nobody_best():
    lines, words = told(rows_of(5, fast=FAST, fine=FINE))
    assert not any(line.best for line in lines.values())
    assert words[0] == "Nobody is called best: an interval needs 6 frames, and there are 5."


def test_one_method_or_only_failures_say_nothing():
    assert told(rows_of(fast=FAST))[1] == []
    failed = dict.fromkeys([*NAMES, "client_ms"]) | {"status": "failed", "reason": "no"}
    lines, words = told([row | failed for row in rows_of(fast=FAST, fine=FINE)])
    assert words == []
    assert all(line.cells == [""] * len(ANSWERED) for line in lines.values())


def test_a_method_that_failed_does_not_keep_others_from_being_best():
    rows = rows_of(fast=FAST, fine=FINE)
    gone = dict.fromkeys([*NAMES, "client_ms"]) | {"method": "gone", "status": "failed", "reason": "no"}
    rows += [row | gone for row in rows if row["method"] == "fast"]
    lines, _ = told(rows)
    assert lines["fine"].best == {"flip"}
    assert lines["gone"].cells == [""] * len(ANSWERED)
