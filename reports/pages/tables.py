"""The report's tables: headline numbers per method, formatted for people, the best of each column marked."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from shading_atlas_bench.reports.analysis.judged import Judged, displayed
from shading_atlas_bench.reports.charts.figures import arrow, coding_label
from shading_atlas_bench.reports.pages.texts import escape
from shading_atlas_bench.reports.store.columns import BY_NAME, summary_columns
from shading_atlas_bench.reports.store.labels import Key, Labels

Row = dict[str, Any]
SUMMARY_BY_NAME = {column.name: column for column in summary_columns()}
NONE = "\u2013"  # an en dash, as between the ends of an interval
OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]*(?: [\d.]*\d)?")
BETWEEN_PARTS = re.compile(r"(?<=\w)(?=[@\[])|(?<=,)(?=[a-z])")  # of a label: name, @published, [a=1, b=2]
THIN = "\u202f"  # between groups of three digits


@dataclass(frozen=True)
class Shown:
    """A measure in a headline table: its column, its header, and what it is multiplied with for the unit shown.

    statistic: what is large in a cell. A median has its interval below it, and then mean and largest value; a mean has
    the median below it. part: whether it is a part of packing, which a method can move from one to another, from the
    device to the host: only their sum says who is faster.
    """

    name: str
    header: str
    unit: str = ""
    scale: float = 1.0
    statistic: str = "median"
    part: bool = False


WORK = (
    Shown("samples", "samples"),
    Shown("structs_ms", "structures", "ms", part=True),
    Shown("gather_ms", "gather", "ms", part=True),
    Shown("server_ms", "server", "ms", part=True),
    Shown("serialise_ms", "host", "ms", part=True),
    Shown("wall_ms", "packing", "ms"),
    Shown("client_ms", "client", "ms"),
    Shown("fill", "atlas fill", "%", 100),
    Shown("coherence", "coherence", "%", 100),
)
QUALITY = (
    Shown("flip", "FLIP"),
    Shown("dssim", "DSSIM"),
    Shown("iwssim", "IW-SSIM"),
    Shown("psnr", "PSNR", "dB"),
    Shown("delta_e", "ΔE 2000"),
    Shown("stretch_l2", "stretch L2", "px/texel"),
    Shown("missing_px", "not in PVS", "%", 100),
    Shown("holes_px", "holes", "%", 100),
)
SIZE = (
    Shown("bytes_total", "sent", "kB/frame", 1e-3, "mean"),
    Shown("bytes_total", "sent", "kbit/s", 1, "kbit_s"),
    Shown("bytes_total", "largest", "kB", 1e-3, "max"),
    Shown("bytes_total", "keyframe", "kB", 1e-3, "key"),
    Shown("bytes_total", "whole run", "MB", 1e-6, "total"),
    Shown("bytes_video", "video", "kB/frame", 1e-3, "mean"),
    Shown("bytes_alpha", "opacity", "kB/frame", 1e-3, "mean"),
    Shown("bytes_metadata", "metadata", "kB/frame", 1e-3, "mean"),
    Shown("bytes_geometry", "geometry", "kB/frame", 1e-3, "mean"),
    Shown("compression_ratio", "video / raw", "%", 100, "mean"),
)
MARK = (
    "Arrows point in the better direction; a method is marked where it beats every other that has such a value, with "
    "95 % confidence."
)


def headline_tables(rows: list[Row], summaries: list[Row], labels: Labels) -> list[tuple[str, str]]:
    """Caption and table of work and time, quality, and size, one line per method (and displayed coding)."""
    shown = {key: displayed(rows, summaries, key) for key in labels}
    firsts = [lines[0] for lines in shown.values()]
    judged = [line for lines in shown.values() for line in lines]
    coded = [line for line in judged if line.coding[0] != "none" or len(shown[line.key]) == 1]
    frames = {key: _frames(rows, key) for key in labels}
    return [
        ("Work, time and use of the atlas per frame: medians of the measured frames, below them their 95 % interval, "
         f"mean and largest value. {MARK} Of packing only the whole is marked: its parts are device time of structures "
         "and gathering, together the server's, and the host's, and a method can move work from one to another.",
         _measures(firsts, WORK, labels, frames, coding=False)),
        ("Error of the client's picture against the reference, with and without video coding; numbers as above, marked "
         "among those of the same coding.",
         _measures(judged, QUALITY, labels, frames)),
        ("Everything sent per frame at the displayed rate, then its parts: means over the frames after the keyframe, "
         "below them their medians. The keyframe, with which a client begins, stands apart.",
         _measures(coded, SIZE, labels, frames)),
    ]  # fmt: skip


def _frames(rows: list[Row], key: Key) -> str:
    """How many frames of a method are ok, as `11 of 12`; a frame is ok if all its rows are."""
    by_frame: dict[int, bool] = {}
    for row in rows:
        if (row["method"], row["variant"]) == key:
            by_frame[row["frame"]] = by_frame.get(row["frame"], True) and row["status"] == "ok"
    good = sum(by_frame.values())
    kind = "" if good == len(by_frame) else ' class="bad"'
    return f"<td{kind}>{good} of {len(by_frame)}</td>"


def _measures(
    lines: list[Judged], columns: tuple[Shown, ...], labels: Labels, frames: dict[Key, str], coding: bool = True
) -> str:
    """A line per method or, where some are shown in several codings, per coding, whose rivals are of the same."""
    several = len({line.key for line in lines}) < len(lines)
    columns = tuple(c for c in columns if any(line.summary[f"{c.name}_{c.statistic}"] is not None for line in lines))
    head = ["<th>method</th>", "<th>coding</th>" if coding else "<th>frames ok</th>"]
    head += [_header(column) for column in columns]
    body = []
    for line in lines:
        rivals = [o for o in lines if o.key != line.key and (o.coding == line.coding or not several)]
        second = f"<td>{escape(coding_label(*line.coding))}</td>" if coding else frames[line.key]
        cells = [_cell(line, column, rivals) for column in columns]
        body.append(f"<tr><th>{prose(labels[line.key])}</th>{second}{''.join(cells)}</tr>")
    return _wrap(head, body, "numbers")


def _header(column: Shown) -> str:
    known = SUMMARY_BY_NAME[f"{column.name}_{column.statistic}"]
    meaning = f"{known.meaning}; {column.name}: {BY_NAME[column.name].meaning}"
    unit = f"<small>{column.unit}</small>" if column.unit else ""
    return f'<th title="{escape(meaning)}">{column.header}&nbsp;{arrow(known.better)}{unit}</th>'


def _cell(line: Judged, column: Shown, rivals: list[Judged]) -> str:
    whole = BY_NAME[column.name].type is int and column.scale == 1
    found = {
        part: number(value * column.scale, whole)
        for part in ("median", "low", "high", "mean", "max", column.statistic)
        if (value := line.summary[f"{column.name}_{part}"]) is not None
    }
    if column.statistic not in found:
        return f"<td>{NONE}</td>"
    below = []
    if column.statistic == "median" and found["median"] != found["max"]:
        if "low" in found and found["low"] != found["high"]:
            below.append(f"{found['low']}{NONE}{found['high']}")
        below += [f"mean {found['mean']}", f"max {found['max']}"]
    elif column.statistic == "mean" and found["median"] != found["mean"]:
        below.append(f"median {found['median']}")
    judged = column.statistic in ("median", "mean") and not column.part
    kind = ' class="best"' if judged and line.beats_all(rivals, column.name) else ""
    return f"<td{kind}>{found[column.statistic]}{''.join(f'<small>{text}</small>' for text in below)}</td>"


def prose(text: str) -> str:
    """Text as HTML: options, `--frames 61`, are not broken at their hyphens, and methods' labels only between parts."""
    return OPTION.sub(r'<span class="option">\g<0></span>', BETWEEN_PARTS.sub("<wbr>", escape(text)))


def table(head: list[str], lines: list[list[str]], texts: int) -> str:
    """A plain table; the first `texts` columns are words, the others numbers."""
    cells = [f"<th>{escape(text)}</th>" for text in head]
    body = ["<tr>" + "".join(f"<td>{prose(text)}</td>" for text in line) + "</tr>" for line in lines]
    return _wrap(cells, body, f"words words-{texts}")


def _wrap(head: list[str], body: list[str], kind: str) -> str:
    return (
        f'<div class="scroll" tabindex="0"><table class="{kind}"><thead><tr>{"".join(head)}</tr></thead>'
        f"<tbody>{''.join(body)}</tbody></table></div>"
    )


def number(value: float, whole: bool = False) -> str:
    """A number with about four significant digits and grouped thousands, in powers of ten from 1e15 on only; whole ones
    as such."""
    size = abs(value)
    if size >= 1e15:  # beyond what a float has whole digits for
        return f"{value:.3e}"
    if value == 0 or (whole and value == int(value)) or size >= 1000:
        return f"{value:,.0f}".replace(",", THIN)
    if size < 0.0001:
        return "<0.0001" if value > 0 else ">-0.0001"
    digits = 1 if size >= 100 else 2 if size >= 10 else 3 if size >= 1 else 4
    return f"{value:.{digits}f}"


def ranges(frames: set[int]) -> str:
    """Frame numbers, runs of them shortened: 4, 7-9."""
    parts: list[list[int]] = []
    for frame in sorted(frames):
        if parts and frame == parts[-1][-1] + 1:
            parts[-1].append(frame)
        else:
            parts.append([frame])
    return ", ".join(str(part[0]) if len(part) == 1 else f"{part[0]}-{part[-1]}" for part in parts)


def folded_lists(lists: dict[str, dict[str, str]]) -> list[str]:
    """Names and values, folded away under their titles; nothing for a list that is empty."""
    return [
        f"<details><summary>{title}</summary>{table(['name', 'value'], [list(item) for item in values.items()], 2)}"
        "</details>"
        for title, values in lists.items()
        if values
    ]
