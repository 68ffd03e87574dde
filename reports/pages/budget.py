"""Where a frame's time goes, from packing on the server to the picture on the client: a chart and a table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from shading_atlas_bench.reports.analysis.judged import displayed_codings
from shading_atlas_bench.reports.charts.figures import Figure, coding_label, stacked_bars
from shading_atlas_bench.reports.pages.tables import NONE, number, table
from shading_atlas_bench.reports.pages.texts import escape
from shading_atlas_bench.reports.store.columns import KEYFRAME, MEASURED_STATUSES
from shading_atlas_bench.reports.store.labels import Labels
from shading_atlas_bench.reports.store.middle import mean

Row = dict[str, Any]

# Name, the columns whose sum it is, colour: blue on the server, orange for coding, green on the client.
SEGMENTS: tuple[tuple[str, tuple[str, ...], str], ...] = (
    ("server device", ("server_ms",), "hsl(205, 85%, 38%)"),
    ("server host", ("serialise_ms",), "hsl(205, 70%, 65%)"),
    ("fill", ("fill_ms",), "hsl(42, 85%, 68%)"),
    ("encode", ("encode_ms",), "hsl(35, 95%, 46%)"),
    ("network", ("network_ms",), "hsl(335, 45%, 55%)"),
    ("decode", ("decode_ms",), "hsl(28, 70%, 34%)"),
    ("client host", ("receive_ms", "draw_host_ms"), "hsl(160, 45%, 62%)"),
    ("client device", ("client_ms",), "hsl(162, 90%, 30%)"),
)


@dataclass(frozen=True)
class Budget:
    """Mean milliseconds of a method's frames after the keyframe, as displayed.

    parts: by the segment's name; None where nothing was measured. whole: the same by clocks around their steps.
    """

    label: str
    coding: str
    parts: dict[str, float | None]
    whole: float | None

    @property
    def total(self) -> float:
        """The sum of the parts."""
        return sum(part for part in self.parts.values() if part is not None)


def budgets(rows: list[Row], labels: Labels) -> list[Budget]:
    """The budget of each method that has any of the times, in its displayed coding: with video coding if it has it."""
    found = []
    for key, label in labels.items():
        own = [row for row in rows if (row["method"], row["variant"]) == key]
        if not own:
            continue
        coding, shown = _displayed(own)
        parts = {name: _mean(shown, columns) for name, columns, _ in SEGMENTS}
        if any(part is not None for part in parts.values()):
            found.append(Budget(label, coding_label(*coding), parts, _mean(shown, ("frame_ms",))))
    return found


def _displayed(rows: list[Row]) -> tuple[tuple[str | None, int | None], list[Row]]:
    """The coding of a method's displayed picture, and of all of its rows those measured after the keyframe."""
    codings = displayed_codings(rows)
    coding = min(codings, key=lambda coding: coding[0] == "none")
    own = [row for row in codings[coding] if row["status"] in MEASURED_STATUSES and row["frame"] != KEYFRAME]
    return coding, own


def _mean(rows: list[Row], columns: tuple[str, ...]) -> float | None:
    """Mean over the rows of the sum of columns; rows that lack one do not count."""
    values = [[row[name] for name in columns] for row in rows]
    sums = [sum(each) for each in values if None not in each]
    return mean(sums) if sums else None


def budget_figure(found: list[Budget]) -> Figure | None:
    """The parts, stacked from left to right in the order they happen, one bar per method."""
    bars = {
        name: (colour, [budget.parts[name] for budget in found])
        for name, _, colour in SEGMENTS
        if any(budget.parts[name] is not None for budget in found)
    }
    return stacked_bars(bars, [budget.label for budget in found], "time per frame (ms) ↓", spare=10)


def budget_table(found: list[Budget]) -> str:
    """Milliseconds: the frame by clocks around its steps, the sum of its parts, their share of that, and the parts."""
    head = ["method", "coding", "clocked", "sum", "explained", *(name for name, _, _ in SEGMENTS)]
    lines = []
    for budget in found:
        share = f"{100 * budget.total / budget.whole:.1f} %" if budget.whole else NONE
        parts = [_text(part) for part in budget.parts.values()]
        lines.append([budget.label, budget.coding, _text(budget.whole), _text(budget.total), share, *parts])
    return table(head, lines, texts=2)


def visible_set(rows: list[Row]) -> str:
    """A sentence on the time of the visible set, which is the same work for all methods; nothing if it is unknown."""
    times = {row["frame"]: row["pvs_ms"] for row in rows if row["pvs_ms"] is not None and row["frame"] != KEYFRAME}
    if not times:
        return ""
    usual = escape(number(mean(times.values())))
    return f"Finding the potentially visible set, the same work for all methods, is not in it: {usual} ms per frame."


def _text(value: float | None) -> str:
    return NONE if value is None else f"{value:.1f}"
