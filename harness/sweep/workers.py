"""Independent cells of a sweep side by side, for quality only: their times share the machine and mean nothing.

This process watches its workers as the supervisor watches it: one that crashes or hangs in a cell ends, and another
goes on without that cell.
"""

from __future__ import annotations

import contextlib
import json
import multiprocessing
import os
import queue
import signal
import tempfile
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any

from shading_atlas_bench.harness.errors import InputError
from shading_atlas_bench.harness.progress import Progress
from shading_atlas_bench.harness.sweep.cells import Sessions, SweepRun
from shading_atlas_bench.harness.sweep.grid import SweepGrid, make_grid, shuffled
from shading_atlas_bench.harness.watch.ends import crashed, ended_by, name_of, overdue_steps
from shading_atlas_bench.harness.watch.watchdog import ENDED, ended_steps
from shading_atlas_bench.kernels.journal import VARIABLE, read_journal
from shading_atlas_bench.reports.store.results import Store

if TYPE_CHECKING:
    from multiprocessing.process import BaseProcess
    from multiprocessing.queues import Queue

    from shading_atlas_bench.harness.sweep.request import SweepRequest

TICK = 0.5  # seconds between looks at the workers


def run_workers(wanted: SweepRequest, grid: SweepGrid, folder: Path, progress: Progress) -> None:
    """Measure every unfinished cell once, in as many processes as wanted.

    Raises InputError if workers die without getting anything done.
    """
    before, ended = None, ended_steps()
    while left := unfinished(grid, folder, wanted.settings.frames):
        if left == before:
            raise InputError("The workers ended before any cell was finished: run without --workers to see why.")
        found = _work_through(wanted, list(left), folder, progress, ended)
        before = None if found else left
        ended += found


def unfinished(grid: SweepGrid, folder: Path, frames: int) -> dict[int, int]:
    """How many frames are done of the cells that lack some, by the cells' numbers, in the seeded order."""
    folders, left = grid.folders(), {}
    numbers = {id(cell): number for number, cell in enumerate(grid.cells)}
    for cell in [cell for cells in grid.scenes() for cell in shuffled(cells, cells[0].settings.seed, 0)]:
        place = folder / folders[cell.settings]
        done = 0
        if (place / "results.sqlite").is_file():
            with Store(place) as store:
                done = sum(key[:2] == cell.key for key in store.finished())
        if done < frames:
            left[numbers[id(cell)]] = done
    return left


def _work_through(
    wanted: SweepRequest, left: list[int], folder: Path, progress: Progress, before: list[dict[str, Any]]
) -> list[dict[str, Any]]:
    """Hand the cells to new workers and wait until all have ended; returns the steps in which some were ended.

    before: those in which earlier ones were.
    """
    context = multiprocessing.get_context("spawn")
    cells: Queue[int | None] = context.Queue()
    done: Queue[int] = context.Queue()
    count = min(wanted.workers, len(left))
    for number in [*left, *[None] * count]:
        cells.put(number)
    ended = []
    with (
        tempfile.TemporaryDirectory(prefix="bench-") as place,
        progress.task(f"cells, {count} at a time", len(left)) as task,
    ):
        known = Path(place) / "ended"
        known.write_text(json.dumps(before), encoding="utf-8")
        journals = [Path(place) / f"journal-{number}" for number in range(count)]
        workers = [
            context.Process(target=_worker, args=(wanted, folder, cells, done, journal, known), daemon=True)
            for journal in journals
        ]
        try:
            for worker in workers:
                worker.start()
            while any(worker.is_alive() for worker in workers):
                for worker, journal in zip(workers, journals, strict=True):
                    if worker.is_alive() and (steps := overdue_steps(read_journal(journal))):
                        ended += ended_by(steps, "timeout", "it did not end")
                        worker.kill()
                with contextlib.suppress(queue.Empty):
                    done.get(timeout=TICK)
                    task.advance()
            for worker, journal in zip(workers, journals, strict=True):
                state, code = read_journal(journal), worker.exitcode
                if state and code is not None and crashed(code):
                    ended += ended_by(state["steps"].values(), "failed", f"the process crashed ({name_of(code)})")
        finally:
            for worker in workers:
                worker.terminate()
            for worker in workers:
                worker.join()
            cells.cancel_join_thread()
    return ended


def _worker(
    wanted: SweepRequest, folder: Path, cells: Queue[int | None], done: Queue[int], journal: Path, known: Path
) -> None:
    """Measure cells until there are no more; ends with its parent, however that ends."""
    os.environ |= {VARIABLE: str(journal), ENDED: str(known)}  # its own, not those of its parent

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides
    if parent := multiprocessing.parent_process():
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    share = str(max(1, (os.cpu_count() or 1) // wanted.workers))
    for name in ("POCL_CPU_MAX_CU_COUNT", "POCL_MAX_PTHREAD_COUNT"):  # of newer and of older PoCL
        os.environ.setdefault(name, share)
    grid = make_grid(wanted.settings, wanted.vary)
    run = SweepRun(wanted, grid, folder, Sessions(), Progress())
    while (number := cells.get()) is not None:
        run.once(grid.cells[number])
        done.put(number)


def _end_with(parent: BaseProcess) -> None:
    parent.join()
    os._exit(1)
