"""Independent cells of a sweep side by side, for quality only: their times share the machine and mean nothing.

This process watches its workers as the supervisor watches it: one that crashes, hangs in a step or does not stir any
more ends, and another one goes on with its cell, without the step that it ended in.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import tempfile
import threading
import time
from collections import Counter, deque
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import connection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from shading_atlas_bench.harness.errors import InputError
from shading_atlas_bench.harness.progress import Progress, Task, warnings_as_sentences
from shading_atlas_bench.harness.sweep.cells import Sessions, SweepRun
from shading_atlas_bench.harness.sweep.grid import SweepGrid, make_grid, shuffled
from shading_atlas_bench.harness.watch.ends import cause_of, crashed, ended_by, overdue_steps
from shading_atlas_bench.harness.watch.watchdog import ENDED, ended_steps
from shading_atlas_bench.kernels.journal import VARIABLE, read_journal
from shading_atlas_bench.reports.store.results import FILE, Store

if TYPE_CHECKING:
    from ctypes import c_double
    from multiprocessing.connection import Connection
    from multiprocessing.context import SpawnProcess

    from shading_atlas_bench.harness.sweep.request import SweepRequest

TICK = 0.5  # seconds between looks at the workers
BEAT = 1.0  # seconds between a worker's signs of life
STARTING = 600.0  # seconds without one after which a worker is lost that has just begun, importing everything
SILENT = 60.0  # the same later: no library keeps all threads of Python from running for so long
PATIENCE = 1.0  # seconds that workers have to end by themselves
TRIES = 3  # workers that may end in one cell without a step to blame


def run_workers(wanted: SweepRequest, grid: SweepGrid, folder: Path, count: int, progress: Progress) -> None:
    """Measure every unfinished cell once, in `count` processes.

    Raises InputError if workers end in a cell again and again, and nobody knows why.
    """
    left = unfinished(grid, folder, wanted.settings.frames)
    if not left:
        return
    count = min(count, len(left))
    with (
        tempfile.TemporaryDirectory(prefix="bench-") as place,
        progress.task(f"cells, {count} at a time", len(left)) as task,
    ):
        crew = _Crew(wanted, grid, folder, count, Path(place), left, task)
        try:
            while crew.goes_on():
                pass
        finally:
            crew.end()


def unfinished(grid: SweepGrid, folder: Path, frames: int) -> list[int]:
    """The numbers of the cells that lack frames, in the seeded order."""
    folders, left = grid.folders(), []
    numbers = {id(cell): number for number, cell in enumerate(grid.cells)}
    for cell in [cell for cells in grid.scenes() for cell in shuffled(cells, cells[0].settings.seed, 0)]:
        place = folder / folders[cell.settings]
        done = 0
        if (place / FILE).is_file():
            with Store(place) as store:
                done = sum(key[:2] == cell.key for key in store.finished())
        if done < frames:
            left.append(numbers[id(cell)])
    return left


@dataclass
class _Worker:
    """A process with the cell that it is at, None when it is to end; beat: when it stirred last, 0 before it began."""

    process: SpawnProcess
    pipe: Connection
    journal: Path
    beat: c_double
    since: float
    cell: int | None = None

    def is_lost(self) -> bool:
        """Whether it has not stirred for too long: it was stopped, or hangs where none of its threads can run."""
        now = time.monotonic()
        return now > (self.beat.value + SILENT if self.beat.value else self.since + STARTING)


class _Crew:
    """The workers of a sweep, and the cells that nobody has begun.

    Each has a pipe of its own, and no lock is shared: one that is killed holds up nobody else.
    """

    def __init__(
        self,
        wanted: SweepRequest,
        grid: SweepGrid,
        folder: Path,
        count: int,
        place: Path,
        left: Iterable[int],
        task: Task,
    ) -> None:
        self.wanted, self.grid, self.folder, self.count = wanted, grid, folder, count
        self.place, self.task = place, task
        self.left = deque(left)
        self.workers: list[_Worker] = []
        self.ended = ended_steps()  # those of earlier processes, too
        self.known = place / "ended"
        self.fruitless: Counter[int] = Counter()  # ends of workers by cell
        self.started = 0
        self._tell_ended()

    def goes_on(self) -> bool:
        """Look after the workers once, after a moment; whether there are any."""
        while self.left and len(self.workers) < self.count:
            self._start()
        connection.wait([end for worker in self.workers for end in (worker.pipe, worker.process.sentinel)], TICK)
        for worker in list(self.workers):
            self._look_after(worker)
        return bool(self.workers or self.left)

    def end(self) -> None:
        """End all workers, also those that do not run."""
        for worker in self.workers:
            worker.process.terminate()
        until = time.monotonic() + PATIENCE
        for worker in self.workers:
            worker.process.join(max(0.0, until - time.monotonic()))
            worker.process.kill()
            worker.process.join()

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe()
        journal, beat = self.place / f"journal-{self.started}", context.Value("d", 0.0, lock=False)
        self.started += 1
        process = context.Process(
            target=_work, args=(self.wanted, self.folder, self.count, theirs, beat, journal, self.known), daemon=True
        )
        process.start()
        theirs.close()
        worker = _Worker(process, ours, journal, beat, time.monotonic())
        self.workers.append(worker)
        self._give(worker)

    def _give(self, worker: _Worker) -> None:
        """Hand a worker its next cell, or have it end."""
        worker.cell = self.left.popleft() if self.left else None
        with suppress(OSError):  # it has ended, which is seen in a moment
            worker.pipe.send(worker.cell)

    def _look_after(self, worker: _Worker) -> None:
        """Take what it has finished, and end it where it is past its time."""
        with suppress(EOFError, OSError):  # it has ended
            while worker.pipe.poll():
                worker.pipe.recv()
                self.task.advance()
                self._give(worker)
        state, code = read_journal(worker.journal), worker.process.exitcode
        if steps := overdue_steps(state):
            self._bury(worker, ended_by(steps, "timeout"))
        elif code is not None:
            steps = list(state["steps"].values()) if state and crashed(code) else []
            self._bury(worker, ended_by(steps, "failed", f"the process crashed ({cause_of(code)})") if steps else [])
        elif worker.is_lost():
            self._bury(worker, [])

    def _bury(self, worker: _Worker, ended: list[dict[str, Any]]) -> None:
        """Have a worker replaced, and its cell done by another one without what it ended in."""
        worker.process.kill()
        worker.process.join()
        worker.pipe.close()
        self.workers.remove(worker)
        if worker.cell is None:
            return
        self.left.appendleft(worker.cell)
        self.ended += ended
        self._tell_ended()
        self.fruitless[worker.cell] += not ended
        if self.fruitless[worker.cell] == TRIES:
            cell = self.grid.cells[worker.cell]
            raise InputError(
                f"{TRIES} workers ended in the cell {cell.contender} {cell.varied}: run without --workers to see why."
            )

    def _tell_ended(self) -> None:
        """Let all workers read what none may begin again."""
        part = self.known.with_suffix(".part")
        part.write_text(json.dumps(self.ended), encoding="utf-8")
        os.replace(part, self.known)


def _work(
    wanted: SweepRequest, folder: Path, count: int, pipe: Connection, beat: c_double, journal: Path, known: Path
) -> None:
    """Measure cells until there are no more, one of `count` processes; ends with its parent, however that ends."""
    os.environ |= {VARIABLE: str(journal), ENDED: str(known)}  # its own, not those of its parent

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides
    warnings_as_sentences()
    threading.Thread(target=_stir, args=(beat,), daemon=True).start()
    share = str(max(1, (os.cpu_count() or 1) // count))
    for name in ("POCL_CPU_MAX_CU_COUNT", "POCL_MAX_PTHREAD_COUNT"):  # of newer and of older PoCL
        os.environ.setdefault(name, share)
    grid = make_grid(wanted.settings, wanted.vary)
    run = SweepRun(wanted, grid, folder, Sessions(), Progress(), count)
    while (number := pipe.recv()) is not None:
        run.once(grid.cells[number])
        pipe.send(number)


def _stir(beat: c_double) -> None:
    """Show that this process runs, and end it when its parent has ended."""
    parent = multiprocessing.parent_process()
    while parent and parent.is_alive():
        beat.value = time.monotonic()
        parent.join(BEAT)
    os._exit(1)
