"""The command `bench check`; nothing heavy is imported until it runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from shading_atlas_bench.harness.cli.guard import SOME_FAILED, guarded

Device = Annotated[str | None, typer.Option(help="Part of an OpenCL device's name", metavar="NAME")]


def check(
    packer: Annotated[
        str,
        typer.Argument(metavar="PACKER", help="all, a name, 'name\\[param=value]', 'file.py:Class' or 'module:Class'"),
    ],
    out: Annotated[
        Path | None, typer.Option(help="Folder for pictures of what failed, and the smallest soup", metavar="DIR")
    ] = None,
    thorough: Annotated[bool, typer.Option("--thorough", help="Fuzz with 1000 soups in place of 100")] = False,
    timeout: Annotated[float, typer.Option(help="For one check", metavar="SECONDS")] = 60.0,
    device: Device = None,
) -> None:
    """Check that a packer does what the suite expects: the conformance kit for whoever writes one.

    Exit codes: 0 all checks passed, 1 some failed, 2 unusable arguments.
    """
    with guarded():
        from shading_atlas_bench.harness.workload.settings import LONGEST, Range

        Range("--timeout", 1, LONGEST, "seconds").check(timeout)
        from shading_atlas_bench.harness.conformance.check import run_check

        if not run_check(packer, out, thorough, timeout, device):
            raise typer.Exit(SOME_FAILED)
