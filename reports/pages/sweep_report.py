"""The report of a sweep: sweep.csv and one HTML file, whose first plot is error over server time."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from shading_atlas_bench.reports.analysis.fronts import pareto_front
from shading_atlas_bench.reports.analysis.sweep import (
    COSTS,
    ERRORS,
    TOLD,
    Point,
    Sweep,
    candidates,
    cost_column,
    groups,
    read_points,
    read_sweep,
    read_told,
    write_sweep_csv,
)
from shading_atlas_bench.reports.charts.figures import COLOURS, Figure, arrow
from shading_atlas_bench.reports.pages.html import caption, facts_list, fill_page, moment, section
from shading_atlas_bench.reports.pages.sweep_words import CODING_NAMES, COST_NAMES, NAMES, RULE, verdict
from shading_atlas_bench.reports.pages.tables import NONE, folded_lists, number, prose, table
from shading_atlas_bench.reports.pages.texts import escape
from shading_atlas_bench.reports.store.columns import BY_NAME
from shading_atlas_bench.reports.store.csv_files import replace_file
from shading_atlas_bench.reports.store.results import Store, flat

HEAD = (
    "server ms", "samples", "kB/frame", "kbit/s", "largest kB", "keyframe kB", "MB", "FLIP",
)  # fmt: skip
LOG_FROM = 10.0  # largest over smallest cost, from which on the axis is logarithmic


def write_sweep(folder: Path) -> list[Point]:
    """Write `folder`/sweep.csv and report.html from the runs of the sweep, and return its points.

    Raises StoreError if the folder holds no sweep.
    """
    sweep, points = read_sweep(folder), read_points(folder)
    with Store(folder, must_exist=True) as store:
        notes = {name: store.notes.under(name) for name in ("environment", "device", "warning", "skipped", "scene")}
        plan = flat(store.plan() or {})
    write_sweep_csv(folder, points)
    contenders = sorted({point.row["contender"] for point in points})
    colours = {name: COLOURS[i % len(COLOURS)] for i, name in enumerate(contenders)}
    sections = [
        _warnings(
            sweep,
            [*notes["warning"].values(), *(text for each in (*TOLD, "rare") for text in read_told(folder, each))],
            points,
        ),
        _plot(sweep, points),
        _fronts(points),
        _troubles(points),
        _cells(points),
        _details(sweep, notes, plan),
    ]
    title = f"Sweep of {points[0].row['scene']}" if points else "An empty sweep"
    page = fill_page(
        title, _header(sweep, points, notes), sections, {"sweep": figures(points, colours)}, {"frames": []}
    )
    replace_file(folder / "report.html", page)
    return points


def _costs(points: Sequence[Point]) -> list[str]:
    """Costs with values; server time only where it can be compared."""
    return [cost for cost in COSTS if any(candidates(points, cost, error)[0] for error in ERRORS)]


def _errors(points: Sequence[Point]) -> list[str]:
    return [name for name in ERRORS if any(point.row[f"{name}_median"] is not None for point in points)]


def figures(points: Sequence[Point], colours: dict[str, str]) -> dict[str, Figure]:
    """The plot and its sentence for each error, cost, coding and condition, joined by `/`, as the choosers are."""
    found = {}
    for (condition, coding), own in groups(points).items():
        for error in _errors(points):
            for cost in _costs(points):
                found[f"{error}/{cost}/{coding}/{condition}"] = _figure(own, cost, error, colours)
    return {key: figure for key, figure in found.items() if figure}


def _figure(points: Sequence[Point], cost: str, error: str, colours: dict[str, str]) -> Figure | None:
    usable, known = candidates(points, cost, error)
    overflows = [
        point
        for point in points
        if point.row["status"] == "overflow"
        and point.row[cost_column(cost)] is not None
        and point.row[f"{error}_median"] is not None
        and (cost != "server_ms" or point.row["comparable"] == "yes")
    ]
    traces = []
    for contender, colour in colours.items():
        own = [index for index, point in enumerate(usable) if point.row["contender"] == contender]
        front = [own[i] for i in pareto_front([(known[index].cost, known[index].error) for index in own])]
        if own:
            traces.append(_line([usable[index] for index in front], cost, error, contender, colour))
            traces.append(_marks([usable[index] for index in own], cost, error, contender, colour))
        lost = [point for point in overflows if point.row["contender"] == contender]
        if lost:
            traces.append(_marks(lost, cost, error, contender, colour, overflow=True, alone=not own))
    if not traces:
        return None
    layout, says = _layout([*usable, *overflows], cost, error), prose(verdict(known, cost, error))
    return {"data": traces, "layout": layout, "says": says}


def _values(points: Sequence[Point], name: str) -> list[float]:
    scale = COST_NAMES[name][2] if name in COST_NAMES else 1.0
    return [point.row[cost_column(name)] * scale for point in points]


def _line(points: Sequence[Point], cost: str, error: str, contender: str, colour: str) -> dict[str, Any]:
    """A method's Pareto front: the lowest error within each budget, so a step at every cell."""
    return {
        "type": "scatter", "mode": "lines", "name": contender, "legendgroup": contender, "hoverinfo": "skip",
        "x": _values(points, cost), "y": _values(points, error), "showlegend": False,
        "line": {"color": colour, "width": 2.5, "shape": "hv"},
    }  # fmt: skip


def _marks(
    points: Sequence[Point],
    cost: str,
    error: str,
    contender: str,
    colour: str,
    overflow: bool = False,
    alone: bool = False,
) -> dict[str, Any]:
    """A method's cells with their intervals; those with overflow as faint crosses."""
    symbol = {"symbol": "x-thin-open", "size": 9, "line": {"width": 2}} if overflow else {"symbol": "circle", "size": 8}
    name = f"{contender}, overflow" if overflow else contender
    cost_name, unit, _ = COST_NAMES[cost]
    return {
        "type": "scatter", "mode": "markers", "name": name, "legendgroup": name if overflow else contender,
        "x": _values(points, cost), "y": _values(points, error), "showlegend": True,
        "error_x": _whiskers(points, cost, colour), "error_y": _whiskers(points, error, colour),
        "marker": {"color": colour, **symbol}, "opacity": 0.7 if overflow else 0.9,
        "customdata": [_hover(point) for point in points],
        "hovertemplate": f"<b>{contender}</b><br>%{{customdata}}<br>{cost_name} %{{x:,.4~g}} {unit}, "
        f"{NAMES[error]} %{{y:.4~g}}<extra></extra>",
    }  # fmt: skip


def _whiskers(points: Sequence[Point], name: str, colour: str) -> dict[str, Any]:
    """Half-transparent ends of the 95 % intervals of medians; none where a cell has no interval, or a mean is drawn."""
    if cost_column(name) != f"{name}_median":
        return {"visible": False}
    scale = COST_NAMES[name][2] if name in COST_NAMES else 1.0
    ends: dict[str, list[float]] = {"array": [], "arrayminus": []}
    for point in points:
        low, middle, high = (point.row[f"{name}_{part}"] for part in ("low", "median", "high"))
        ends["array"].append(0 if high is None else (high - middle) * scale)
        ends["arrayminus"].append(0 if low is None else (middle - low) * scale)
    shown = any(value for values in ends.values() for value in values)
    return {
        "type": "data",
        "symmetric": False,
        "thickness": 1,
        "width": 2,
        "color": f"{colour}66",
        "visible": shown,
    } | ends


def _hover(point: Point) -> str:
    """What was varied, line by line, and how it was timed."""
    lines = [escape(text) for text in point.label.split(", ")]
    row = point.row
    if row["status"] != "ok":
        lines.append(escape(f"{row['status']}, frames: {row['frames'] - row['frames_ok']} of {row['frames']}"))
    if row["repetitions"] > 1:
        lines.append(f"{row['repetitions']} repetitions ({escape(row['stop'])})")
    return "<br>".join(lines)


def _layout(points: Sequence[Point], cost: str, error: str) -> dict[str, Any]:
    name, unit, _ = COST_NAMES[cost]
    title = f"{name} per frame ({unit}) ↓"
    values = _values(points, cost)
    better = BY_NAME[error].better
    y_unit = {"psnr": " (dB)", "stretch_l2": " (pixels per texel)"}.get(error, "")
    x_axis: dict[str, Any] = {"title": {"text": title}, "automargin": True, "zeroline": False}
    if min(values) > 0 and max(values) > LOG_FROM * min(values):
        ticks = [digit * 10**power for power in range(-3, 10) for digit in (1, 2, 5)]
        x_axis |= {"type": "log", "tickvals": ticks, "ticktext": [f"{tick:,g}" for tick in ticks]}
    else:
        x_axis |= {"type": "linear", "rangemode": "tozero"}
    y_axis = {"title": {"text": f"{NAMES[error]}{y_unit} {arrow(better)}"}, "automargin": True, "zeroline": False}
    return {
        "height": 520,
        "hovermode": "closest",
        "showlegend": True,
        "legend": {"orientation": "h", "y": 1.03, "yanchor": "bottom", "x": 0},
        "margin": {"l": 64, "r": 16, "t": 28, "b": 48},
        "xaxis": x_axis,
        "yaxis": y_axis | ({"rangemode": "tozero"} if better == "lower" else {}),
    }


def _header(sweep: Sweep, points: Sequence[Point], notes: dict[str, dict[str, str]]) -> str:
    rows, settings = [point.row for point in points], sweep["settings"]
    scenes = list(dict.fromkeys(point.row["scene"] for point in points))
    counts = {status: 0 for status in ("ok", "overflow")}
    cells = {(p.condition, p.row["method"], p.row["variant"], p.row["varied"]): p.row["status"] for p in points}
    for status in cells.values():
        counts[status] = counts.get(status, 0) + 1
    facts = {
        "Cells": f"{len(cells)}: " + ", ".join(f"{count} {name}" for name, count in counts.items() if count),
        "Varied": "; ".join(sweep["vary"]) or "each parameter in turn",
        "Frames": str(sweep["frames"]),
        "Client": _same(rows, "{width} x {height} px, {fov:g}°"),
        "View cell": _same(rows, "{cell_radius:g} m, {cell_fov:g}°"),
        "Latency": _same(rows, "{latency:g} ms"),
        "Atlas": _same([row for row in rows if row["atlas_width"]], "{atlas_width} x {atlas_height} texels"),
        "Samples asked for": _same(
            [row for row in rows if row["samples_per_pixel"]], "{samples_per_pixel:g} per pixel"
        ),
        "Coding": _same([row for row in rows if row["codec"] == "h264"], "H.264, CRF {crf}"),
        "Seed": str(settings["seed"]),
        "Triangles": notes["environment"].get("triangles", ""),
        "Device": notes["device"].get("name", ""),
        "Driver": notes["device"].get("version", ""),
        "Machine": notes["environment"].get("machine", ""),
        "Date": moment(notes["environment"].get("date", "")),
    }
    title = f"{escape(', '.join(scenes))} <span>swept along</span> {escape(settings['path'])}"
    return f"<h1>{title}</h1>{facts_list(facts)}"


def _same(rows: Sequence[dict[str, Any]], text: str) -> str:
    """`text` filled from the rows where it is the same for all, else a word that it was varied."""
    filled = {text.format_map(row) for row in rows}
    return filled.pop() if len(filled) == 1 else "varied" if filled else ""


def _warnings(sweep: Sweep, texts: list[str], points: Sequence[Point]) -> str:
    """A banner for what a reader must know before believing a number."""
    if not sweep["timed"]:
        texts.append("Cells ran side by side (--workers): their times do not compare, and are in no plot.")
    unfinished = {(p.condition, p.row["varied"], p.row["variant"]) for p in points if p.row["status"] == "unfinished"}
    if unfinished:
        texts.append(f"{len(unfinished)} cells are not finished: the same command goes on with them.")
    items = "".join(f"<li>{prose(text)}</li>" for text in texts)
    return f'<ul class="warnings" role="note">{items}</ul>' if texts else ""


def _plot(sweep: Sweep, points: Sequence[Point]) -> str:
    conditions, codings = ({key[place]: None for key in groups(points)} for place in (0, 1))
    choosers = [
        _chooser("Error", {name: NAMES[name] for name in _errors(points)}),
        _chooser("over", {name: COST_NAMES[name][0] for name in _costs(points)}),
        _chooser("Picture", {name: CODING_NAMES[name] for name in codings}),
        _chooser("Work", {name: name or "as above" for name in conditions}, hidden=len(conditions) == 1),
    ]
    times = "Times are medians over repetitions, with their 95 % intervals; " if sweep["timed"] else ""
    errors = "errors are medians over the frames, with theirs where there are 6 frames or more. "
    medians = times + errors if times else errors.capitalize()
    return section(
        "front",
        "Error over run time" if sweep["timed"] else "Error over work",
        caption(
            f"Each point is a cell of the grid, each line a method's Pareto front: the best is at the lower left (for "
            f"PSNR and IW-SSIM, at the upper left). {medians}Bytes are means over the frames after "
            "the keyframe. Crosses left triangles out: they are on no front."
        ),
        f'<p class="choosers">{"".join(choosers)}</p>',
        '<div class="chart" data-figure="sweep"></div>',
        '<p class="verdict" data-says="sweep" aria-live="polite"></p>',
        caption(RULE),
    )


def _chooser(name: str, options: dict[str, str], hidden: bool = False) -> str:
    items = "".join(f'<option value="{escape(value)}">{escape(text)}</option>' for value, text in options.items())
    return (
        f'<label class="chooser"{" hidden" * hidden}>{name} <select data-chooses="sweep">{items}</select></label> '
        if items
        else ""
    )


def _fronts(points: Sequence[Point]) -> str:
    """The cells on each method's front of FLIP over server time, or over samples where times do not compare."""
    parts = []
    name = "time" if any(point.row["pareto_time"] for point in points) else "samples"
    for (condition, coding), own in groups(points).items():
        lines = [_line_of(p) for p in _sorted(own, name) if p.row[f"pareto_{name}"] in ("method", "all")]
        if lines:
            what = ", ".join(filter(None, (condition, CODING_NAMES[coding])))
            head = ["method", "parameters", *HEAD, "front of all"]
            parts.append(caption(f"{what[0].upper()}{what[1:]}.") + table(head, lines, texts=2))
    if not parts:
        return ""
    over = {"time": "server time", "samples": "samples"}[name]
    return section(
        "fronts",
        "The Pareto fronts",
        caption(
            f"Cells on the front of FLIP over {over}, by method. Medians, but kB/frame and kbit/s are means over the "
            "frames after the keyframe."
        ),
        *parts,
    )


def _sorted(points: Sequence[Point], name: str) -> list[Point]:
    cost = next(cost for cost, short in COSTS.items() if short == name)
    return sorted(points, key=lambda point: (point.row["contender"], point.row[cost_column(cost)] or 0))


def _line_of(point: Point) -> list[str]:
    row = point.row
    time = _with_interval(row, "server_ms") if row["comparable"] == "yes" else ""
    best = row["pareto_time" if row["comparable"] == "yes" else "pareto_samples"] == "all"
    return [
        row["contender"],
        point.label,
        time,
        _number(row, "samples_median"),
        _number(row, "bytes_total_mean", 1e-3),
        _number(row, "bytes_total_kbit_s"),
        _number(row, "bytes_total_max", 1e-3),
        _number(row, "bytes_total_key", 1e-3),
        _number(row, "atlas_mb_median"),
        _number(row, "flip_median"),
        "yes" if best else "",
    ]


def _number(row: dict[str, Any], name: str, scale: float = 1.0) -> str:
    value = row[name]
    return "" if value is None else number(value * scale, whole=name == "samples_median")


def _with_interval(row: dict[str, Any], name: str) -> str:
    text = _number(row, f"{name}_median")
    low, high = row[f"{name}_low"], row[f"{name}_high"]
    return text if low is None else f"{text} ({number(low)}{NONE}{number(high)})"


def _troubles(points: Sequence[Point]) -> str:
    """Cells that are no points of the plot, and why."""
    lines: dict[tuple[str, str, str, str], list[str]] = {}
    for point in points:
        row = point.row
        if row["status"] != "ok":
            key = (row["method"], row["variant"], point.condition, point.label)
            frames = f"{row['frames'] - row['frames_ok']} of {row['frames']}"
            lines.setdefault(key, [row["contender"], point.label, row["status"], frames, row["reason"] or ""])
    stopped = {
        (p.row["method"], p.row["variant"], p.condition, p.label): p
        for p in points
        if p.row["status"] == "ok" and p.row["stop"].startswith(("failed", "timeout"))
    }
    for key, point in stopped.items():
        lines[key] = [point.row["contender"], point.label, "timing", "", f"Timing stopped: {point.row['stop']}."]
    if not lines:
        return section("failures", "Cells without a point", '<p class="fine">All frames of all cells are ok.</p>')
    return section(
        "failures",
        "Cells without a point",
        caption("Cells with a frame that is not ok: crosses in the plot if triangles were left out, absent otherwise."),
        table(["method", "cell", "status", "frames", "reason"], list(lines.values()), texts=5),
    )


def _cells(points: Sequence[Point]) -> str:
    """All cells, folded away."""
    head = ["method", "parameters", "picture", "status", *HEAD, "stop"]
    lines = []
    for point in points:
        method, label, *values, _ = _line_of(point)
        row = point.row
        lines.append([method, label, CODING_NAMES[row["coding"]], row["status"], *values, row["stop"]])
    summary = f"<summary>{len(lines)} rows; sweep.csv has all their columns</summary>"
    return section("cells", "All cells", f"<details>{summary}{table(head, lines, texts=4)}</details>")


def _details(sweep: Sweep, notes: dict[str, dict[str, str]], plan: dict[str, Any]) -> str:
    lists = {
        "Left out of the grid": dict(sweep["left_out"]),
        "When timing stops": {name: str(value) for name, value in sweep["rule"].items()},
        "Skipped for this scene": notes["skipped"],
        "Scene": notes["scene"],
        "Plan": {name: json.dumps(value, ensure_ascii=False) for name, value in plan.items()},
        "Device": notes["device"],
        "Machine and software": notes["environment"],
    }
    return section("details", "How it was run", *folded_lists(lists))
