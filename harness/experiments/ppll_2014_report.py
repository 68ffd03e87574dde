"""The HTML page of the thesis' experiment: its tables and figures, ours beside the published numbers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from shading_atlas_bench.reports.pages.style import page_style
from shading_atlas_bench.reports.pages.tables import NONE, number, table
from shading_atlas_bench.reports.pages.texts import escape
from shading_atlas_bench.reports.store.csv_files import replace_file

Row = dict[str, Any]
COLOURS = {"bunny": "#0a84c6", "dragon": "#e08a00", "buddha": "#009e73"}
DASHES = ("solid", "dot", "dashdot")
WRAPPED = "thead th { white-space: normal; } tbody td { white-space: nowrap; }"  # so that twelve columns fit
HEADINGS = {
    "uncompressed_kib": "raw, KiB",
    "padded_kib": "padded, KiB",
    "lz4_kib": "LZ4, KiB",
    "lz4_shuffled_kib": "shuffled, KiB",
    "ratio": "LZ4 / raw",
    "ratio_shuffled": "shuffled / raw",
    "ratio_published": "published",
    "sent_of_built": "sent / built",
    "bad_pixels": "bad pixels",
    "sending_ms": "sending, ms",
    "frames_per_second": "frames / s",
    "sending_ratio": "sending *",
    "rate_ratio": "frames / s *",
    "sending_ratio_published": "published sending *",
    "rate_ratio_published": "published frames / s *",
    "building_over_opaque": "building / opaque",
    "encoding_over_building": "encoding / building",
}
BUILDING = ("building_over_opaque", "layers", "encoding_over_building")  # of table A.2, but not the thesis'
NAMES = ("mode", "model", "size")
# Of the fragments built, in per cent: section 6, where the bilateral method settles at "around 48% reduction".
PUBLISHED_SENT = {"difference": 47, "bilateral": 52}


@dataclass(frozen=True)
class Line:
    """One line of a figure; its dash is a name of Plotly's."""

    name: str
    x: list[str | int]
    y: list[float]
    colour: str
    dash: str


@dataclass(frozen=True)
class Figure:
    """A figure, with the titles of its axes."""

    title: str
    lines: list[Line]
    x: str
    y: str


def write_report(folder: Path, tables: dict[str, list[Row]], note: str = "") -> Path:
    """Write report.html into `folder` from the rows of its CSV files, `note` on top; returns its path."""
    import plotly.graph_objects as go
    from plotly.offline import get_plotlyjs

    parts = [
        ("Table A.1: mean size of a frame, and the share that LZ4 leaves", _table(tables["table_a1"])),
        ("Table A.2: time of sending at 1 Gbit/s, and frame rate", _table(tables["table_a2"], without=BUILDING)),
        ("Time of building and encoding", _table(tables["table_a2"], only=BUILDING)),
    ]
    for figure in _figures(tables):
        chart = go.Figure(
            [
                go.Scatter(
                    x=line.x,
                    y=line.y,
                    name=line.name,
                    mode="lines+markers",
                    line={"color": line.colour, "dash": line.dash},
                )
                for line in figure.lines
            ]
        )
        chart.update_layout(
            height=360, margin={"t": 20}, xaxis_title=figure.x, yaxis_title=figure.y, template="plotly_white"
        )
        chart.update_yaxes(rangemode="tozero")
        if figure.x in ("frame", "layers"):
            chart.update_xaxes(dtick=1 if len(figure.lines[0].x) <= 20 else None)
        content = chart.to_html(full_html=False, include_plotlyjs=False, config={"displayModeBar": False})
        parts.append((figure.title, content))
    note = f'<ul class="warnings" role="note"><li>{escape(note)}</li></ul>' if note else ""
    style = page_style()
    body = "\n".join(f"<section><h2>{escape(title)}</h2>{content}</section>" for title, content in parts)
    page = (
        '<!doctype html><html lang="en"><head><meta charset="utf-8"><title>ppll-2014</title>'
        f"<style>{style} {WRAPPED}</style><script>{get_plotlyjs()}</script></head><body><main>"
        "<h1>Per-pixel linked lists: the experiment of 2014</h1>"
        "<p>Half transparent models turn by 5 degrees per frame. The thesis ran on other machines and other versions "
        "of the models, and left the header out of its sizes: compare ratios. The first frame, which sends everything, "
        "is left out of the means. Bad pixels differ from those of the full lists by more than rounding. Ratios marked "
        "* are over the depth-limited method's. Building and encoding are device times; opaque is visibility of the "
        f"same triangles.</p>{note}{body}</main></body></html>"
    )
    path = folder / "report.html"
    replace_file(path, page)
    return path


def _table(rows: list[Row], only: tuple[str, ...] = (), without: tuple[str, ...] = ()) -> str:
    names = [name for name in rows[0] if name not in without and (not only or name in (*NAMES, *only))]

    def text(value: str | float | None) -> str:
        return NONE if value is None else value if isinstance(value, str) else number(value)

    lines = [[text(row[name]) for name in names] for row in rows]
    return table([HEADINGS.get(name, name) for name in names], lines, texts=len(NAMES))


def _figures(tables: dict[str, list[Row]]) -> list[Figure]:
    """Those of the thesis, in its order."""
    frames, layers = tables["frames"], tables["layers"]
    saved = _lines(tables["table_a1"], ("model", "mode"), "size", lambda row: 100 * (1 - row["ratio"]))
    figures = [
        Figure("Figure 6.1: saved by LZ4", saved, "size", "%"),
        Figure(
            "Figure 6.2: bad pixels of depth-limited lists",
            _lines(layers, ("model", "width"), "layers", lambda row: 100 * row["bad_pixels"]),
            "layers",
            "% of pixels",
        ),
    ]
    for mode, title in (
        ("difference", "Figure A.13: fragments sent, visual difference"),
        ("bilateral", "Figures 6.3 and A.14: fragments sent, bilateral"),
    ):
        rows = [row for row in frames if row["mode"] == mode]
        lines = _lines(
            rows, ("model", "width"), "frame", lambda row: 100 * row["fragments_sent"] / row["fragments_built"]
        )
        across = list(dict.fromkeys(row["frame"] for row in rows))
        lines.append(Line("published", across, [PUBLISHED_SENT[mode]] * len(across), "#888888", "dash"))
        figures.append(Figure(title, lines, "frame", "% of the fragments built"))
    for mode in ("depth-limited", "difference", "bilateral"):
        rows = [row for row in frames if row["mode"] == mode]
        lines = _lines(rows, ("model", "width"), "frame", lambda row: row["lz4_bytes"] / 1024)
        figures.append(Figure(f"Figures A.2 to A.10: network traffic, {mode}", lines, "frame", "KiB"))
    return figures


def _lines(rows: list[Row], names: tuple[str, str], x: str, y: Callable[[Row], float]) -> list[Line]:
    """One line for each combination of the two named values, in order: a colour for each first, a dash for each second
    one."""
    groups: dict[tuple[str, str | int], list[Row]] = {}
    for row in rows:
        groups.setdefault((row[names[0]], row[names[1]]), []).append(row)
    seconds = list(dict.fromkeys(second for _, second in groups))
    return [
        Line(
            f"{first} {second}",
            [row[x] for row in own],
            [y(row) for row in own],
            COLOURS[first],
            DASHES[seconds.index(second) % 3],
        )
        for (first, second), own in groups.items()
    ]
