"""The answer of a run at a glance: what each method costs and how good it is, and who is best where."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from shading_atlas_bench.reports.analysis.judged import Judged, displayed
from shading_atlas_bench.reports.analysis.rates import least_bandwidth_words
from shading_atlas_bench.reports.store.columns import MEASURED_STATUSES
from shading_atlas_bench.reports.store.labels import Key, Labels

Row = dict[str, Any]
FEWEST = 6  # values that an interval of a median needs


@dataclass(frozen=True)
class Measure:
    """A number of the answer: its column, the statistic shown, its heading, what it is multiplied with for that unit,
    and how a sentence calls the best value."""

    name: str
    statistic: str
    heading: str
    scale: float
    best: str


# Packing is the server's device and host together: a method can move work from one to the other.
ANSWERED = (
    Measure("wall_ms", "median", "packing ms", 1, "least packing time"),
    Measure("client_ms", "median", "client ms", 1, "least client time"),
    Measure("flip", "median", "FLIP", 1, "lowest FLIP"),
    Measure("bytes_total", "kbit_s", "Mbit/s", 1e-3, "least bandwidth"),
    Measure("samples", "median", "samples", 1, "fewest samples"),
)


@dataclass(frozen=True)
class Answer:
    """One method's line. coding: codec and rate of what its client showed. cells: a text per measure, empty where there
    is no value. best: the measures in which it beats every other with 95 % confidence."""

    key: Key
    coding: tuple[str | None, int | None]
    cells: list[str]
    best: frozenset[str]


def answers(rows: list[Row], summaries: list[Row], labels: Labels) -> list[Answer]:
    """A line per method, in the order of `labels`, as its client shows it: with video coding where it has one."""
    lines = [displayed(rows, summaries, key)[0] for key in labels]
    return [
        Answer(
            line.key,
            line.coding,
            [_cell(line, measure) for measure in ANSWERED],
            frozenset(measure.name for measure in ANSWERED if line.beats_all(lines, measure.name)),
        )
        for line in lines
    ]


def _cell(line: Judged, measure: Measure) -> str:
    """The value with three significant digits, of a median also half its 95 % interval, in per cent."""
    value = line.summary[f"{measure.name}_{measure.statistic}"]
    if value is None:
        return ""
    low, high = (line.summary[f"{measure.name}_{end}"] for end in ("low", "high"))
    shown = three_digits(value * measure.scale)
    if measure.statistic != "median" or low is None or not value or low == high:
        return shown
    share = 50 * (high - low) / abs(value)
    return f"{shown} ±{share:.0f}%" if share >= 0.5 else f"{shown} ±<1%"


def three_digits(value: float) -> str:
    """A number with three significant digits: 0.0643, 12.0, 5,870, 1.23 M."""
    for scale, unit in ((1e9, " G"), (1e6, " M")):
        if abs(value) >= 0.9995 * scale:
            return f"{_three(value / scale)}{unit}"
    return _three(value)


def _three(value: float) -> str:
    rounded = float(f"{value:.2e}")
    size = abs(rounded)
    if size >= 100 or rounded == 0:
        return f"{rounded:,.0f}"
    if size < 1e-4:
        return f"{rounded:.2e}"
    places = sum(size < least for least in (10, 1, 0.1, 0.01, 0.001)) + 1
    return f"{rounded:.{places}f}"


def answer_words(rows: list[Row], summaries: list[Row], labels: Labels) -> list[str]:
    """What the lines say, in sentences; none where fewer than two methods have numbers."""
    lines = answers(rows, summaries, labels)
    if sum(any(line.cells) for line in lines) < 2:
        return []
    frames = len({row["frame"] for row in rows if row["status"] in MEASURED_STATUSES})
    parts = []
    for line in lines:
        won = [measure.best for measure in ANSWERED if measure.name in line.best]
        if won:
            parts.append(f"{labels[line.key]} has the {_listed(won)}")
    if parts:
        said = "; ".join(parts) + "."
    elif frames < FEWEST:
        said = f"Nobody is called best: an interval needs {FEWEST} frames, and there are {frames}."
    else:
        said = "Nobody is best in anything: nowhere do the intervals separate one method from all others."
    return [said, *filter(None, [least_bandwidth_words(summaries, labels, "flip")])]


def _listed(parts: list[str]) -> str:
    return " and ".join(filter(None, [", ".join(parts[:-1]), parts[-1]]))
