"""The HTML page of the thesis' experiment: its tables and figures, ours beside the published numbers."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import Any

from shading_atlas_bench.reports.pages.style import page_style
from shading_atlas_bench.reports.pages.tables import NONE, number, table
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


def write_report(folder: Path, tables: dict[str, list[Row]], note: str = "") -> Path:
    """Write report.html into `folder` from the rows of its CSV files, `note` on top; returns its path."""
    import plotly.graph_objects as go
    from plotly.offline import get_plotlyjs

    parts = [
        ("Table A.1: mean size of a frame, and the share that LZ4 leaves", _table(tables["table_a1"])),
        ("Table A.2: time of sending at 1 Gbit/s, and frame rate", _table(tables["table_a2"], without=BUILDING)),
        ("Time of building and encoding", _table(tables["table_a2"], only=BUILDING)),
    ]
    for title, lines, x, y in _figures(tables):
        figure = go.Figure(
            [go.Scatter(x=xs, y=ys, name=name, mode="lines+markers", line=look) for name, xs, ys, look in lines]
        )
        figure.update_layout(height=360, margin={"t": 20}, xaxis_title=x, yaxis_title=y, template="plotly_white")
        figure.update_yaxes(rangemode="tozero")
        if x in ("frame", "layers"):
            figure.update_xaxes(dtick=1 if len(lines[0][1]) <= 20 else None)
        parts.append((title, figure.to_html(full_html=False, include_plotlyjs=False, config={"displayModeBar": False})))
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

    def text(value: Any) -> str:
        return NONE if value is None else value if isinstance(value, str) else number(value)

    lines = [[text(row[name]) for name in names] for row in rows]
    return table([HEADINGS.get(name, name) for name in names], lines, texts=len(NAMES))


def _figures(tables: dict[str, list[Row]]) -> list[tuple[str, list, str, str]]:
    """Title, lines (name, x, y, look) and axis titles of each figure."""
    frames, layers = tables["frames"], tables["layers"]
    saved = _lines(tables["table_a1"], ("model", "mode"), "size", lambda row: 100 * (1 - row["ratio"]))
    figures = [
        ("Figure 6.1: saved by LZ4", saved, "size", "%"),
        (
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
        lines.append(("published", across, [PUBLISHED_SENT[mode]] * len(across), {"color": "#888888", "dash": "dash"}))
        figures.append((title, lines, "frame", "% of the fragments built"))
    for mode in ("depth-limited", "difference", "bilateral"):
        rows = [row for row in frames if row["mode"] == mode]
        lines = _lines(rows, ("model", "width"), "frame", lambda row: row["lz4_bytes"] / 1024)
        figures.append((f"Figures A.2 to A.10: network traffic, {mode}", lines, "frame", "KiB"))
    return figures


def _lines(rows: list[Row], names: tuple[str, ...], x: str, y: Any) -> list[tuple[str, list, list, dict]]:
    """One line for each combination of the named values, in order."""
    lines: dict[tuple, tuple[list, list]] = {}
    for row in rows:
        xs, ys = lines.setdefault(tuple(row[name] for name in names), ([], []))
        xs.append(row[x])
        ys.append(y(row))
    seconds = list(dict.fromkeys(key[1] for key in lines))
    return [
        (" ".join(map(str, key)), xs, ys, {"color": COLOURS[key[0]], "dash": DASHES[seconds.index(key[1]) % 3]})
        for key, (xs, ys) in lines.items()
    ]
