"""The report's tables: headline numbers per method, formatted for people, the best of each column marked."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from typing import Any

from reports.charts import Key, Labels, arrow, coding_label, displayed_codings
from reports.columns import BY_NAME

Row = dict[str, Any]
NONE = "\u2013"  # an en dash, as between the ends of an interval
THIN = "\u202f"  # between groups of three digits


@dataclass(frozen=True)
class Shown:
    """A measure in a headline table: its column, its header, and what it is multiplied with for the unit shown."""

    name: str
    header: str
    unit: str = ""
    scale: float = 1.0


WORK = (
    Shown("samples", "samples"),
    Shown("structs_ms", "structures", "ms"),
    Shown("gather_ms", "gather", "ms"),
    Shown("server_ms", "server", "ms"),
    Shown("client_ms", "client", "ms"),
    Shown("encode_ms", "encode", "ms"),
    Shown("decode_ms", "decode", "ms"),
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
    Shown("bytes_video", "video", "kB", 1e-3),
    Shown("bytes_metadata", "metadata", "kB", 1e-3),
    Shown("bytes_geometry", "geometry", "kB", 1e-3),
    Shown("bytes_total", "total", "kB", 1e-3),
    Shown("compression_ratio", "video / raw", "%", 100),
    Shown("fill", "atlas fill", "%", 100),
    Shown("coherence", "coherence", "%", 100),
)
MARK = "The arrow points in the better direction; the best of several methods is marked."


def headline_tables(rows: list[Row], summaries: list[Row], labels: Labels) -> list[tuple[str, str]]:
    """Caption and table of work and time, quality, and size, one line per method (and displayed coding)."""
    shown = {key: _displayed(rows, summaries, key) for key in labels}
    firsts = [(key, found[0]) for key, found in shown.items()]
    judged = [(key, summary) for key, found in shown.items() for summary in found]
    coded = [(key, summary) for key, summary in judged if summary["codec"] != "none" or len(shown[key]) == 1]
    frames = {key: _frames(rows, key) for key in labels}
    return [
        (f"Work and time per frame: medians over ok frames, small print their 95 % interval. {MARK}",
         _measures(firsts, WORK, labels, frames, coding=False)),
        (f"Error of the client's picture against the reference, with and without video coding. {MARK}",
         _measures(judged, QUALITY, labels, frames)),
        (f"Size of a frame at the displayed rate, and use of the atlas. {MARK}",
         _measures(coded, SIZE, labels, frames)),
    ]  # fmt: skip


def _displayed(rows: list[Row], summaries: list[Row], key: Key) -> list[Row]:
    """The summaries of the codings whose pictures were judged, those with video coding first."""
    codings = displayed_codings([row for row in rows if (row["method"], row["variant"]) == key])
    own = [row for row in summaries if (row["method"], row["variant"]) == key]
    found = [row for row in own if (row["codec"], row["crf"]) in codings]
    return sorted(found, key=lambda row: row["codec"] == "none")


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
    lines: list[tuple[Key, Row]],
    columns: tuple[Shown, ...],
    labels: Labels,
    frames: dict[Key, str],
    coding: bool = True,
) -> str:
    columns = tuple(c for c in columns if any(row[f"{c.name}_median"] is not None for _, row in lines))
    head = ["<th>method</th>", *(["<th>coding</th>"] if coding else ["<th>frames ok</th>"])]
    head += [_header(column) for column in columns]
    body = []
    for key, row in lines:
        rivals = [other for _, other in lines if (other["codec"], other["crf"]) == (row["codec"], row["crf"])]
        second = f"<td>{escape(coding_label(row['codec'], row['crf']))}</td>" if coding else frames[key]
        cells = [_cell(row, column, rivals) for column in columns]
        body.append(f"<tr><th>{escape(labels[key])}</th>{second}{''.join(cells)}</tr>")
    return _wrap(head, body, "numbers")


def _header(column: Shown) -> str:
    known = BY_NAME[column.name]
    unit = f"<small>{column.unit}</small>" if column.unit else ""
    return f'<th title="{escape(known.meaning)}">{column.header}&nbsp;{arrow(known.better)}{unit}</th>'


def _cell(row: Row, column: Shown, rivals: list[Row]) -> str:
    middle, low, high = (row[f"{column.name}_{part}"] for part in ("median", "low", "high"))
    if middle is None:
        return f"<td>{NONE}</td>"
    values = [other[f"{column.name}_median"] for other in rivals if other[f"{column.name}_median"] is not None]
    best = min(values) if BY_NAME[column.name].better == "lower" else max(values)
    kind = ' class="best"' if middle == best and len(set(values)) > 1 else ""
    interval = ""
    if low is not None:
        interval = f"<small>{number(low * column.scale)}{NONE}{number(high * column.scale)}</small>"
    return f"<td{kind}>{number(middle * column.scale)}{interval}</td>"


def table(head: list[str], lines: list[list[str]], texts: int) -> str:
    """A plain table; the first `texts` columns are words, the others numbers."""
    cells = [f"<th>{escape(text)}</th>" for text in head]
    body = ["<tr>" + "".join(f"<td>{escape(text)}</td>" for text in line) + "</tr>" for line in lines]
    return _wrap(cells, body, f"words words-{texts}")


def _wrap(head: list[str], body: list[str], kind: str) -> str:
    return (
        f'<div class="scroll" tabindex="0"><table class="{kind}"><thead><tr>{"".join(head)}</tr></thead>'
        f"<tbody>{''.join(body)}</tbody></table></div>"
    )


def number(value: float) -> str:
    """A number with about four significant digits and grouped thousands, never in powers of ten."""
    if value == 0:
        return "0"
    if abs(value) >= 1000 or value == int(value):
        return f"{value:,.0f}".replace(",", THIN)
    digits = 1 if abs(value) >= 100 else 2 if abs(value) >= 10 else 3 if abs(value) >= 1 else 4
    return f"{value:.{digits}f}" if abs(value) >= 0.0001 else "<0.0001"


def ranges(frames: set[int]) -> str:
    """Frame numbers, runs of them shortened: 4, 7-9."""
    parts: list[list[int]] = []
    for frame in sorted(frames):
        if parts and frame == parts[-1][-1] + 1:
            parts[-1].append(frame)
        else:
            parts.append([frame])
    return ", ".join(str(part[0]) if len(part) == 1 else f"{part[0]}-{part[-1]}" for part in parts)
