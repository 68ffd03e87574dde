"""What `bench run` prints in the end: what a frame costs and sends, and what went wrong."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from shading_atlas_bench.harness.console import NARROWEST, counted, folded, make_console, make_table, styled
from shading_atlas_bench.harness.run.explain import FRAMES, ROUNDS
from shading_atlas_bench.reports.store.labels import Labels
from shading_atlas_bench.reports.store.middle import median
from shading_atlas_bench.reports.store.results import Store


def _kilobytes(value: float) -> str:
    """With a decimal where it tells something."""
    return f"{value:,.1f}" if value < 1000 else f"{value:,.0f}"


Row = dict[str, Any]
Column = tuple[str, str, float, Callable[[float], str]]  # of summary.csv: its name, heading, factor, format

# Where the console is narrow, the last ones are left out.
WORK: tuple[Column, ...] = (
    ("server_ms_median", "server ms", 1, "{:,.1f}".format),
    ("flip_median", "FLIP", 1, "{:.4f}".format),
    ("samples_median", "samples", 1, "{:,.0f}".format),
    ("frame_ms_median", "frame ms", 1, "{:,.1f}".format),
    ("fill_median", "fill", 1, "{:.2f}".format),
    ("coherence_median", "cohere", 1, "{:.2f}".format),
    ("dssim_median", "DSSIM", 1, "{:.4f}".format),
)
SIZES: tuple[Column, ...] = (
    ("bytes_total_mean", "kB/frame", 1e-3, _kilobytes),
    ("bytes_total_kbit_s", "kbit/s", 1, "{:,.0f}".format),
    ("flip_mean", "FLIP", 1, "{:.4f}".format),
    ("bytes_total_max", "largest", 1e-3, _kilobytes),
    ("bytes_total_key", "keyframe", 1e-3, _kilobytes),
    ("bytes_video_mean", "video", 1e-3, _kilobytes),
    ("bytes_alpha_mean", "alpha", 1e-3, _kilobytes),
    ("bytes_metadata_mean", "meta", 1e-3, _kilobytes),
    ("bytes_geometry_mean", "geom", 1e-3, _kilobytes),
)
NOTE_WORDS = {"scene": "note", "published": "published", "rare": "not seen", "warning": "warning"}
SPEED = (("structs_share", "structs/server", "{:.1%}"), ("gather_over_shading", "sample/pixel", "{:.2f}"))  # statistics


def show_summary(folder: Path, *, whole: bool = False) -> None:
    """Print the answer of a run's folder, a line per method and what it says, what went wrong, and where the results
    are. whole: also every coding, what is sent by its parts, and ratios of speed."""
    with Store(folder) as store:
        _show(store, folder, whole)


def _show(store: Store, folder: Path, whole: bool) -> None:
    from shading_atlas_bench.reports.store.csv_files import summarise
    from shading_atlas_bench.reports.store.labels import read_labels

    console = make_console()
    rows, labels = store.rows(), read_labels(store)
    summaries = summarise(rows)
    if rows:
        _show_answer(rows, summaries, labels, console)
    if whole:
        _show_numbers(rows, summaries, labels, console)
        _show_speed(store, rows, labels, console)
    for line in _uneven(rows, labels):
        console.print(styled("[yellow]frames[/] {}", line))
    for status, count, reason in _troubles(rows, labels):
        colour = "dim" if status == "skipped" else "red"
        console.print(styled("[{style}]{}[/] {}: {}", status, counted(count, "row"), reason, style=colour))
    for prefix, colour in (("scene", "dim"), ("published", "dim"), ("rare", "yellow"), ("warning", "yellow")):
        for text in dict.fromkeys(store.notes.under(prefix).values()):
            console.print(styled("[{style}]{}[/] {}", NOTE_WORDS[prefix], text, style=colour))
    more = "" if whole else "-v prints every rate"
    console.print(styled("[bold]{}/report.html[/]  frames.csv  summary.csv  [dim]{}[/]", folder, more), soft_wrap=True)


def _show_answer(rows: list[Row], summaries: list[Row], labels: Labels, console: Console) -> None:
    """A line per method as its client shows it, the best marked, and what that says."""
    from shading_atlas_bench.reports.analysis.answer import ANSWERED, answer_words, answers
    from shading_atlas_bench.reports.charts.figures import coding_label

    lines = answers(rows, summaries, labels)
    codings = list(dict.fromkeys(coding_label(*line.coding) for line in lines if line.coding[0] not in (None, "none")))
    shown = f", as shown at {' and '.join(codings)}" if codings else ""
    frames = counted(len({row["frame"] for row in rows}), "frame")
    title = f"{rows[0]['scene']} along {rows[0]['path'] or 'a path'}, {frames}{shown}"
    table = make_table(title, "method", *(measure.heading for measure in ANSWERED))
    for column in table.columns[1:]:
        column.justify, column.no_wrap = "right", True
    cells = [
        [f"{cell} *" if measure.name in line.best else cell for cell, measure in zip(line.cells, ANSWERED, strict=True)]
        for line in lines
    ]
    widths = [max(map(len, column)) for column in zip([measure.heading for measure in ANSWERED], *cells, strict=True)]
    room = console.width - sum(widths) - 2 * len(widths)
    for line, texts in zip(lines, cells, strict=True):
        marked = [
            styled("[bold green]{}[/]" if measure.name in line.best else "{}", text)
            for text, measure in zip(texts, ANSWERED, strict=True)
        ]
        table.add_row(folded(labels[line.key], max(room, NARROWEST)), *marked)
    console.print(table)
    for sentence in answer_words(rows, summaries, labels):
        console.print(styled("{}", sentence))
    if any(line.best for line in lines):
        console.print(styled("[dim]*: beats every other method, with 95 % confidence along this path[/]"))


def _show_speed(store: Store, rows: list[Row], labels: Labels, console: Console) -> None:
    """Ratios of speed, and how far the references differ."""
    from shading_atlas_bench.reports.store.csv_files import measured_statistics

    by_view = [row["view_dependence"] for row in rows if row["view_dependence"] is not None]
    if by_view:
        console.print(
            styled(
                "[dim]references for the server's and the client's eye differ by a FLIP of {:.4f}[/]", median(by_view)
            )
        )
    speed = _speed_lines(measured_statistics(rows, store.statistics()), labels)
    if speed:
        console.print(_fitting("speed ratios", ["method", *(heading for _, heading, _ in SPEED)], speed, console))
        console.print(styled("[dim]sample/pixel: time to gather a sample over the reference's to shade a pixel[/]"))


def _show_numbers(rows: list[Row], summaries: list[Row], labels: Labels, console: Console) -> None:
    """A table of work and quality for codings whose picture was judged, and one of sizes for those of video."""
    from shading_atlas_bench.reports.analysis.judged import displayed_codings

    work, sizes = [], []
    for key in labels:
        own = [row for row in rows if (row["method"], row["variant"]) == key]
        of_method = [row for row in summaries if (row["method"], row["variant"]) == key]
        judged = displayed_codings(own)
        coded = [row for row in of_method if row["codec"] != "none"] or of_method
        work += [_line(row, labels, WORK) for row in of_method if (row["codec"], row["crf"]) in judged]
        sizes += [_line(row, labels, SIZES) for row in coded]
    for title, columns, lines in (
        ("work and quality per frame: medians", WORK, work),
        ("kB sent per frame: everything, then its parts; means without keyframe", SIZES, sizes),
    ):
        console.print(_fitting(title, ["method", "codec", *(column[1] for column in columns)], lines, console))


def _uneven(rows: list[Row], labels: Labels) -> list[str]:
    """Sentences on methods whose numbers are of fewer frames than the run has."""
    from shading_atlas_bench.reports.store.columns import MEASURED_STATUSES

    measured: dict[tuple[str, str], set[int]] = {key: set() for key in labels}
    for row in rows:
        if row["status"] in MEASURED_STATUSES:
            measured[row["method"], row["variant"]].add(row["frame"])
    count = len({row["frame"] for row in rows})
    few = {key: len(frames) for key, frames in measured.items() if 0 < len(frames) < count}
    return [
        f"{labels[key]}: its numbers are of {n} of {count} frames, those of others of more." for key, n in few.items()
    ]


def _line(row: Row, labels: Labels, columns: tuple[Column, ...]) -> list[str]:
    """One line of a table: the method's label, its coding, and the columns of a row of summary.csv."""
    coding = f"{row['codec']} {row['crf']}" if row["crf"] is not None else row["codec"] or ""
    cells = ["" if row.get(name) is None else form(row[name] * scale) for name, _, scale, form in columns]
    return [labels[row["method"], row["variant"]], coding, *cells]


def _speed_lines(statistics: list[Row], labels: Labels) -> list[list[str]]:
    """Method and medians of its speed ratios."""
    values: dict[tuple[str, str], dict[str, list[float]]] = {}
    for row in statistics:
        if row["value"] is not None:
            values.setdefault((row["method"], row["variant"]), {}).setdefault(row["name"], []).append(row["value"])
    lines = []
    for key in [key for key in labels if key in values]:
        named = values[key]
        cells = [form.format(median(named[name])) if name in named else "" for name, _, form in SPEED]
        if any(cells):
            lines.append([labels[key], *cells])
    return lines


def _fitting(title: str, headings: list[str], lines: list[list[str]], console: Console) -> Table:
    """A table of the leading columns with values that fit the console's width; a method's name is folded to make room,
    numbers are never cut."""
    filled = [n for n in range(len(headings)) if n < 3 or any(line[n] for line in lines)]
    headings, *lines = ([line[n] for n in filled] for line in (headings, *lines))
    widths = [max(len(cell) for cell in column) for column in zip(headings, *lines, strict=True)]
    widths[0] = min(widths[0], NARROWEST)
    count = max(n for n in range(3, len(headings) + 1) if n == 3 or sum(widths[:n]) + 2 * (n - 1) <= console.width)
    table = make_table(title, *headings[:count])
    if count < len(headings):
        table.caption = f"not shown, for lack of width: {', '.join(headings[count:])}"
    for column in table.columns[1:]:
        column.no_wrap = True
    for column in table.columns[2:]:
        column.justify = "right"
    room = console.width - sum(widths[1:count]) - 2 * (count - 1)
    for label, *cells in lines:
        table.add_row(folded(label, room), *cells[: count - 1])
    return table


def _troubles(rows: list[Row], labels: Labels) -> list[tuple[str, int, str]]:
    """Statuses other than ok with how many rows they have and the first reason, method by method."""
    counts: dict[tuple[str, str], tuple[int, str]] = {}
    for row in rows:
        if row["status"] != "ok":
            label = labels[row["method"], row["variant"]]
            count, reason = counts.get((row["status"], label), (0, f"{label}: {row['reason']}"))
            counts[row["status"], label] = (count + 1, reason)
    return [(status, count, reason) for (status, _), (count, reason) in counts.items()]


def show_explained(rows: list[Row]) -> None:
    """Print the skips as a table."""
    console = make_console()
    table = make_table("skips", "skip", "leaves out", "here", "with", "without")
    for row in rows:
        times = ["" if row[name] is None else f"{row[name]:.2f}" for name in ("with_ms", "without_ms")]
        here = styled("[green]applies[/]: {}" if row["applies"] else "no: {}", row["reason"])
        table.add_row(row["skip"], row["what"], here, *times)
    for column in table.columns[3:]:
        column.justify, column.no_wrap = "right", True
    console.print(table)
    console.print(
        styled(
            "[dim]with, without: milliseconds per frame of the work that the skip shortens, all methods together; "
            "median of {} rounds over {} frames in turn. --no-skip NAME forces one off in a run.[/]",
            ROUNDS,
            FRAMES,
        )
    )
