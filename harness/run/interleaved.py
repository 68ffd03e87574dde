"""Two saved runs replayed in turn, each time by a new process, so that their times can be compared."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from shading_atlas_bench.harness.errors import InputError
from shading_atlas_bench.harness.progress import Progress
from shading_atlas_bench.harness.run.folder import COMPLETE
from shading_atlas_bench.reports.store.results import FILE, Store


def replay_in_turn(
    first: Path, second: Path, pairs: int, out: Path, progress: Progress
) -> tuple[list[Path], list[Path]]:
    """Replay two run.json, or those of two folders, so many times each, and return the folders of the runs: a-01, b-01
    and so on below `out`. Which comes first changes from pair to pair. Runs that are complete are not made again.

    Raises InputError for what cannot be replayed, and for a run with rows that failed.
    """
    files = [path / "run.json" if path.is_dir() else path for path in (first, second)]
    for file in files:
        if not file.is_file():
            raise InputError(f"{file} is no run.json: give one that bench run wrote, or its folder.")
    folders: tuple[list[Path], list[Path]] = ([], [])
    with progress.task("runs", 2 * pairs) as task:
        for number in range(1, pairs + 1):
            order = (0, 1) if number % 2 else (1, 0)
            for which in order:
                folder = out / f"{'ab'[which]}-{number:02d}"
                task.doing(f"pair {number} of {pairs}: {'AB'[which]}")
                if not _is_complete(folder):
                    _replay(files[which], folder)
                folders[which].append(folder)
                task.advance()
    return folders


def _is_complete(folder: Path) -> bool:
    if not (folder / FILE).is_file():
        return False
    with Store(folder) as store:
        return COMPLETE in store.notes


def _replay(file: Path, folder: Path) -> None:
    command = [sys.executable, "-m", "shading_atlas_bench", "run", "--config", str(file), "--out", str(folder)]
    done = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, encoding="utf-8", check=False)
    if done.returncode == 0:
        return
    said = " ".join(done.stderr.split())[-400:]
    why = f"some of its rows failed: see {folder}/report.html" if done.returncode == 1 else said
    raise InputError(f"Replaying {file} did not work: {why}")
