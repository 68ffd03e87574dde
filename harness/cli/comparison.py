"""The command `bench compare`: one run beside another, metric by metric."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from shading_atlas_bench.harness.cli.guard import guarded
from shading_atlas_bench.harness.console import make_console, make_table, styled
from shading_atlas_bench.harness.errors import InputError

if TYPE_CHECKING:
    from shading_atlas_bench.reports.analysis.compare import Comparison


def compare(
    first: Annotated[Path, typer.Argument(metavar="A", help="A folder that `bench run` wrote")],
    second: Annotated[Path, typer.Argument(metavar="B", help="Another one")],
) -> None:
    """Say per method and metric whether run B is better, worse or ambiguous against run A, by a rank test."""
    with guarded():
        show_comparison(first, second)


def show_comparison(first: Path, second: Path) -> None:
    """Print how run `second` compares to run `first`, one line per method, codec, rate and metric.

    Raises InputError for a folder without results, and for runs that have nothing in common.
    """
    from shading_atlas_bench.harness.run.folder import check_results
    from shading_atlas_bench.reports.analysis.compare import ALL, compare, differences
    from shading_atlas_bench.reports.charts.figures import coding_label

    for folder in (first, second):
        check_results(folder)
    console = make_console()
    rows = compare(first, second)
    if not rows:
        raise InputError(f"{first} and {second} have no method, codec and rate in common.")
    groups: dict[tuple[str, str, str | None, int | None], list[Comparison]] = {}
    for row in rows:
        groups.setdefault((row.label, row.variant, row.codec, row.crf), []).append(row)
    for text in differences(first, second):
        console.print(styled("[yellow]differs[/] {}", text))
    colours = {"better": "green", "worse": "red", "ambiguous": "yellow", "same": "dim"}
    for (label, variant, codec, crf), group in groups.items():
        coding = "every coding" if codec == ALL else coding_label(codec, crf)
        console.print(styled("[bold]{}, {}, frames: {}[/]", label, coding, group[0].frames))
        table = make_table("", "metric", "mean A", "mean B", "median A", "median B", "B is", "p")
        for column in table.columns[1:5]:
            column.justify = "right"
        if variant:
            console.print(styled("[dim]{}[/]", variant))
        for row in group:
            p = "" if row.p is None else f"{row.p:.1g}"
            verdict = styled("[{style}]{}[/]", row.verdict, style=colours[row.verdict])
            numbers = [row.mean_a, row.mean_b, row.a, row.b]
            if row.mean_a is None:  # one value for the run, neither mean nor median of anything
                numbers = [row.a, row.b, None, None]
            table.add_row(row.metric, *map(_number, numbers), verdict, p)
        console.print(table)
        console.print()


def _number(value: float | None) -> str:
    if value is None:
        return ""
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.4g}"
