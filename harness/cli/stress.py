"""The command `bench stress`; nothing heavy is imported until it runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from shading_atlas_bench.harness.cli.guard import SOME_FAILED, guarded

Device = Annotated[str | None, typer.Option(help="Part of an OpenCL device's name", metavar="NAME")]


def stress(
    method: Annotated[
        list[str] | None,
        typer.Option(help="As for bench run; repeatable. Default: all, always with the rasteriser", metavar="METHOD"),
    ] = None,
    test: Annotated[
        list[str] | None, typer.Option(help="A test of the catalogue; repeatable. Default: all", metavar="NAME")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder of the results. Default: a new one in runs/", metavar="DIR")
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Three magnitudes of each test")] = False,
    catalogue: Annotated[bool, typer.Option("--list", help="Only show the catalogue")] = False,
    timeout: Annotated[float, typer.Option(help="For one trial", metavar="SECONDS")] = 120.0,
    device: Device = None,
) -> None:
    """Try methods and the rasteriser on adversarial scenes of growing hardness.

    Says how far each came: valid, deterministic, and showing what a float64 rendering shows.
    Exit codes: 0 nothing went wrong, 1 something did, 2 unusable arguments.
    """
    with guarded():
        from shading_atlas_bench.harness.workload.settings import LONGEST, Range

        Range("--timeout", 1, LONGEST, "seconds").check(timeout)
        from shading_atlas_bench.harness.conformance.stress import run_stress, show_tests

        if catalogue:
            show_tests()
            return
        if not run_stress(tuple(method or ()), tuple(test or ()), out, quick, device, timeout):
            raise typer.Exit(SOME_FAILED)
