"""The folder of a run's results: found or made, locked, and kept when the run is stopped."""

from __future__ import annotations

import itertools
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from shading_atlas_bench.harness.errors import InputError, StoppedError
from shading_atlas_bench.harness.progress import Progress
from shading_atlas_bench.harness.watch.stops import stops_apart
from shading_atlas_bench.reports.store.database import StoreError
from shading_atlas_bench.reports.store.results import FILE, Store

RUNS = Path("runs")
LOCK = ".lock"
COMPLETE = "run/complete"  # note of a run that has ended: `bench report` makes a report of others, too


def check_folder(out: Path | None) -> None:
    """Raise InputError for a results folder that holds something else already."""
    if out is None or not out.exists() or (out / FILE).is_file():
        return
    if not out.is_dir():
        raise InputError(f"{out} is a file: give a folder for --out.")
    if any(entry.name != LOCK for entry in out.iterdir()):
        raise InputError(f"The folder {out} holds other things than results: give a new or empty one for --out.")


def check_results(folder: Path) -> None:
    """Raise InputError for a folder without results."""
    file = folder / FILE
    if file.is_file():
        return
    if os.path.lexists(file):
        raise InputError(f"{file} is no file: give a folder that bench run wrote.")
    raise InputError(f"{folder} has no {FILE}: give a folder that bench run wrote.")


def make_folder(out: Path) -> None:
    """Make a results folder where there is none. Raises InputError if it cannot be one."""
    if out.is_file():
        raise InputError(f"{out} is a file: give a folder for --out.")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{out} cannot be made ({error.strerror}): give another --out.") from error


def folder_for(plan: dict[str, Any], name: str, progress: Progress) -> Path:
    """The newest unfinished run of this plan below runs/, else a new folder there whose name ends in `name`.

    Runs that cannot be read are left as they are; it is said of those that may be unfinished. Raises InputError if no
    folder can be made.
    """
    wanted, unreadable = json.loads(json.dumps(plan)), []
    for folder in sorted(RUNS.glob("*/"), reverse=True):
        if not (folder / FILE).is_file():
            continue
        try:
            with Store(folder, must_exist=True, checked=False) as store:
                if COMPLETE in store.notes or store.plan() != wanted or in_use(folder):
                    continue
            Store(folder, must_exist=True).close()
            return folder
        except StoreError as error:
            if not (folder / "report.html").is_file():
                unreadable.append(error)
    if unreadable:
        others = f" {len(unreadable) - 1} more cannot be read." if unreadable[1:] else ""
        progress.say(f"Not resumed: {unreadable[0]}{others}")
    return _new_folder(datetime.now().strftime("%Y%m%d-%H%M%S") + "-" + name)


def _new_folder(stem: str) -> Path:
    """A folder below runs/ that was not there before. Raises InputError."""
    folder = RUNS
    try:
        RUNS.mkdir(exist_ok=True)
        for number in itertools.count():
            folder = RUNS / (stem if number == 0 else f"{stem}-{number}")
            if not os.path.lexists(folder):  # else another run began in the same second
                with suppress(FileExistsError):
                    folder.mkdir()
                    return folder
    except OSError as error:
        raise InputError(f"{folder} cannot be made ({error.strerror}): give --out.") from error
    raise AssertionError("the numbers do not end")


@contextmanager
def stops_kept(folder: Path) -> Iterator[None]:
    """Ctrl-C and SIGTERM end what runs in the block. Raises StoppedError, which says what is kept."""

    try:
        with stops_apart():
            yield
    except KeyboardInterrupt:
        raise StoppedError(f"Finished frames are kept: the same command with --out {folder} goes on.") from None


def in_use(folder: Path) -> bool:
    """Whether another process works in this folder."""
    try:
        with FileLock(folder / LOCK, timeout=0):
            return False
    except (Timeout, OSError):
        return True


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep two processes from writing one run; the lock ends with the process, however that ends.

    Raises InputError if another process has it, or if the folder cannot be written.
    """
    lock = FileLock(folder / LOCK, timeout=0)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    except Timeout:
        raise InputError(f"{folder} is in use by another bench run: wait for it, or give another --out.") from None
    except OSError as error:
        file = folder / LOCK
        if os.path.lexists(file) and (file.is_symlink() or not file.is_file()):  # which nobody follows, or locks
            raise InputError(f"{file} is no file: delete it, or give another --out.") from error
        raise InputError(f"{folder} cannot be written ({error.strerror}): give another --out.") from error
    try:
        yield
    finally:
        lock.release()
