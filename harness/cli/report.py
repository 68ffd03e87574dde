"""The command `bench report`: the files of a results folder made again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from shading_atlas_bench.harness.cli.guard import guarded
from shading_atlas_bench.harness.console import make_console


def report(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A folder that `bench run`, `sweep` or `claims` wrote")],
) -> None:
    """Rebuild the CSV files and the HTML report from the results store."""
    with guarded():
        show_report(folder)


def show_report(folder: Path) -> None:
    """Rebuild the CSV files and the report of a results folder. Raises InputError for a folder without results."""
    from shading_atlas_bench.harness.run.folder import check_results
    from shading_atlas_bench.reports.analysis import sweep
    from shading_atlas_bench.reports.pages import claims_report, html, sweep_report
    from shading_atlas_bench.reports.store import csv_files

    if claims_report.is_claims(folder):
        claims_report.write_claims(folder)
        make_console().print(f"Rebuilt {folder}/claims.csv and claims.html", soft_wrap=True)
        return
    check_results(folder)
    if sweep.is_sweep(folder):
        sweep_report.write_sweep(folder)
        make_console().print(f"Rebuilt {folder}/sweep.csv and report.html", soft_wrap=True)
        return
    csv_files.write_all(folder)
    html.write_report(folder)
    make_console().print(f"Rebuilt {folder}/frames.csv, summary.csv and report.html", soft_wrap=True)
