"""The command `bench doctor`: what the suite needs of a machine."""

from __future__ import annotations

from typing import Annotated

import typer

from shading_atlas_bench.harness.cli.guard import SOME_FAILED, guarded
from shading_atlas_bench.harness.console import make_console, make_table, styled
from shading_atlas_bench.harness.errors import InputError


def doctor(
    devices: Annotated[
        bool,
        typer.Option("--devices", help="Run every kernel on every OpenCL device, against its float64 twin"),
    ] = False,
    device: Annotated[
        str | None, typer.Option(help="With --devices: only those with this in their names", metavar="NAME")
    ] = None,
) -> None:
    """Check devices, versions, a kernel against its float64 twin, and the system parts the suite needs.

    With --devices nothing but the devices, and these thoroughly: minutes for each. Exit codes: 0 all is well, 1
    something is not, 2 unusable arguments.
    """
    with guarded():
        if devices:
            from shading_atlas_bench.harness.doctor.devices import check_devices

            well = check_devices(device)
        elif device is not None:
            raise InputError("--device is for bench doctor --devices: give both.")
        else:
            well = show_examination()
        if not well:
            raise typer.Exit(SOME_FAILED)


def show_examination() -> bool:
    """Print what the doctor found; False if something needed is missing or wrong."""
    from shading_atlas_bench.harness.doctor.examine import examine

    marks = {True: styled("[green]ok[/]"), False: styled("[red]no[/]"), None: styled("[yellow]--[/]")}
    table = make_table("bench doctor", "", "what", "found")
    findings = examine()
    for finding in findings:
        table.add_row(marks[finding.ok], finding.name, finding.detail)
    make_console().print(table)
    return all(finding.ok is not False for finding in findings)
