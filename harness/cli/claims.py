"""The command `bench claims`; nothing heavy is imported until it runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from shading_atlas_bench.harness.cli.guard import guarded

SOME_UNMEASURED = 1


def claims(
    only: Annotated[
        list[str] | None, typer.Option("--id", help="A claim; repeatable. Default: all", metavar="ID")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder of the results. Default: a new one in runs/", metavar="DIR")
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Small pictures and few frames")] = False,
    reuse: Annotated[
        list[Path] | None,
        typer.Option(
            help="A folder of bench run, or of an earlier bench claims, whose results count where its settings are "
            "those of a run that is needed; repeatable",
            metavar="DIR",
        ),
    ] = None,
    file: Annotated[
        Path | None, typer.Option(help="Other claims, in the form of reports/claims.toml", metavar="FILE")
    ] = None,
    device: Annotated[str | None, typer.Option(help="Part of an OpenCL device's name", metavar="NAME")] = None,
    allow_outside: Annotated[bool, typer.Option("--allow-outside", help="As for bench run")] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only say what would run for which claims")] = False,
) -> None:
    """Measure what the papers claim about the methods, and say which claims hold here.

    Exit codes: 0 all was measured that can be, 1 something was not, 2 unusable arguments.
    """
    with guarded():
        from shading_atlas_bench.harness.experiments.claims import ClaimsRequest, run_claims, show_needs

        wanted = ClaimsRequest(tuple(only or ()), quick, tuple(reuse or ()), file, device, allow_outside)
        if dry_run:
            show_needs(wanted, out)
            return
        if not run_claims(wanted, out):
            raise typer.Exit(SOME_UNMEASURED)
