"""The command `bench list`: packers with their parameters, scenes, paths, presets, devices and metrics."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.padding import Padding

from shading_atlas_bench.harness.cli.guard import guarded
from shading_atlas_bench.harness.console import make_console, make_table, styled
from shading_atlas_bench.harness.errors import InputError


def list_everything(
    scene: Annotated[
        str | None, typer.Option(help="Only a scene: a built-in one or a file", metavar="NAME|FILE")
    ] = None,
    unit: Annotated[str | None, typer.Option(help="Of the file, as for bench run", metavar="UNIT")] = None,
    max_texture: Annotated[int | None, typer.Option(help="As for bench run", metavar="TEXELS")] = None,
    allow_outside: Annotated[bool, typer.Option("--allow-outside", help="As for bench run")] = False,
) -> None:
    """Show the packers with their parameters, the scenes, paths, devices and metrics.

    With --scene only that scene: whether it is a place or an object and why, its unit, and how its walk starts.
    """
    with guarded():
        if scene is not None:
            from shading_atlas_bench.harness.cli.scene_view import show_scene
            from shading_atlas_bench.harness.workload.settings import settings_of

            given = {"scene": scene, "unit": unit, "max_texture": max_texture, "allow_outside": allow_outside}
            show_scene(settings_of({name: value for name, value in given.items() if value is not None}))
        elif unit is not None or max_texture is not None or allow_outside:
            raise InputError("--unit, --max-texture and --allow-outside are for bench list --scene FILE: give both.")
        else:
            show_catalogue()


def show_catalogue() -> None:
    """Print packers with their parameters, scenes, paths, devices and metrics."""
    from shading_atlas_bench.harness.plugins import published_values, value_text
    from shading_atlas_bench.harness.workload.methods import installed_in_time
    from shading_atlas_bench.harness.workload.presets import PRESETS
    from shading_atlas_bench.kernels.device import kernels_digest
    from shading_atlas_bench.kernels.runtime.opencl import find_devices, noted_death
    from shading_atlas_bench.reports.store.columns import MEASURES
    from shading_atlas_bench.scenes.load import list_scenes
    from shading_atlas_bench.scenes.paths import list_paths

    console = make_console()
    for name, packer in installed_in_time().items():
        console.print(styled("[bold]{}[/]  {} ({})", name, packer.paper.title, packer.paper.year))
        table = make_table("", "parameter", "default", "sweep", "meaning")
        for key, parameter in packer.parameters.items():
            unit = f" [{parameter.unit}]" if parameter.unit else ""
            sweep = ", ".join(map(value_text, parameter.sweep))
            table.add_row(f"  {key}", value_text(parameter.default), sweep, parameter.meaning + unit)
        console.print(table)
        published = ", ".join(f"{key}={value_text(value)}" for key, value in published_values(packer).items())
        console.print(Padding(f"{name}@published: {published or 'as the defaults'}", (0, 0, 0, 2)))
        console.print()
    presets = {name: preset.meaning for name, preset in PRESETS.items()}
    for title, known in (("scenes", list_scenes()), ("paths", list_paths()), ("presets", presets)):
        table = make_table(title, "name", "what it is")
        for name, text in known.items():
            table.add_row(name, text)
        console.print(table)
        console.print()
    table = make_table("devices (the first without a remark is the default)", "device", "platform", "remark")
    for found in find_devices():
        platform = f"{found.device.platform.name} {found.device.platform.version.split(',')[0]}"
        remark = found.refused() or noted_death(found.key, kernels_digest()) or ""
        table.add_row(found.device.name.strip(), platform, remark)
    console.print(table)
    console.print()
    table = make_table("metrics", "name", "unit", "better", "meaning")
    for measure in MEASURES:
        table.add_row(measure.name, measure.unit, measure.better, measure.meaning)
    console.print(table)
