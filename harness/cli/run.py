"""The command `bench run`; nothing heavy is imported until it runs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from shading_atlas_bench.harness.cli.guard import SOME_FAILED, guarded
from shading_atlas_bench.harness.cli.options import RUN, Given, with_options
from shading_atlas_bench.harness.workload.presets import LINKED_LISTS

if TYPE_CHECKING:
    from shading_atlas_bench.harness.workload.settings import Settings


@with_options(RUN)
def run(given: Given) -> None:
    """Run methods on a scene and write CSV and HTML.

    Exit codes: 0 every row is ok or skipped with a reason, 1 some rows failed, 2 unusable arguments or input.
    """
    out, dry_run, whole = given.pop("out", None), given.pop("dry_run", False), given.pop("verbose", False)
    with guarded():
        if given.get("preset") == LINKED_LISTS:
            _linked_lists(given, out or Path("runs") / LINKED_LISTS, dry_run)
            return
        explained = given.pop("explain", False)
        settings = _settings_of(given)
        if dry_run:
            from shading_atlas_bench.harness.cli.dry_run import show_plan

            raise typer.Exit(0 if show_plan(settings, out) else SOME_FAILED)
        from shading_atlas_bench.harness.cli.summary import show_explained, show_summary
        from shading_atlas_bench.harness.console import TerminalProgress
        from shading_atlas_bench.harness.run.run import run as run_all

        outcome = run_all(settings, out, TerminalProgress(), explained=explained)
        show_summary(outcome.folder, whole=whole)
        if outcome.explained is not None:
            show_explained(outcome.explained)
        raise typer.Exit(0 if outcome.well else SOME_FAILED)


def _linked_lists(given: Given, out: Path, dry_run: bool) -> None:
    """The thesis' own experiment, which is no ordinary run."""
    from shading_atlas_bench.harness.experiments.ppll_2014 import experiment_of, run_experiment, show_experiment

    wanted = experiment_of(given)
    (show_experiment if dry_run else run_experiment)(wanted, out)


def _settings_of(given: Given) -> Settings:
    """The settings that the options mean, over those of `--config`, over the defaults. Raises SettingsError."""
    from shading_atlas_bench.harness.plugins import refuse_code
    from shading_atlas_bench.harness.workload.settings import SettingsError, read_settings, settings_of

    config = given.pop("config", None)
    if config is None:
        return settings_of(given)
    if "preset" in given:
        raise SettingsError("--config and --preset both say what to run: give one of them.")
    saved = read_settings(config)
    if "method" not in given:
        refuse_code(saved.methods, str(config), "name it yourself with --method {}")
    return settings_of(given, saved.to_json(), str(config))
