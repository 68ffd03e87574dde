"""The report's charts, as Plotly figures in plain JSON values; the page adds the colours of text and grid."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

from shading_atlas_bench.reports.analysis.judged import displayed_codings
from shading_atlas_bench.reports.analysis.rates import quality_name, rate_curve
from shading_atlas_bench.reports.store.columns import (
    BY_NAME,
    MEASURED_STATUSES,
    PICTURE_METRICS,
    RATE_METRICS,
    Column,
)
from shading_atlas_bench.reports.store.labels import Key, Labels
from shading_atlas_bench.reports.store.middle import median

Row = dict[str, Any]
Figure = dict[str, Any]

# Told apart by people with colour vision deficiencies, on light and on dark.
COLOURS = ("#0a84c6", "#e08a00", "#009e73", "#d1495b", "#8a6fd1", "#a68a2a", "#56b4e9", "#cc79a7")
DASHES = ("solid", "dot", "dashdot", "longdash")
# One hue per group of stages, in degrees; stages of a group differ in lightness.
GROUP_HUES = {"structs": 212, "gather": 32, "client": 160}
OTHER_HUE = 340

PER_FRAME = (
    *PICTURE_METRICS, "stretch_l2", "missing_px", "holes_px", "server_ms", "client_ms", "samples", "bytes_total",
    "bytes_video", "bytes_metadata", "bytes_geometry", "fill", "coherence",
)  # fmt: skip


def coding_label(codec: str | None, crf: int | None) -> str:
    """A coding as people say it: `CRF 25`, `JPEG`, `lossless`."""
    if codec is None:
        return "not coded"
    if codec == "none":
        return "lossless"
    return f"CRF {crf}" if crf is not None else codec.upper()


def axis_title(column: Column) -> str:
    """The column's name, unit, and the better direction as an arrow."""
    unit = f" ({column.unit})" if column.unit else ""
    return f"{column.name}{unit} {arrow(column.better)}".strip()


def arrow(better: str) -> str:
    """An arrow for the better direction: down where lower is better."""
    return {"lower": "↓", "higher": "↑", "": ""}[better]


def error_over_time(summaries: list[Row], labels: Labels) -> Figure | None:
    """One mark per method and displayed coding: median FLIP over median server time, with their intervals."""
    traces = []
    for index, (key, label) in enumerate(labels.items()):
        shown = [row for row in summaries if _key(row) == key and row["client_ms_median"] is not None]
        for row in shown:
            lossless = row["codec"] == "none"
            coding = coding_label(row["codec"], row["crf"])
            traces.append(
                {
                    "type": "scatter", "mode": "markers", "name": f"{label}, {coding}",
                    "x": [row["server_ms_median"]], "y": [row["flip_median"]],
                    "error_x": _interval(row, "server_ms", index), "error_y": _interval(row, "flip", index),
                    "marker": {
                        "color": _colour(index), "size": 13, "symbol": "circle-open" if lossless else "circle",
                        "line": {"width": 2.5, "color": _colour(index)},
                    },
                    "hovertemplate": "%{x:.3~g} ms, FLIP %{y:.4f}",
                }
            )  # fmt: skip
    return _figure(traces, "server time per frame (ms) ↓", "FLIP error ↓", from_zero=True)


def _interval(row: Row, name: str, index: int) -> dict[str, Any]:
    middle, low, high = (row[f"{name}_{part}"] for part in ("median", "low", "high"))
    if low is None or middle is None:
        return {"visible": False}
    ends = {"array": [high - middle], "arrayminus": [middle - low]}
    return {"type": "data", "symmetric": False, "thickness": 1.2, "width": 4, "color": _colour(index)} | ends


def stage_times(stages: list[Row], labels: Labels) -> Figure | None:
    """Median device time of each stage, stacked per method."""
    times: dict[str, dict[Key, list[float]]] = defaultdict(lambda: defaultdict(list))
    for row in stages:
        if row["ms"] is not None:
            times[row["stage"]][_key(row)].append(row["ms"])
    order = {group: place for place, group in enumerate(GROUP_HUES)}
    names = sorted(times, key=lambda name: order.get(_group(name), len(order)))
    bars = {
        name: (_stage_colour(name, names), [median(times[name][key]) if key in times[name] else None for key in labels])
        for name in names
    }
    return stacked_bars(bars, list(labels.values()), "device time per frame (ms) ↓")


def stacked_bars(
    bars: dict[str, tuple[str, list[float | None]]], labels: list[str], title: str, spare: int = 8
) -> Figure | None:
    """Bars from left to right, one line per label: colour and values of each part, by its name.

    spare: pixels that the legend takes per part.
    """
    traces = [
        {
            "type": "bar", "orientation": "h", "name": name, "y": labels, "x": values,
            "marker": {"color": colour}, "hovertemplate": "%{x:.3~g} ms",
        }
        for name, (colour, values) in bars.items()
    ]  # fmt: skip
    figure = _figure(traces, title, "")
    if figure:
        layout = figure["layout"]
        layout |= {
            "barmode": "stack",
            "hovermode": "closest",
            "bargap": 0.35,
            "height": 150 + 44 * len(labels) + spare * len(traces),
        }
        layout["yaxis"] |= {"autorange": "reversed", "showgrid": False, "ticksuffix": "  "}
        layout["legend"] |= {"traceorder": "normal"}
    return figure


def _group(stage: str) -> str:
    return stage.split("/")[0]


def _stage_colour(name: str, names: list[str]) -> str:
    group = [other for other in names if _group(other) == _group(name)]
    share = (group.index(name) + 0.5) / len(group)
    return f"hsl({GROUP_HUES.get(_group(name), OTHER_HUE)}, 62%, {36 + 36 * share:.0f}%)"


def per_frame(rows: list[Row], labels: Labels) -> dict[str, Figure]:
    """A chart over the frames for each measure of PER_FRAME that has values, by its name."""
    figures = {name: _over_frames(rows, labels, BY_NAME[name]) for name in PER_FRAME}
    return {name: figure for name, figure in figures.items() if figure}


def _over_frames(rows: list[Row], labels: Labels, column: Column) -> Figure | None:
    """Lines over the frames; a coding other than that of the first line of a method is drawn fainter."""
    traces = []
    for index, (key, label) in enumerate(labels.items()):
        codings = displayed_codings([row for row in rows if _key(row) == key])
        drawn: list[list[float | None]] = []
        for coding, frames in codings.items():
            values = [row[column.name] if row["status"] in MEASURED_STATUSES else None for row in frames]
            if all(value is None for value in values) or values in drawn:
                continue
            drawn.append(values)
            name = f"{label}, {coding_label(*coding)}" if column.kind in ("quality", "size") else label
            traces.append(
                {
                    "type": "scatter", "mode": "lines+markers", "name": name,
                    "x": [row["frame"] for row in frames], "y": values, "connectgaps": False,
                    "opacity": 1.0 if len(drawn) == 1 else 0.55,
                    "line": {"color": _colour(index), "width": 2, "dash": _dash(index, len(drawn))},
                    "marker": {"size": 5}, "hovertemplate": "%{y:.4~g}",
                }
            )  # fmt: skip
    return _figure(traces, "frame", axis_title(column))


def quality_over_rate(summaries: list[Row], labels: Labels) -> dict[str, Figure]:
    """A line per method through its rates, for each measure that every rate has, by its name; one point where no video
    codec takes what it sends."""
    figures = {measure: _over_bandwidth(summaries, labels, measure) for measure in RATE_METRICS}
    return {measure: figure for measure, figure in figures.items() if figure}


def _over_bandwidth(summaries: list[Row], labels: Labels, measure: str) -> Figure | None:
    traces = []
    for index, (key, label) in enumerate(labels.items()):
        curve = rate_curve(summaries, key, measure)
        if not curve:
            continue
        coded = any(point.crf is not None for point in curve)
        traces.append(
            {
                "type": "scatter", "mode": "lines+markers+text" if coded else "markers", "name": label,
                "x": [point.mbit for point in curve], "y": [point.quality for point in curve],
                "text": ["" if point.crf is None else f"{point.crf}" for point in curve], "textposition": "top center",
                "line": {"color": _colour(index), "width": 2, "dash": _dash(index, 1)},
                "marker": {
                    "size": 9, "symbol": "circle" if coded else "circle-open", "color": _colour(index),
                    "line": {"width": 2, "color": _colour(index)},
                },
                "hovertemplate": "%{x:,.3~g} Mbit/s, %{y:.4~g}" + ("<br>CRF %{text}" if coded else ""),
            }
        )  # fmt: skip
    quality = f"{quality_name(measure)} {arrow(BY_NAME[measure].better)}"
    figure = _figure(traces, "sent per second (Mbit/s) ↓", quality)
    if figure:
        ticks = [digit * 10**power for power in range(-3, 7) for digit in (1, 2, 5)]
        axis = {"type": "log", "tickvals": ticks, "ticktext": [f"{tick:,g}" for tick in ticks]}
        figure["layout"]["xaxis"] |= axis
        figure["layout"]["hovermode"] = "closest"
    return figure


def _key(row: Row) -> Key:
    return row["method"], row["variant"]


def _colour(index: int) -> str:
    return COLOURS[index % len(COLOURS)]


def _dash(index: int, nth: int) -> str:
    """The first line of each method is solid while there are colours; the others, and other codings, are not."""
    return DASHES[(index // len(COLOURS) + nth - 1) % len(DASHES)]


def _figure(traces: list[dict[str, Any]], x_title: str, y_title: str, from_zero: bool = False) -> Figure | None:
    if not traces:
        return None
    mode = {"rangemode": "tozero"} if from_zero else {}
    return {
        "data": traces,
        "layout": {
            "height": 400,
            "hovermode": "closest" if from_zero else "x unified",
            "showlegend": True,
            "legend": {"orientation": "h", "y": 1.03, "yanchor": "bottom", "x": 0},
            "margin": {"l": 64, "r": 16, "t": 28, "b": 48},
            "xaxis": {"title": {"text": x_title}, "automargin": True, "zeroline": False} | mode,
            "yaxis": {"title": {"text": y_title}, "automargin": True, "zeroline": False} | mode,
        },
    }
