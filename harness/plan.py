"""The plan of a run: what binds its results together, what will run, what is skipped, and how long it should take."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from rich.markup import escape

from harness.console import InputError, make_console, make_table
from harness.digest import method_digest, suite_digest
from harness.lane import Lane
from harness.plugins import label_of, variant_string
from harness.session import Session, find_methods, open_head_motion, open_path, open_scene
from harness.settings import Settings
from harness.skips import check_names, skipped_stages
from kernels.cache import VERSION, cache_root, read_checked, write_checked
from kernels.device import Device
from packers.interface import Packer
from scenes.model import Scene

# Settings that change no result, so a run may be resumed with others.
FREE = ("timeout", "dump", "methods")
# Host seconds of one frame before anything was measured here: per million pixels, texels and PVS pixels, and fixed.
FIRST_GUESS = {"pixels": 0.9, "texels": 0.25, "pvs_pixels": 0.012, "fixed": 0.3}


def make_plan(session: Session, lanes: list[Lane]) -> dict[str, Any]:
    """Everything that results of one folder must have in common, as JSON values."""
    settings = {key: value for key, value in session.settings.to_json().items() if key not in FREE}
    return {
        "settings": settings,
        "methods": {f"{lane.method}[{lane.variant}]": method_digest(type(lane.packer)) for lane in lanes},
        "scene_hash": session.scene.host.content_hash,
        "path_hash": session.path_hash,
        "device": session.device.name,
        "suite": suite_digest(),
        "version": VERSION,
    }


def check_folder(out: Path | None) -> None:
    """Raise InputError for a results folder that holds something else already."""
    if out is None or not out.exists() or (out / "results.sqlite").is_file():
        return
    if not out.is_dir():
        raise InputError(f"{out} is a file: give a folder for --out.")
    if any(entry.name != ".lock" for entry in out.iterdir()):
        raise InputError(f"The folder {out} holds other things than results: give a new or empty one for --out.")


def show_plan(settings: Settings, out: Path | None) -> None:
    """Print what `bench run` with these settings would do; opens all it needs, runs no kernel."""
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
    console.print(f"[bold]{scene.name}[/]  {scene.triangle_count:,} triangles, path {path.name}, {frames}")
    console.print(
        f"client {settings.width}x{settings.height} at {settings.fov:g} degrees, cell {settings.cell_radius:g} m / "
        f"{settings.cell_fov:g} degrees, atlas {settings.atlas_width}x{settings.atlas_height}, {settings.latency:g} ms"
        + (f", {settings.samples_per_pixel:g} samples per pixel" if settings.samples_per_pixel else "")
    )
    console.print(f"device {device.name}")
    rates = ", ".join(str(crf) for crf in settings.crfs)
    console.print(f"codec {settings.codec}" + (f", CRF {rates}, shown at {settings.display_crf}" if rates else ""))
    for note in [*scene.notes, *path.notes, *_beyond_budget(settings, packers)]:
        console.print(f"[yellow]note[/] {note}", markup=True)
    _print_methods(console, packers, scene, frames + f" x {settings.repeat}" * (settings.repeat > 1))
    table = make_table("skipped for this scene", "stage", "why")
    for name, reason in skipped_stages(scene.features, settings.no_skip).items():
        table.add_row(name, reason)
    console.print(table)
    running = sum(packer.skip(scene) is None for packer in packers)
    seconds = 10 + count * expected_pace(settings, scene.content_hash) * max(1, running)
    console.print(f"about {duration(seconds)}; results in {out or 'a new folder below runs/'}")


def _beyond_budget(settings: Settings, packers: list[Packer]) -> list[str]:
    """A sentence on the methods that `--samples` does not reach, if any."""
    names = dict.fromkeys(packer.name for packer in packers if not packer.atlas)
    if settings.samples_per_pixel is None or not names:
        return []
    keep = "it keeps its own number" if len(names) == 1 else "they keep their own numbers"
    return [f"--samples does not reach {' and '.join(names)}: without an atlas {keep} of samples."]


def _print_methods(console: Any, packers: list[Packer], scene: Scene, work: str) -> None:
    table = make_table("methods", "method", "parameters", "what happens")
    for packer in packers:
        reason = packer.skip(scene)
        parameters = variant_string(packer).replace(",", ", ")
        table.add_row(escape(label_of(packer)), parameters, f"skipped: {reason}" if reason else work)
    console.print(table)


def duration(seconds: float) -> str:
    if seconds < 90:
        return f"{max(5, round(seconds / 5) * 5)} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def _pace_file(settings: Settings, scene_hash: str) -> Path:
    same = (
        "width",
        "height",
        "atlas_width",
        "atlas_height",
        "samples_per_pixel",
        "cell_radius",
        "cell_fov",
        "codec",
        "pvs_density",
        "repeat",
    )
    values = [getattr(settings, name) for name in same]
    key = hashlib.sha256(json.dumps([scene_hash, settings.crfs, values]).encode()).hexdigest()[:24]
    return cache_root() / "pace" / key


def remember_pace(session: Session, seconds_per_frame: float, methods: int) -> None:
    """Keep how long a frame of one method took, for the next plan."""
    pace = seconds_per_frame / max(1, methods)
    file = _pace_file(session.settings, session.scene.host.content_hash)
    write_checked(file, json.dumps(pace).encode())


def expected_pace(settings: Settings, scene_hash: str) -> float:
    """Seconds per frame and method: as measured by the last such run here, else a guess from the sizes."""
    content = read_checked(_pace_file(settings, scene_hash))
    if content is not None:
        return float(json.loads(content))
    pixels = settings.width * settings.height / 1e6
    texels = settings.atlas_width * settings.atlas_height / 1e6
    wider = settings.cell_fov / settings.fov * settings.pvs_density
    views = 9 * pixels * wider * wider
    guess = FIRST_GUESS
    return guess["fixed"] + guess["pixels"] * pixels + guess["texels"] * texels + guess["pvs_pixels"] * views
