"""Running a sweep: every cell of the grid once, as `bench run` does, then its timing again until it is precise."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

from rich.progress import Progress

from harness.console import make_console, tell_passed_over
from harness.digest import method_digest, suite_digest
from harness.lane import Lane
from harness.plan import FREE, check_folder, make_plan
from harness.run import Run, folder_for, locked, show_progress, stops_kept, write_notes
from harness.session import Session, open_path, open_scene, open_session
from harness.settings import Settings
from harness.sweep.grid import SETTINGS, Cell, Grid, make_grid, shuffled
from harness.sweep.timing import Timed, note_of
from harness.sweep.wanted import Wanted
from kernels.cache import VERSION
from kernels.journal import journal
from reports.csv_files import replace_file
from reports.store import Store
from reports.sweep import FILE
from reports.sweep_report import write_sweep

NOT_TIMED = "not timed"


def sweep(wanted: Wanted, out: Path | None) -> bool:
    """Run the grid into `out` (a new folder below runs/ if None, or that of the same unfinished sweep); returns whether
    every cell is ok or skipped.

    Raises InputError, SettingsError, SceneError, PathError, DeviceError or StoreError for what cannot be used.
    """
    from harness.sweep.console import show_sweep
    from harness.sweep.workers import run_workers

    console = make_console(stderr=True)
    check_folder(out)
    grid = make_grid(wanted.settings, wanted.vary)
    console.print(f"[dim]Opening {grid.cells[0].settings.scene} ...[/]")
    hashes = check_scenes(grid)
    sessions = Sessions()
    session = sessions.at(grid.cells[0].settings)
    plan = make_sweep_plan(wanted, grid, hashes, session)
    folder = out or folder_for(plan, "sweep")
    with locked(folder), Store(folder) as store:
        store.set_plan(plan, begun=_has_begun(folder, grid))
        replace_file(folder / FILE, json.dumps(describe(wanted, grid), indent=2) + "\n")
        tell_passed_over(session.device)
        console.print(f"Results go to [bold]{folder}[/]; the same command with --out {folder} resumes.")
        journal().note(again=["--out", str(folder)])
        with stops_kept(folder):
            write_notes(store, session)
            with show_progress() as progress:
                if wanted.timed:
                    SweepRun(wanted, grid, folder, sessions, progress).all_cells()
                else:
                    run_workers(wanted, grid, folder, progress)
        points = write_sweep(folder)
    show_sweep(points, folder)
    return all(point.row["status"] in ("ok", "skipped") for point in points)


def _has_begun(folder: Path, grid: Grid) -> bool:
    """Whether a frame of any cell is finished."""
    for place in {folder / cell_folder for cell_folder in grid.folders().values()}:
        if (place / "results.sqlite").is_file():
            with Store(place) as store:
                if store.finished():
                    return True
    return False


def check_scenes(grid: Grid) -> dict[str, str]:
    """The content hash of each scene of the grid; what is wrong with one shows now, not after hours of the others.

    Raises SceneError, PathError or SettingsError.
    """
    hashes = {}
    for cells in grid.scenes():
        scene = open_scene(cells[0].settings)
        open_path(cells[0].settings, scene)
        hashes[scene.name] = scene.content_hash
    return hashes


class Sessions:
    """The session of each cell: one scene is open at a time, and cells share it, its path and its device."""

    def __init__(self) -> None:
        self._open: Session | None = None

    def at(self, settings: Settings) -> Session:
        """The session under these settings."""
        if self._open is None or self._open.settings.scene != settings.scene:
            self._open = None  # before another scene takes memory
            self._open = open_session(settings)
        return self._open.at(settings)


class SweepRun:
    """A sweep on its way in one process: where its cells go, and what is shared between them."""

    def __init__(
        self, wanted: Wanted, grid: Grid, folder: Path, sessions: Sessions, progress: Progress | None = None
    ) -> None:
        self.wanted, self.grid, self.folder, self.sessions = wanted, grid, folder, sessions
        self.folders = grid.folders()
        self.progress = progress
        self._warm: set[int] = set()

    def all_cells(self) -> None:
        """Scene by scene: every cell once, then rounds of repetitions, each in an order of its own."""
        seed = self.wanted.settings.seed
        total = self.progress.add_task("cells", total=len(self.grid.cells))
        for cells in self.grid.scenes():
            for cell in shuffled(cells, seed, 0):
                self.once(cell, self.progress)
                self.progress.advance(total)
            self._repetitions(cells)

    def _repetitions(self, cells: list[Cell]) -> None:
        """Time the cells of a scene again until each has a reason to stop."""
        known = {id(cell): Timed.read(cell, self.folder_of(cell)) for cell in cells}
        going = [cell for cell in cells if known[id(cell)] and known[id(cell)].goes_on(self.wanted.rule)]
        task = self.progress.add_task("timing again", total=len(going))
        for turn in itertools.count(1):
            for cell in shuffled(going, self.wanted.settings.seed, turn):
                timed, warm = known[id(cell)], id(cell) in self._warm
                self._warm.add(id(cell))
                fine = timed.again(self.sessions.at(cell.settings), warm)
                if not (fine and timed.goes_on(self.wanted.rule)):
                    going.remove(cell)
                    self.progress.advance(task)
            if not going:
                self.progress.remove_task(task)
                return
            self.progress.update(task, description=f"timing again, round {turn + 1}")

    def once(self, cell: Cell, progress: Progress) -> None:
        """Measure all frames of a cell, as `bench run` does, unless they are finished."""
        folder = self.folder_of(cell)
        with Store(folder) as store:
            if sum(key[:2] == cell.key for key in store.finished()) == cell.settings.frames:
                return
            session = self.sessions.at(cell.settings)
            siblings = [other for other in self.grid.cells if other.settings == cell.settings]
            store.set_plan(make_plan(session, [Lane(other.packer, session.scene, cell.settings) for other in siblings]))
            lane = Lane(cell.fresh(), session.scene, cell.settings)
            Run(session, [lane], store, folder, pictures=False).all_frames(progress)
            if not self.wanted.timed:
                store.notes[note_of(cell)] = NOT_TIMED
            self._warm.add(id(cell))

    def folder_of(self, cell: Cell) -> Path:
        """The folder of the run that a cell belongs to."""
        return self.folder / self.folders[cell.settings]


def make_sweep_plan(wanted: Wanted, grid: Grid, hashes: dict[str, str], session: Session) -> dict[str, Any]:
    """Everything that the cells of one folder must have in common; how precisely they are timed may change."""
    settings = {key: value for key, value in wanted.settings.to_json().items() if key not in (*FREE, "crf", "repeat")}
    methods = {type(cell.packer): cell.packer.name for cell in grid.cells}
    return {
        "settings": settings,
        "vary": list(wanted.vary),
        "cells": len(grid.cells),
        "methods": {name: method_digest(packer) for packer, name in methods.items()},
        "scene_hash": hashes,
        "device": session.device.name,
        "suite": suite_digest(),
        "version": VERSION,
        "timed": wanted.timed,
    }


def describe(wanted: Wanted, grid: Grid) -> dict[str, Any]:
    """The content of sweep.json: what a report needs to know of the grid, in its order."""
    folders = grid.folders()
    return {
        "settings": wanted.settings.to_json(),
        "vary": list(wanted.vary),
        "rule": vars(wanted.rule) | {},
        "timed": wanted.timed,
        "frames": wanted.settings.frames,
        "left_out": grid.left_out,
        "cells": [_describe(cell, folders[cell.settings]) for cell in grid.cells],
    }


def _describe(cell: Cell, folder: str) -> dict[str, Any]:
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
        "settings": settings.to_json() | atlas,
    }
