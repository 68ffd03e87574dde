"""The cells of a sweep measured: each once, as `bench run` does, then its timing again until it is precise."""

from __future__ import annotations

import itertools
from pathlib import Path

from shading_atlas_bench.harness.measure.pipeline import Pipeline
from shading_atlas_bench.harness.progress import Progress
from shading_atlas_bench.harness.run.loop import Run
from shading_atlas_bench.harness.run.memory import refusal
from shading_atlas_bench.harness.run.plan import make_plan
from shading_atlas_bench.harness.sweep.grid import SweepCell, SweepGrid, shuffled
from shading_atlas_bench.harness.sweep.request import SweepRequest
from shading_atlas_bench.harness.sweep.timing import Timed, note_of
from shading_atlas_bench.harness.watch.watchdog import answer_within
from shading_atlas_bench.harness.workload.methods import making_limit
from shading_atlas_bench.harness.workload.session import Session, open_session
from shading_atlas_bench.harness.workload.settings import Settings
from shading_atlas_bench.reports.store.results import Store

NOT_TIMED = "not timed"


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
    """A sweep on its way in one of so many processes: where its cells go, and what is shared between them."""

    def __init__(
        self,
        wanted: SweepRequest,
        grid: SweepGrid,
        folder: Path,
        sessions: Sessions,
        progress: Progress,
        processes: int = 1,
    ) -> None:
        self.wanted, self.grid, self.folder, self.sessions = wanted, grid, folder, sessions
        self.folders = grid.folders()
        self.progress, self.processes = progress, processes
        self._warm: set[int] = set()

    def all_cells(self) -> None:
        """Scene by scene: every cell once, then rounds of repetitions, each in an order of its own."""
        seed = self.wanted.settings.seed
        with self.progress.task("cells", len(self.grid.cells)) as total:
            for cells in self.grid.scenes():
                for cell in shuffled(cells, seed, 0):
                    self.once(cell)
                    total.advance()
                self._repetitions(cells)

    def _repetitions(self, cells: list[SweepCell]) -> None:
        """Time the cells of a scene again until each has a reason to stop."""
        read = {id(cell): Timed.read(cell, self.folder_of(cell)) for cell in cells}
        known = {number: timed for number, timed in read.items() if timed is not None}
        going = [cell for cell in cells if id(cell) in known and known[id(cell)].goes_on(self.wanted.rule)]
        with self.progress.task("timing again", len(going)) as task:
            for turn in itertools.count(1):
                for cell in shuffled(going, self.wanted.settings.seed, turn):
                    timed, warm = known[id(cell)], id(cell) in self._warm
                    self._warm.add(id(cell))
                    fine = timed.again(self.sessions.at(cell.settings), warm)
                    if not (fine and timed.goes_on(self.wanted.rule)):
                        going.remove(cell)
                        task.advance()
                if not going:
                    return
                task.doing(f"timing again, round {turn + 1}")

    def once(self, cell: SweepCell) -> None:
        """Measure all frames of a cell, as `bench run` does, unless they are finished; what memory has no room for
        fails before it starts."""
        folder = self.folder_of(cell)
        with Store(folder) as store:
            if sum(key[:2] == cell.key for key in store.finished()) == cell.settings.frames:
                return
            session = self.sessions.at(cell.settings)
            siblings = [other for other in self.grid.cells if other.settings == cell.settings]
            store.set_plan(
                make_plan(session, [Pipeline(other.packer, session.scene, cell.settings) for other in siblings])
            )
            with answer_within(making_limit(cell.settings.timeout), cell.packer.name, "making it"):
                pipeline = Pipeline(cell.fresh(), session.scene, cell.settings)
            if reason := refusal(cell.settings, session.scene.host, [cell.packer], self.processes):
                pipeline.dead = ("failed", reason)
            Run(session, [pipeline], store, folder, pictures=False).all_frames(self.progress)
            if not self.wanted.timed:
                store.notes[note_of(cell)] = NOT_TIMED
            self._warm.add(id(cell))

    def folder_of(self, cell: SweepCell) -> Path:
        """The folder of the run that a cell belongs to."""
        return self.folder / self.folders[cell.settings]
