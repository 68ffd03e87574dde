"""The command `bench sweep`; nothing heavy is imported until it runs."""

from __future__ import annotations

import typer

from shading_atlas_bench.harness.cli.guard import SOME_FAILED, guarded
from shading_atlas_bench.harness.cli.options import SWEEP, Given, with_options


@with_options(SWEEP)
def sweep(given: Given) -> None:
    """Measure run time against error over a grid of parameters and settings; write CSV and HTML.

    Exit codes: as of bench run.
    """
    out, dry_run, vary = given.pop("out", None), given.pop("dry_run", False), given.pop("vary", ())
    timing = [given.pop(name) for name in ("precision", "repetitions", "budget", "workers")]
    with guarded():
        from shading_atlas_bench.harness.sweep.request import read_request
        from shading_atlas_bench.harness.workload.settings import settings_of

        wanted = read_request(settings_of(given), vary, *timing)
        if dry_run:
            from shading_atlas_bench.harness.cli.sweep_tables import show_grid

            raise typer.Exit(0 if show_grid(wanted, out) else SOME_FAILED)
        from shading_atlas_bench.harness.cli.sweep_tables import show_sweep
        from shading_atlas_bench.harness.console import TerminalProgress
        from shading_atlas_bench.harness.sweep.run import sweep as run_sweep

        outcome = run_sweep(wanted, out, TerminalProgress())
        show_sweep(outcome.points, outcome.folder)
        raise typer.Exit(0 if outcome.well else SOME_FAILED)
