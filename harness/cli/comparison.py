"""The command `bench compare`: one run beside another, metric by metric."""

from __future__ import annotations

from collections import Counter
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from shading_atlas_bench.harness.cli.guard import guarded
from shading_atlas_bench.harness.console import counted, make_console, make_table, styled
from shading_atlas_bench.harness.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console
    from rich.text import Text

    from shading_atlas_bench.reports.analysis.compare import Comparison

COLOURS = {"better": "green", "worse": "red", "ambiguous": "yellow", "same": "dim"}


def compare(
    first: Annotated[Path, typer.Argument(metavar="A", help="A folder that `bench run` wrote")],
    second: Annotated[Path, typer.Argument(metavar="B", help="Another one")],
    again: Annotated[bool, typer.Option("--run", help="Replay both in turn first, for small changes of times")] = False,
    pairs: Annotated[int, typer.Option(metavar="N", min=10, max=200, help="With --run: how often each")] = 10,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="With --run: where. Default: below runs/")] = None,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Also print what did not change")] = False,
) -> None:
    """Say per method and metric whether run B is better or worse than run A, where that is sure.

    With --run, A and B may also be run.json files; a comparison that was stopped goes on in the same --out.
    """
    with guarded():
        if again:
            show_replayed(first, second, pairs, out, whole=verbose)
        else:
            show_comparison(first, second, whole=verbose)


def show_replayed(first: Path, second: Path, pairs: int, out: Path | None, *, whole: bool) -> None:
    """Replay two runs in turn, and print how the second ones compare to the first ones. Raises InputError."""
    from shading_atlas_bench.harness.console import TerminalProgress
    from shading_atlas_bench.harness.run.interleaved import replay_in_turn
    from shading_atlas_bench.reports.analysis.compare import differences
    from shading_atlas_bench.reports.analysis.interleaved import compare_interleaved

    progress = TerminalProgress()
    folder = out or Path("runs") / f"compare-{datetime.now():%Y%m%d-%H%M%S}"
    progress.say(f"Runs go to {folder}; the same command with --out {folder} goes on.")
    runs_a, runs_b = replay_in_turn(first, second, pairs, folder, progress)
    console = make_console()
    for text in differences(runs_a[0], runs_b[0]):
        console.print(styled("[yellow]differs[/] {}", text))
    _show(compare_interleaved(runs_a, runs_b), console, whole)
    console.print(styled("[dim]Times are medians of {} processes each, run in turn.[/]", pairs))


def show_comparison(first: Path, second: Path, *, whole: bool = False) -> None:
    """Print how run `second` compares to run `first`: what differs otherwise, how many numbers changed, and which.
    whole: also those that did not, with means and medians.

    Raises InputError for a folder without results, and for runs that have nothing in common.
    """
    from shading_atlas_bench.harness.run.folder import check_results
    from shading_atlas_bench.reports.analysis.compare import compare, differences, noise

    for folder in (first, second):
        check_results(folder)
    console = make_console()
    rows = compare(first, second)
    if not rows:
        raise InputError(f"{first} and {second} have no method, codec and rate in common.")
    for text in differences(first, second):
        console.print(styled("[yellow]differs[/] {}", text))
    for name, folder in (("A", first), ("B", second)):
        for text in noise(folder):
            console.print(styled("[yellow]noise in {}[/] {}", name, text))
    _show(rows, console, whole)
    if any(row.unit == "ms" and row.verdict == "ambiguous" for row in rows):
        console.print(
            styled(
                "[dim]Each run is one process: a time is called better or worse where it differs, in itself and over "
                "the reference's, by more than the machine's pace does. Add --run to find smaller changes.[/]"
            )
        )


def _show(rows: list[Comparison], console: Console, whole: bool) -> None:
    """How many numbers changed, and which."""
    counts = Counter(row.verdict for row in rows)
    told = ", ".join(f"{counts[verdict]} {verdict}" for verdict in COLOURS if counts[verdict])
    console.print(styled("[bold]B against A, of {}: {}[/]", counted(len(rows), "number"), told))
    if whole:
        _show_all(rows, console)
    else:
        _show_changed([row for row in rows if row.verdict in ("better", "worse")], console)


def _show_changed(rows: list[Comparison], console: Console) -> None:
    """A line per number that changed."""
    if not rows:
        return
    table = make_table("", "method", "coding", "metric", "A", "B", "change", "B is")
    for column in table.columns[3:6]:
        column.justify, column.no_wrap = "right", True
    for row in rows:
        table.add_row(row.label, _coding(row), row.metric, _number(row.a), _number(row.b), _change(row), _verdict(row))
    console.print(table)


def _show_all(rows: list[Comparison], console: Console) -> None:
    """A table per method and coding."""
    groups: dict[tuple[str, str, str | None, int | None], list[Comparison]] = {}
    for row in rows:
        groups.setdefault((row.label, row.variant, row.codec, row.crf), []).append(row)
    for (label, variant, _, _), group in groups.items():
        console.print(styled("[bold]{}, {}, frames: {}[/]", label, _coding(group[0]), group[0].frames))
        if variant:
            console.print(styled("[dim]{}[/]", variant))
        table = make_table("", "metric", "mean A", "mean B", "median A", "median B", "B is", "p")
        for column in table.columns[1:5]:
            column.justify = "right"
        for row in group:
            p = "" if row.p is None else f"{row.p:.1g}"
            numbers = [row.mean_a, row.mean_b, row.a, row.b]
            if row.mean_a is None:  # one value for the run, neither mean nor median of anything
                numbers = [row.a, row.b, None, None]
            table.add_row(row.metric, *map(_number, numbers), _verdict(row), p)
        console.print(table)
        console.print()


def _coding(row: Comparison) -> str:
    from shading_atlas_bench.reports.analysis.compare import ALL
    from shading_atlas_bench.reports.charts.figures import coding_label

    return "every" if row.codec == ALL else coding_label(row.codec, row.crf)


def _change(row: Comparison) -> str:
    """The change in per cent, and its 95 % interval where there is one."""
    if row.change is None:
        return ""
    change = f"{100 * row.change:+.3g}%"
    if row.low is None or row.high is None or row.low == row.high:
        return change
    return f"{change} ({100 * row.low:+.2g} to {100 * row.high:+.2g})"


def _verdict(row: Comparison) -> Text:
    return styled("[{style}]{}[/]", row.verdict, style=COLOURS[row.verdict])


def _number(value: float | None) -> str:
    if value is None:
        return ""
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.4g}"
