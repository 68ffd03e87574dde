"""What `bench kernels` writes: kernels.csv, and a page with the roofline, the errors and the build variants."""

from __future__ import annotations

from collections.abc import Iterable
from math import exp, log
from pathlib import Path
from statistics import fmean
from typing import Any

from shading_atlas_bench.reports.charts.figures import COLOURS
from shading_atlas_bench.reports.pages.html import caption, facts_list, fill_page, section
from shading_atlas_bench.reports.pages.texts import escape
from shading_atlas_bench.reports.store.columns import KERNEL_COLUMNS
from shading_atlas_bench.reports.store.csv_files import replace_file, write_csv

Row = dict[str, Any]


def write_kernels(folder: Path, rows: list[Row], about: dict[str, str], roofline: dict[str, float]) -> Path:
    """Write kernels.csv and kernels.html into `folder` and return the page's path.

    about: facts for the page's head. roofline: bandwidth and arithmetic of the device, per second.
    """
    write_csv(folder / "kernels.csv", KERNEL_COLUMNS, rows)
    sections = [
        section(
            "variants",
            "Build variants",
            caption(
                "Each stage's time against the default's, over its error: lower is faster, further left is closer to "
                "the float64 twin. One point per kernel and input."
            ),
            '<div class="chart" data-figure="variants"></div>',
            _variants(rows),
        ),
        section(
            "roofline",
            "Roofline",
            caption(
                "Work per second of every kernel on typical input over the work per byte. No kernel can be above the "
                "lines, unless its data fits a cache, which the copy's does not. Kernels without arithmetic have no "
                "point; their share of the copy bandwidth is in the table."
            ),
            '<div class="chart" data-figure="roofline"></div>',
        ),
        section(
            "kernels",
            "Kernels",
            caption("Click a header to sort. Everything, with the formulas for bytes and flops, is in kernels.csv."),
            _table(rows),
        ),
    ]
    figures = {"roofline": _roofline(rows, roofline), "variants": _variant_points(rows)}
    head = f"<h1>Kernels: time <span>against</span> error</h1>{facts_list(about)}"
    replace_file(folder / "kernels.html", fill_page("Kernels", head, sections, figures, {}))
    return folder / "kernels.html"


def by_variant(rows: Iterable[Row]) -> dict[tuple[str, str], dict[str, Row]]:
    """The rows of each kernel and input by variant."""
    found: dict[tuple[str, str], dict[str, Row]] = {}
    for row in rows:
        found.setdefault((row["kernel"], row["input"]), {})[row["variant"]] = row
    return found


def compare_variants(rows: list[Row]) -> list[Row]:
    """How each variant compares with the default: time as a geometric mean, and how many stages err more or less.

    A stage errs more (less) if its 99.9-percentile error in ULP, or its number of misassigned or broken values, is
    above 2 times (below half) the default's.
    """
    groups = by_variant(rows).values()
    found = []
    for variant in dict.fromkeys(row["variant"] for row in rows):
        pairs = [(group[variant], group["default"]) for group in groups if variant in group and "default" in group]
        if variant == "default" or not pairs:
            continue
        ratios = [a["ms"] / b["ms"] for a, b in pairs if a["ms"] and b["ms"]]
        stages = {(a["case"], a["input"]): (wrongness(a), wrongness(b)) for a, b in pairs}
        found.append(
            {
                "variant": variant,
                "time": exp(fmean(map(log, ratios))) if ratios else None,
                "stages": len(stages),
                "worse": [name for name, (a, b) in stages.items() if _clearly_more(a, b)],
                "better": [name for name, (a, b) in stages.items() if _clearly_more(b, a)],
            }
        )
    return found


def wrongness(row: Row) -> tuple[float, float]:
    """The error in ULP and the number of values that are wrong altogether."""
    return row["p999_ulp"] or 0.0, (row["misassigned"] or 0) + (row["broken"] or 0)


def _clearly_more(a: tuple[float, float], b: tuple[float, float]) -> bool:
    return a[0] > 2 * max(b[0], 0.5) or a[1] > 2 * max(b[1], 1)


def _variants(rows: list[Row]) -> str:
    lines = []
    for row in compare_variants(rows):
        worse = ", ".join(f"{case} ({kind})" for case, kind in row["worse"]) or "none"
        better = ", ".join(f"{case} ({kind})" for case, kind in row["better"]) or "none"
        time = "" if row["time"] is None else f"{row['time']:.3f}"
        lines.append(f"<tr><th>{row['variant']}</th><td>{time}</td><td>{worse}</td><td>{better}</td></tr>")
    if not lines:
        return ""
    head = "<th>variant</th><th>time over the default's</th><th>errs clearly more in</th><th>clearly less in</th>"
    body = f"<thead><tr>{head}</tr></thead><tbody>{''.join(lines)}</tbody>"
    return f'<div class="scroll"><table class="words variants">{body}</table></div>'


def _variant_points(rows: list[Row]) -> dict[str, Any] | None:
    """Time over the default's against the error in ULP."""
    groups, traces = by_variant(rows), []
    for index, variant in enumerate(dict.fromkeys(row["variant"] for row in rows)):
        own = [(group[variant], group["default"]) for group in groups.values() if {variant, "default"} <= group.keys()]
        points = [(a, a["ms"] / b["ms"]) for a, b in own if a["p999_ulp"] is not None and a["ms"] and b["ms"]]
        if variant == "default" or not points:
            continue
        traces.append(
            _scatter(
                variant,
                [max(row["p999_ulp"], 0.01) for row, _ in points],
                [ratio for _, ratio in points],
                [f"{row['kernel']}, {row['input']}" for row, _ in points],
                COLOURS[index],
            )
        )
    if not traces:
        return None
    return {"data": traces, "layout": _layout("99.9-percentile error (ULP) ↓", "time over the default's ↓")}


def _roofline(rows: list[Row], roofline: dict[str, float]) -> dict[str, Any] | None:
    bandwidth, arithmetic = roofline["bandwidth"] / 1e9, roofline["arithmetic"] / 1e9
    shown = [row for row in rows if row["input"] == "typical" and row["variant"] == "default" and row["flops"]]
    shown = [row for row in shown if row["ms"]]
    if not shown:
        return None
    intensity = [row["flops"] / row["bytes"] for row in shown]
    rate = [row["flops"] / row["ms"] / 1e6 for row in shown]
    ends = [min(intensity) / 2, arithmetic / bandwidth, max([*intensity, arithmetic / bandwidth]) * 2]
    roof = {
        "type": "scatter", "mode": "lines", "name": "device: copying and arithmetic", "x": ends,
        "y": [ends[0] * bandwidth, arithmetic, arithmetic], "line": {"color": "#888888", "width": 2},
        "hovertemplate": "%{y:.4~g} GFLOP/s",
    }  # fmt: skip
    folders = list(dict.fromkeys(row["kernel"].split("/")[0] for row in shown))
    traces = [roof]
    for index, folder in enumerate(folders):
        own = [k for k, row in enumerate(shown) if row["kernel"].startswith(f"{folder}/")]
        names = [shown[k]["kernel"] for k in own]
        colour = COLOURS[index % len(COLOURS)]
        traces.append(_scatter(folder, [intensity[k] for k in own], [rate[k] for k in own], names, colour))
    return {"data": traces, "layout": _layout("flops per byte", "GFLOP/s ↑")}


def _scatter(name: str, x: list[float], y: list[float], texts: list[str], colour: str) -> dict[str, Any]:
    return {
        "type": "scatter", "mode": "markers", "name": name, "x": x, "y": y, "text": texts,
        "marker": {"size": 8, "color": colour, "opacity": 0.75},
        "hovertemplate": "%{text}<br>%{x:.3~g}, %{y:.3~g}",
    }  # fmt: skip


def _layout(x: str, y: str) -> dict[str, Any]:
    return {
        "xaxis": {"title": {"text": x}, "type": "log"},
        "yaxis": {"title": {"text": y}, "type": "log"},
        "height": 480,
        "hovermode": "closest",
        "legend": {"orientation": "h", "y": -0.2},
        "margin": {"l": 70, "r": 20, "t": 10, "b": 60},
    }


# Heading, column, factor, format.
SHOWN = (
    ("kernel", "kernel", None, "{}"),
    ("input", "input", None, "{}"),
    ("variant", "variant", None, "{}"),
    ("ms", "ms", 1, "{:.3g}"),
    ("Mitems/s", "items_per_s", 1e-6, "{:,.3g}"),
    ("of copy %", "copy_share", 100, "{:.3g}"),
    ("of arithmetic %", "arithmetic_share", 100, "{:.2g}"),
    ("max error", "max_error", 1, "{:.2g}"),
    ("mean error", "mean_error", 1, "{:.2g}"),
    ("99.9 % ULP", "p999_ulp", 1, "{:,.3g}"),
    ("max ULP", "max_ulp", 1, "{:,.3g}"),
    ("misassigned", "misassigned", 1, "{:,.0f}"),
    ("of", "whole_values", 1, "{:,.0f}"),
)


def _table(rows: list[Row]) -> str:
    head = "".join(f"<th>{name}</th>" for name, *_ in SHOWN)
    lines = []
    for row in rows:
        cells = []
        for _, column, factor, form in SHOWN:
            value = row[column]
            shown = value if factor is None or value is None else value * factor
            text = "" if shown is None else form.format(shown)
            cells.append(f'<td data-value="{"" if shown is None else escape(str(shown))}">{escape(text)}</td>')
        lines.append(f"<tr>{''.join(cells)}</tr>")
    return (
        f'<div class="scroll tall" tabindex="0"><table class="words words-3 sortable"><thead><tr>{head}</tr></thead>'
        f"<tbody>{''.join(lines)}</tbody></table></div>"
    )
