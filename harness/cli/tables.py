"""The command `bench tables`; nothing heavy is imported until it runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from shading_atlas_bench.harness.cli.guard import guarded

SOME_WRONG = 1


def tables(
    names: Annotated[
        list[str] | None, typer.Argument(metavar="[NAME]...", help="Tables, or all. Default with --check: all")
    ] = None,
    check: Annotated[
        bool, typer.Option("--check", help="Write nothing: say where a printed digit is another one now")
    ] = False,
    quick: Annotated[bool, typer.Option("--quick", help="With --check: only those of a minute or two")] = False,
    write: Annotated[bool, typer.Option("--write", help="Run nothing: write the documents from the kept data")] = False,
    folder: Annotated[
        Path | None,
        typer.Option(
            "--from",
            metavar="DIR",
            help="Results of the table's command that are there, of the same settings and kernels; of several "
            "commands, a folder for each. What is not finished goes on",
        ),
    ] = None,
    listed: Annotated[
        bool, typer.Option("--list", help="Only show the tables, and of those named the commands")
    ] = False,
) -> None:
    """Measure the documents' tables anew, and write data, tables and numbers in sentences.

    Times are kept with the device they are of. With --check all else has to be the same, to the printed digit.
    Exit codes: 0 written, or nothing differs, 1 something differs or could not be measured, 2 unusable arguments.
    """
    from shading_atlas_bench.harness.errors import InputError

    with guarded():
        from shading_atlas_bench.harness.experiments.tables import ALL, check_tables, show_tables, write_tables

        if sum((check, write, listed, folder is not None)) > 1 or (quick and not check):
            raise InputError("Give one of --check, --write, --from and --list; --quick goes with --check.")
        if listed:
            show_tables(names or ())
            return
        if not (names or check or write or folder):
            raise InputError("Name the tables to measure, or give all. bench tables --list shows them.")
        chosen = names or [ALL]
        if not (check_tables(chosen, quick) if check else write_tables(chosen, folder, run=not write)):
            raise typer.Exit(SOME_WRONG)
