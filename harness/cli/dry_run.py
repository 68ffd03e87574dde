"""What `bench run --dry-run` prints: what would run, what is skipped, and how long it should take."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console

from shading_atlas_bench.harness.console import make_console, make_table, styled
from shading_atlas_bench.harness.measure.returned import told_skip
from shading_atlas_bench.harness.plugins import label_of, variant_string
from shading_atlas_bench.harness.run.folder import check_folder
from shading_atlas_bench.harness.run.memory import memory_need, methods_at_once
from shading_atlas_bench.harness.run.plan import duration, expected_pace
from shading_atlas_bench.harness.workload.methods import find_methods
from shading_atlas_bench.harness.workload.session import open_head_motion, open_path, open_scene
from shading_atlas_bench.harness.workload.settings import Settings
from shading_atlas_bench.harness.workload.skips import check_names, skipped_stages
from shading_atlas_bench.kernels.device import Device
from shading_atlas_bench.packers.interface import Packer


def show_plan(settings: Settings, out: Path | None) -> bool:
    """Print what `bench run` with these settings would do; opens all it needs, runs no kernel. False where a method
    cannot say whether the scene has something for it to do."""
    check_folder(out)
    packers = find_methods(settings)
    check_names(settings.no_skip, packers)
    scene = open_scene(settings)
    path = open_path(settings, scene)
    open_head_motion(settings)
    device = Device.open(settings.device)
    count = len(path.times_ms[: settings.frames])
    frames = f"{count} frame{'s' * (count != 1)}"
    console = make_console()
    console.print(
        styled("[bold]{}[/]  {:,} triangles, path {}, {}", scene.name, scene.triangle_count, path.name, frames)
    )
    console.print(
        f"client {settings.width}x{settings.height} at {settings.fov:g} degrees, cell {settings.cell_radius:g} m / "
        f"{settings.cell_fov:g} degrees, atlas {settings.atlas_width}x{settings.atlas_height}, {settings.latency:g} ms"
        + (f", {settings.samples_per_pixel:g} samples per pixel" if settings.samples_per_pixel else "")
    )
    console.print(f"device {device.name}")
    rates = ", ".join(str(crf) for crf in settings.crfs)
    console.print(f"codec {settings.codec}" + (f", CRF {rates}, shown at {settings.display_crf}" if rates else ""))
    for note in [*scene.notes, *path.notes, *_beyond_budget(settings, packers)]:
        console.print(styled("[yellow]note[/] {}", note))
    told = [told_skip(packer, scene, settings.timeout) for packer in packers]
    _print_methods(console, packers, told, frames + f" x {settings.repeat}" * (settings.repeat > 1))
    table = make_table("skipped for this scene", "stage", "why")
    for name, reason in skipped_stages(scene.features, settings.no_skip).items():
        table.add_row(name, reason)
    console.print(table)
    at_once = methods_at_once(settings, scene, packers)
    some = "one method" if at_once == 1 else f"{at_once} methods"
    together = f", {some} at a time" if at_once < len(packers) else ""
    console.print(f"about {memory_need(settings, scene, packers, at_once)}{together}")
    seconds = 10 + count * expected_pace(settings, scene.content_hash) * max(1, told.count(None))
    console.print(f"about {duration(seconds)}; results in {out or 'a new folder below runs/'}")
    return all(why is None or why[0] == "skipped" for why in told)


def _beyond_budget(settings: Settings, packers: list[Packer]) -> list[str]:
    """A sentence on the methods that `--samples` does not reach, if any."""
    names = dict.fromkeys(packer.name for packer in packers if not packer.atlas)
    if settings.samples_per_pixel is None or not names:
        return []
    keep = "it keeps its own number" if len(names) == 1 else "they keep their own numbers"
    return [f"--samples does not reach {' and '.join(names)}: without an atlas {keep} of samples."]


def _print_methods(console: Console, packers: list[Packer], told: list[tuple[str, str] | None], work: str) -> None:
    """told: of each packer, the status and the reason where it does nothing. work: of the others."""
    table = make_table("methods", "method", "parameters", "what happens")
    for packer, why in zip(packers, told, strict=True):
        parameters = variant_string(packer).replace(",", ", ")
        table.add_row(label_of(packer), parameters, ": ".join(why) if why else work)
    console.print(table)
