"""Running a sweep: every cell of the grid once, as `bench run` does, then its timing again until it is precise."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from shading_atlas_bench.harness.progress import Progress
from shading_atlas_bench.harness.run.digest import method_digest, suite_digest
from shading_atlas_bench.harness.run.folder import COMPLETE, check_folder, folder_for, locked, stops_kept
from shading_atlas_bench.harness.run.memory import processes_with_room
from shading_atlas_bench.harness.run.plan import WITHOUT_EFFECT
from shading_atlas_bench.harness.run.provenance import write_notes
from shading_atlas_bench.harness.run.run import tell_device
from shading_atlas_bench.harness.sweep.cells import Sessions, SweepRun
from shading_atlas_bench.harness.sweep.grid import SETTINGS, SweepCell, SweepGrid, make_grid
from shading_atlas_bench.harness.sweep.request import SweepRequest
from shading_atlas_bench.harness.sweep.workers import run_workers
from shading_atlas_bench.harness.workload.session import Session, workload_hashes
from shading_atlas_bench.harness.workload.settings import Settings
from shading_atlas_bench.kernels.cache import VERSION
from shading_atlas_bench.kernels.journal import journal
from shading_atlas_bench.reports.analysis.sweep import FILE, Point, Sweep, grid_digest
from shading_atlas_bench.reports.pages.sweep_report import write_sweep
from shading_atlas_bench.reports.store.csv_files import replace_file
from shading_atlas_bench.reports.store.data import decode_json
from shading_atlas_bench.reports.store.results import FILE as RESULTS
from shading_atlas_bench.reports.store.results import Store


@dataclass(frozen=True)
class Outcome:
    """What a sweep made: the folder of its results, its cells as the report shows them, and whether every one is ok or
    skipped."""

    folder: Path
    points: list[Point]
    well: bool


def sweep(wanted: SweepRequest, out: Path | None = None, progress: Progress | None = None) -> Outcome:
    """Run the grid into `out` (a new folder below runs/ if None, or that of the same unfinished sweep).

    Raises InputError, SettingsError, SceneError, PathError, DeviceError or StoreError for what cannot be used, and
    StoppedError when it is interrupted; finished frames are kept then.
    """
    progress = progress or Progress()
    check_folder(out)
    grid = make_grid(wanted.settings, wanted.vary)
    progress.say(f"Opening {grid.cells[0].settings.scene} ...")
    hashes = check_scenes(grid)
    sessions = Sessions()
    session = sessions.at(grid.cells[0].settings)
    plan = make_sweep_plan(wanted, grid, hashes, session)
    folder = out or folder_for(plan, "sweep", progress)
    with locked(folder), Store(folder) as store:
        store.set_plan(plan, begun=_has_begun(folder, grid))
        replace_file(folder / FILE, json.dumps(describe(wanted, grid), indent=2) + "\n")
        tell_device(session, progress)
        progress.say(f"Results go to {folder}; the same command with --out {folder} resumes.")
        journal().note(again=["--out", str(folder)])
        with stops_kept(folder):
            write_notes(store, session)
            if wanted.timed:
                SweepRun(wanted, grid, folder, sessions, progress).all_cells()
            else:
                run_workers(wanted, grid, folder, _workers(wanted, grid, session, progress), progress)
        points = write_sweep(folder)
        store.notes[COMPLETE] = "yes"
    return Outcome(folder, points, all(point.row["status"] in ("ok", "skipped") for point in points))


def _workers(wanted: SweepRequest, grid: SweepGrid, session: Session, progress: Progress) -> int:
    """How many workers memory has room for side by side, by the cells of the scene that is open; fewer than wanted are
    told."""
    cells = next(iter(grid.scenes()))
    settings, packers = [cell.settings for cell in cells], [cell.packer for cell in cells]
    count = processes_with_room(settings, session.scene.host, packers, wanted.workers)
    if count < wanted.workers:
        progress.warn(f"Memory has room for {count} of {wanted.workers} workers.")
    return count


def _has_begun(folder: Path, grid: SweepGrid) -> bool:
    """Whether a frame of any cell is finished."""
    for place in {folder / cell_folder for cell_folder in grid.folders().values()}:
        if (place / RESULTS).is_file():
            with Store(place) as store:
                if store.finished():
                    return True
    return False


def check_scenes(grid: SweepGrid) -> dict[str, dict[str, str]]:
    """The `workload_hashes` of each scene of the grid, as it was given; what is wrong with one shows now, not after
    hours of the others.

    Raises SceneError, PathError or SettingsError.
    """
    first = [cells[0].settings for cells in grid.scenes()]
    return {settings.scene: workload_hashes(settings) for settings in first}


def make_sweep_plan(
    wanted: SweepRequest, grid: SweepGrid, hashes: dict[str, dict[str, str]], session: Session
) -> dict[str, Any]:
    """Everything that the cells of one folder must have in common; how precisely they are timed may change."""
    settings = {
        key: value for key, value in wanted.settings.to_json().items() if key not in (*WITHOUT_EFFECT, "crf", "repeat")
    }
    methods = {type(cell.packer): cell.packer.name for cell in grid.cells}
    described = decode_json(json.dumps(describe(wanted, grid)), Sweep, FILE)
    return {
        "settings": settings,
        "vary": list(wanted.vary),
        "cells": len(grid.cells),
        "grid": grid_digest(described),
        "methods": {name: method_digest(packer) for packer, name in methods.items()},
        "scenes": hashes,
        "device": session.device.name,
        "suite": suite_digest(),
        "version": VERSION,
        "timed": wanted.timed,
    }


def describe(wanted: SweepRequest, grid: SweepGrid) -> dict[str, Any]:
    """The content of sweep.json: what a report needs to know of the grid, in its order."""
    folders = grid.folders()
    return {
        "settings": _told(wanted.settings),
        "vary": list(wanted.vary),
        "rule": vars(wanted.rule) | {},
        "timed": wanted.timed,
        "frames": wanted.settings.frames,
        "left_out": grid.left_out,
        "cells": [_describe(cell, folders[cell.settings]) for cell in grid.cells],
    }


def _told(settings: Settings) -> dict[str, Any]:
    """The settings but for what changes no result, which may be another when a sweep goes on."""
    return {name: value for name, value in settings.to_json().items() if name not in ("timeout", "memory")}


def _describe(cell: SweepCell, folder: str) -> dict[str, Any]:
    settings = cell.settings
    method, variant = cell.key
    lossless: tuple[str, int | None] = ("none", None)
    coded = {"h264": ("h264", settings.display_crf), "jpeg": ("jpeg", None)}.get(settings.codec)
    displayed = {"displayed": coded if cell.packer.atlas else lossless} if coded else {}
    atlas = {} if cell.packer.atlas else {"atlas_width": None, "atlas_height": None, "samples_per_pixel": None}
    return {
        "folder": folder,
        "method": method,
        "variant": variant,
        "contender": cell.contender,
        "varied": cell.varied,
        "condition": ", ".join(f"{name} {cell.work[name]}" for name in SETTINGS if name in cell.work),
        "codings": displayed | {"lossless": lossless},
        "settings": _told(settings) | atlas,
    }
