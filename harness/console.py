"""What the command line prints: errors as one sentence, the catalogue, tables that fit 80 columns."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.padding import Padding
from rich.table import Table

if TYPE_CHECKING:
    from kernels.device import Device
    from reports.compare import Comparison
    from reports.store import Store

WIDEST = 80
NARROWEST = 12  # columns of a method's name where a table needs the room
UNUSABLE = 2


class InputError(ValueError):
    """Arguments or input that cannot be used; the message is one sentence."""


def make_console(stderr: bool = False) -> Console:
    """A console of at most 80 columns, so that output reads the same everywhere."""
    console = Console(stderr=stderr, highlight=False)
    return Console(stderr=stderr, highlight=False, width=min(WIDEST, console.width))


@contextmanager
def guarded() -> Iterator[None]:
    """Turn errors about arguments and input into one sentence on stderr and exit code 2; others are bugs and show."""
    from harness.settings import SettingsError
    from kernels.cache import CacheError
    from kernels.device import DeviceError
    from reports.claims import ClaimsError
    from reports.documents.kept import DocumentError
    from reports.store import StoreError
    from scenes.model import SceneError
    from scenes.paths import PathError

    known = (InputError, SettingsError, CacheError, DeviceError, StoreError, SceneError, PathError, ClaimsError)
    known += (DocumentError,)
    try:
        yield
    except known as error:
        make_console(stderr=True).print(f"[bold red]bench:[/] {escape(str(error))}", soft_wrap=True)
        raise typer.Exit(UNUSABLE) from None


def tell_passed_over(device: Device) -> None:
    """Say on stderr which device is used where better ones were passed over, and why."""
    for reason in device.passed_over:
        text = f"[yellow]warning[/] {escape(reason)} Used instead: {escape(device.name)}."
        make_console(stderr=True).print(text, soft_wrap=True)


def make_table(title: str, *columns: str) -> Table:
    table = Table(title=title, title_justify="left", title_style="bold", box=None, pad_edge=False, expand=False)
    table.caption_justify, table.caption_style = "left", "dim"
    for column in columns:
        table.add_column(column, overflow="fold")
    return table


def show_catalogue() -> None:
    """Print packers with their parameters, scenes, paths, devices and metrics."""
    from harness.plugins import find_packers, published_values, value_text
    from harness.presets import PRESETS
    from kernels.device import kernels_digest
    from kernels.runtime.opencl import find_devices, noted_death
    from reports.columns import MEASURES
    from scenes.load import list_scenes
    from scenes.paths import list_paths

    console = make_console()
    for name, packer in find_packers().items():
        console.print(f"[bold]{name}[/]  {packer.paper.title} ({packer.paper.year})")
        table = make_table("", "parameter", "default", "sweep", "meaning")
        for key, parameter in packer.parameters.items():
            unit = f" [{parameter.unit}]" if parameter.unit else ""
            sweep = ", ".join(str(value) for value in parameter.sweep)
            table.add_row(f"  {key}", str(parameter.default), sweep, parameter.meaning + unit.replace("[", "\\["))
        console.print(table)
        published = ", ".join(f"{key}={value_text(value)}" for key, value in published_values(packer).items())
        console.print(Padding(f"{name}@published: {published or 'as the defaults'}", (0, 0, 0, 2)))
        console.print()
    presets = {name: preset.meaning for name, preset in PRESETS.items()}
    for title, known in (("scenes", list_scenes()), ("paths", list_paths()), ("presets", presets)):
        table = make_table(title, "name", "what it is")
        for name, text in known.items():
            table.add_row(name, text)
        console.print(table)
        console.print()
    table = make_table("devices (the first without a remark is the default)", "device", "platform", "remark")
    for found in find_devices():
        platform = f"{found.device.platform.name} {found.device.platform.version.split(',')[0]}"
        remark = found.refused() or noted_death(found.key, kernels_digest()) or ""
        table.add_row(found.device.name.strip(), platform, remark)
    console.print(table)
    console.print()
    table = make_table("metrics", "name", "unit", "better", "meaning")
    for measure in MEASURES:
        table.add_row(measure.name, measure.unit, measure.better, measure.meaning)
    console.print(table)


def _kilobytes(value: float) -> str:
    """With a decimal where it tells something."""
    return f"{value:,.1f}" if value < 1000 else f"{value:,.0f}"


# Column of summary.csv, heading, factor, format; where the console is narrow, the last ones are left out.
WORK = (
    ("server_ms_median", "server ms", 1, "{:,.1f}".format),
    ("flip_median", "FLIP", 1, "{:.4f}".format),
    ("samples_median", "samples", 1, "{:,.0f}".format),
    ("frame_ms_median", "frame ms", 1, "{:,.1f}".format),
    ("fill_median", "fill", 1, "{:.2f}".format),
    ("coherence_median", "cohere", 1, "{:.2f}".format),
    ("dssim_median", "DSSIM", 1, "{:.4f}".format),
)
SIZES = (
    ("bytes_total_mean", "kB/frame", 1e-3, _kilobytes),
    ("bytes_total_kbit_s", "kbit/s", 1, "{:,.0f}".format),
    ("bytes_total_max", "largest", 1e-3, _kilobytes),
    ("bytes_total_key", "keyframe", 1e-3, _kilobytes),
    ("bytes_video_mean", "video", 1e-3, _kilobytes),
    ("bytes_alpha_mean", "alpha", 1e-3, _kilobytes),
    ("bytes_metadata_mean", "meta", 1e-3, _kilobytes),
    ("bytes_geometry_mean", "geom", 1e-3, _kilobytes),
)
NOTE_WORDS = {"scene": "note", "published": "published", "rare": "not seen", "warning": "warning"}
SPEED = (("structs_share", "structs/server", "{:.1%}"), ("gather_over_shading", "sample/pixel", "{:.2f}"))  # statistics


def show_summary(store: Store, folder: Path) -> None:
    """Print what a frame costs and sends per method, codec and rate, what went wrong, and where the results are."""
    from reports.csv_files import measured_statistics
    from reports.labels import read_labels

    console = make_console()
    rows, labels = store.rows(), read_labels(store)
    _show_numbers(rows, labels, console)
    by_view = [row["view_dependence"] for row in rows if row["view_dependence"] is not None]
    if by_view:
        console.print(
            f"[dim]references for the server's and the client's eye differ by a FLIP of {median(by_view):.4f}[/]"
        )
    speed = _speed_lines(measured_statistics(rows, store.statistics()), labels)
    if speed:
        console.print(_fitting("speed ratios", ["method", *(heading for _, heading, _ in SPEED)], speed, console))
        console.print("[dim]sample/pixel: time to gather a sample over the reference's to shade a pixel[/]")
    for status, count, reason in _troubles(rows, labels):
        colour = "dim" if status == "skipped" else "red"
        console.print(f"[{colour}]{status}[/] {count} rows: {escape(reason)}")
    for prefix, colour in (("scene", "dim"), ("published", "dim"), ("rare", "yellow"), ("warning", "yellow")):
        for text in dict.fromkeys(store.notes.under(prefix).values()):
            console.print(f"[{colour}]{NOTE_WORDS[prefix]}[/] {escape(text)}")
    console.print(f"[bold]{folder}/report.html[/]  frames.csv  summary.csv", soft_wrap=True)


def _show_numbers(rows: list[dict[str, Any]], labels: dict[tuple[str, str], str], console: Console) -> None:
    """A table of work and quality for codings whose picture was judged, and one of sizes for those of video."""
    from reports.charts import displayed_codings
    from reports.csv_files import summarise

    work, sizes = [], []
    for key in labels:
        own = [row for row in rows if (row["method"], row["variant"]) == key]
        judged, summaries = displayed_codings(own), summarise(own)
        coded = [row for row in summaries if row["codec"] != "none"] or summaries
        work += [_line(row, labels, WORK) for row in summaries if (row["codec"], row["crf"]) in judged]
        sizes += [_line(row, labels, SIZES) for row in coded]
    for title, columns, lines in (
        ("work and quality per frame: medians", WORK, work),
        ("kB sent per frame: everything, then its parts; means without keyframe", SIZES, sizes),
    ):
        console.print(_fitting(title, ["method", "codec", *(column[1] for column in columns)], lines, console))
    for line in _uneven(rows, labels):
        console.print(f"[yellow]frames[/] {escape(line)}")


def _uneven(rows: list[dict[str, Any]], labels: dict[tuple[str, str], str]) -> list[str]:
    """Sentences on methods whose numbers are of fewer frames than the run has."""
    from reports.columns import MEASURED_STATUSES

    measured: dict[tuple[str, str], set[int]] = {key: set() for key in labels}
    for row in rows:
        if row["status"] in MEASURED_STATUSES:
            measured[row["method"], row["variant"]].add(row["frame"])
    count = len({row["frame"] for row in rows})
    few = {key: len(frames) for key, frames in measured.items() if 0 < len(frames) < count}
    return [
        f"{labels[key]}: its numbers are of {n} of {count} frames, those of others of more." for key, n in few.items()
    ]


def _line(row: dict[str, Any], labels: dict[tuple[str, str], str], columns: tuple) -> list[str]:
    """One line of a table: the method's label, its coding, and the columns of a row of summary.csv."""
    coding = f"{row['codec']} {row['crf']}" if row["crf"] is not None else row["codec"] or ""
    cells = ["" if row.get(name) is None else form(row[name] * scale) for name, _, scale, form in columns]
    return [labels[row["method"], row["variant"]], coding, *cells]


def _speed_lines(statistics: list[dict[str, Any]], labels: dict[tuple[str, str], str]) -> list[list[str]]:
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


def folded(label: str, room: int) -> str:
    """A method's label as markup, in lines of at most `room` characters as far as its parts are no longer."""
    lines = [""]
    for part in re.split(r"(?=[@\[=])|(?<=,)", label):
        if lines[-1] and len(lines[-1] + part) > room:
            lines.append("")
        lines[-1] += part
    return escape("\n".join(lines))


def _troubles(rows: list[dict[str, Any]], labels: dict[tuple[str, str], str]) -> list[tuple[str, int, str]]:
    """Statuses other than ok with how many rows they have and the first reason, method by method."""
    counts: dict[tuple[str, str], tuple[int, str]] = {}
    for row in rows:
        if row["status"] != "ok":
            label = labels[row["method"], row["variant"]]
            count, reason = counts.get((row["status"], label), (0, f"{label}: {row['reason']}"))
            counts[row["status"], label] = (count + 1, reason)
    return [(status, count, reason) for (status, _), (count, reason) in counts.items()]


def show_report(folder: Path) -> None:
    """Rebuild the CSV files and the report of a results folder."""
    from reports import claims_report, csv_files, html, sweep, sweep_report

    if claims_report.is_claims(folder):
        claims_report.write_claims(folder)
        make_console().print(f"Rebuilt {folder}/claims.csv and claims.html", soft_wrap=True)
        return
    if not (folder / "results.sqlite").is_file():
        raise InputError(f"{folder} has no results.sqlite: give a folder that bench run wrote.")
    if sweep.is_sweep(folder):
        sweep_report.write_sweep(folder)
        make_console().print(f"Rebuilt {folder}/sweep.csv and report.html", soft_wrap=True)
        return
    csv_files.write_all(folder)
    html.write_report(folder)
    make_console().print(f"Rebuilt {folder}/frames.csv, summary.csv and report.html", soft_wrap=True)


def show_comparison(first: Path, second: Path) -> None:
    """Print how run `second` compares to run `first`, one line per method, codec, rate and metric."""
    from reports.compare import ALL, compare, differences

    for folder in (first, second):
        if not (folder / "results.sqlite").is_file():
            raise InputError(f"{folder} has no results.sqlite: give a folder that bench run wrote.")
    console = make_console()
    rows = compare(first, second)
    if not rows:
        raise InputError(f"{first} and {second} have no method, codec and rate in common.")
    groups: dict[tuple, list[Comparison]] = {}
    for row in rows:
        groups.setdefault((row.label, row.variant, row.codec, row.crf), []).append(row)
    for text in differences(first, second):
        console.print(f"[yellow]differs[/] {escape(text)}")
    colours = {"better": "green", "worse": "red", "ambiguous": "yellow", "same": "dim"}
    for (label, variant, codec, crf), group in groups.items():
        coding = "every coding" if codec == ALL else f"{codec} {crf if crf is not None else ''}".strip()
        table = make_table(
            f"{escape(label)}, {coding}, frames: {group[0].frames}", "metric", "mean A", "mean B", "median A",
            "median B", "B is", "p",
        )  # fmt: skip
        for column in table.columns[1:5]:
            column.justify = "right"
        if variant:
            console.print(f"[dim]{escape(variant)}[/]")
        for row in group:
            p = "" if row.p is None else f"{row.p:.1g}"
            verdict = f"[{colours[row.verdict]}]{row.verdict}[/]"
            means, middles = (row.mean_a, row.mean_b), (row.a, row.b)
            if row.mean_a is None:  # one value for the run, neither mean nor median of anything
                means, middles = middles, (None, None)
            table.add_row(row.metric, *map(_number, (*means, *middles)), verdict, p)
        console.print(table)
        console.print()


def show_examination() -> bool:
    """Print what the doctor found; False if something needed is missing or wrong."""
    from harness.doctor import examine

    marks = {True: "[green]ok[/]", False: "[red]no[/]", None: "[yellow]--[/]"}
    table = make_table("bench doctor", "", "what", "found")
    findings = examine()
    for finding in findings:
        table.add_row(marks[finding.ok], finding.name, finding.detail.replace("[", "\\["))
    make_console().print(table)
    return all(finding.ok is not False for finding in findings)


def _number(value: float | None) -> str:
    if value is None:
        return ""
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.4g}"
