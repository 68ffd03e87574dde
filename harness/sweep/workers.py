"""Independent cells of a sweep side by side, for quality only: their times share the machine and mean nothing."""

from __future__ import annotations

import multiprocessing
import os
import queue
import signal
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harness.console import InputError
from harness.run import show_progress
from harness.sweep.grid import Grid, make_grid, shuffled
from reports.store import Store

if TYPE_CHECKING:
    from rich.progress import Progress

    from harness.sweep.wanted import Wanted

HUNG = 3  # exit code of a worker whose kernel hangs


def run_workers(wanted: Wanted, grid: Grid, folder: Path, progress: Progress) -> None:
    """Measure every unfinished cell once, in as many processes as wanted; a hanging kernel ends only its worker.

    Raises InputError if workers die without getting anything done.
    """
    before = None
    while left := unfinished(grid, folder, wanted.settings.frames):
        if left == before:
            raise InputError("The workers ended before any cell was finished: run without --workers to see why.")
        before = left
        _work_through(wanted, list(left), folder, progress)


def unfinished(grid: Grid, folder: Path, frames: int) -> dict[int, int]:
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


def _work_through(wanted: Wanted, left: list[int], folder: Path, progress: Progress) -> None:
    """Hand the cells to new workers and wait until all of them have ended."""
    context = multiprocessing.get_context("spawn")
    cells, done = context.Queue(), context.Queue()
    count = min(wanted.workers, len(left))
    for number in [*left, *[None] * count]:
        cells.put(number)
    workers = [context.Process(target=_worker, args=(wanted, folder, cells, done), daemon=True) for _ in range(count)]
    task = progress.add_task(f"cells, {count} at a time", total=len(left))
    try:
        for worker in workers:
            worker.start()
        while any(worker.is_alive() for worker in workers):
            try:
                done.get(timeout=0.5)
                progress.advance(task)
            except queue.Empty:
                continue
    finally:
        for worker in workers:
            worker.terminate()
        for worker in workers:
            worker.join()
        cells.cancel_join_thread()
        progress.remove_task(task)


def _worker(wanted: Wanted, folder: Path, cells: Any, done: Any) -> None:
    """Measure cells until there are no more; ends with its parent, however that ends."""
    from harness.sweep.run import Sessions, SweepRun

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides
    threading.Thread(target=_end_with_parent, daemon=True).start()
    share = str(max(1, (os.cpu_count() or 1) // wanted.workers))
    for name in ("POCL_CPU_MAX_CU_COUNT", "POCL_MAX_PTHREAD_COUNT"):  # of newer and of older PoCL
        os.environ.setdefault(name, share)
    grid = make_grid(wanted.settings, wanted.vary)
    run = SweepRun(wanted, grid, folder, Sessions())
    run.start_again = lambda: os._exit(HUNG)
    with show_progress() as progress:
        progress.disable = True
        while (number := cells.get()) is not None:
            run.once(grid.cells[number], progress)
            done.put(number)


def _end_with_parent() -> None:
    multiprocessing.parent_process().join()
    os._exit(1)
