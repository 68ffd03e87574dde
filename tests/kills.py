"""Kill commands at random moments; resumed, they have the rows of one that was left alone: none lost, none doubled.

python -m tests.kills                      200 kills, of run, sweep, sweep with workers (parallel) and report
python -m tests.kills run --times 50       of `bench run` alone
python -m tests.kills --seed 7             at other moments

A command is killed FEW times before it may end; after each kill the stores are held to those of a run that nobody
killed. Killed are, by chance, the process that watches, the one that works, or all of them at once: some time after it
began, or shortly after so many more rows were written.
"""

from __future__ import annotations

import argparse
import random
import shutil
import sqlite3
import subprocess
import sys
import tempfile
import time
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

import psutil

from shading_atlas_bench.reports.store.columns import FRAME_COLUMNS, FRAME_KEY
from shading_atlas_bench.reports.store.results import FILE, Store
from tests.harness.commands import ROOT

SMALL = ["--method", "sas", "--method", "ppll", "--size", "160x90", "--atlas", "128x128", "--frames", "3",
         "--codec", "none"]  # fmt: skip
GRID = [*SMALL, "--vary", "fit=0.5,0.9", "--repetitions", "2", "--precision", "100", "--budget", "600"]
COMMANDS = {
    "run": ["run", *SMALL, "--metrics", "psnr"],
    "sweep": ["sweep", *GRID],
    "parallel": ["sweep", *GRID, "--workers", "2"],
    "report": ["report"],
}
BENCH = (sys.executable, "-m", "shading_atlas_bench")
FEW = 4  # kills before a command may end
BETWEEN_ROWS = 0.5  # seconds, in which a command begins, writes or ends a row
LONGEST = 3600.0  # seconds of a command that nobody kills
VARYING = {column.name for column in FRAME_COLUMNS if column.kind == "time"} - {"network_ms"} | {"peak_mb"}
Rows = dict[tuple[Any, ...], Any]


def rows_of(folder: Path) -> Rows:
    """What all stores below a folder hold but for times, by its key. Raises StoreError for a damaged one."""
    found: Rows = {}
    for file in folder.rglob(FILE):
        if not file.stat().st_size:  # killed as it began
            continue
        place = str(file.parent.relative_to(folder))
        with Store(file.parent, must_exist=True) as store:
            rows, repeats, finished = store.rows(), store.repeats(), store.finished()
        of_frames = {(row["method"], row["variant"], row["frame"]) for row in rows}
        assert of_frames == finished, f"{file} has frames without rows, or rows of no frame"
        for row in rows:
            key = (place, *(row[name] for name in FRAME_KEY))
            assert key not in found, f"{file} has a row twice"
            found[key] = {name: value for name, value in row.items() if name not in VARYING}
        for one in repeats:
            found[place, one["method"], one["variant"], one["frame"], one["stage"], one["repetition"]] = None
    return found


class Victim:
    """A command that is killed. reference: the folder of one that ended; seconds: how long that took."""

    def __init__(self, name: str, folder: Path) -> None:
        self.name, self.folder = name, folder
        self.reference = folder / f"{name}-reference"
        if name == "report":
            self._end(["run", *SMALL, "--out", str(self.reference)])
        start = time.monotonic()
        self._end(self._arguments(self.reference))
        self.seconds = time.monotonic() - start
        self.expected = rows_of(self.reference)
        assert self.expected, "the command measures nothing"
        if name != "report":  # a first one also compiles kernels
            shutil.rmtree(self.reference)
            start = time.monotonic()
            self._end(self._arguments(self.reference))
            self.seconds = time.monotonic() - start
            assert rows_of(self.reference) == self.expected, "two runs differ though nobody was killed"

    def chain(self, kills: int, chance: random.Random) -> int:
        """So many kills, and then an end; how many of them met a process. Raises AssertionError for a lost row."""
        folder = self.folder / f"{self.name}-killed"
        shutil.rmtree(folder, ignore_errors=True)
        if self.name == "report":
            shutil.copytree(self.reference, folder)
        met, before, most = 0, rows_of(folder), len(self.expected)
        for _ in range(kills):
            counted = self.name != "report" and chance.random() < 0.7
            awaited = chance.randint(min(len(before) + 1, most), most) if counted else 0
            moment = chance.uniform(0, BETWEEN_ROWS if counted else self.seconds)
            whom = chance.choice(["watcher", "worker", "all"])
            killed = self._kill(folder, moment, whom, awaited)
            after = rows_of(folder)
            told = f"{self.name}: {whom} killed {moment:.2f} s after {f'row {awaited}' if counted else 'it began'}"
            told += f": {len(before)}, then {len(after)} of {most} rows"
            assert before.keys() <= after.keys(), f"{told}; lost: {sorted(before.keys() - after.keys(), key=str)}"
            wrong = [key for key, value in after.items() if key not in self.expected or self.expected[key] != value]
            assert not wrong, f"{told}; wrong: {wrong}"
            print(told if killed else f"{self.name}: ended before it was killed", flush=True)
            met, before = met + killed, after
        self._end(self._arguments(folder))
        assert rows_of(folder) == self.expected, f"{self.name}: other rows after the end"
        self._same_files(folder)
        return met

    def _same_files(self, folder: Path) -> None:
        """The files are those of the reference, and nothing half-written is left."""
        names, expected = ({path.name for path in place.iterdir()} for place in (folder, self.reference))
        assert names == expected, f"{self.name}: {names ^ expected}"
        if self.name == "report":
            for file in self.reference.glob("*.csv"):
                assert (folder / file.name).read_bytes() == file.read_bytes(), f"{file.name} differs"

    def _arguments(self, folder: Path) -> list[str]:
        return [*COMMANDS[self.name], *([] if self.name == "report" else ["--out"]), str(folder)]

    def _end(self, arguments: list[str]) -> None:
        done = subprocess.run(
            [*BENCH, *arguments], cwd=ROOT, capture_output=True, text=True, timeout=LONGEST, check=False
        )
        assert done.returncode == 0, f"bench {' '.join(arguments)} ended with {done.returncode}:\n{done.stderr}"

    def _kill(self, folder: Path, moment: float, whom: str, awaited: int) -> bool:
        """Start the command and kill one or all of its processes some seconds after so many rows lie there; whether it
        still ran then."""
        with _start(self._arguments(folder)) as process:
            while awaited and process.poll() is None and _written(folder) < awaited:
                time.sleep(0.01)
            try:
                process.wait(moment)
                return False
            except subprocess.TimeoutExpired:
                own = psutil.Process(process.pid)
                others = own.children(recursive=True)
            hit = {"watcher": [own], "worker": others[:1] or [own], "all": [own, *others]}[whom]
            for one in hit:
                with suppress(psutil.NoSuchProcess):
                    one.kill()
            process.wait(LONGEST)
        _, alive = psutil.wait_procs([*others, *_descendants(others)], timeout=60)
        assert not alive, f"these live on without the process that watched them: {alive}"
        return True


def _written(folder: Path) -> int:
    """How many rows lie below a folder in which a command writes, but for those of a store that is locked."""
    count = 0
    for file in folder.rglob(FILE):
        with (
            suppress(sqlite3.Error),
            closing(sqlite3.connect(f"{file.as_uri()}?mode=ro", timeout=0, uri=True)) as store,
        ):
            count += sum(store.execute(f"SELECT COUNT(*) FROM {table}").fetchone()[0] for table in ("rows", "repeats"))
    return count


def _descendants(processes: list[psutil.Process]) -> list[psutil.Process]:
    """What these have started meanwhile."""
    found = []
    for one in processes:
        try:
            found += one.children(recursive=True)
        except psutil.NoSuchProcess:
            continue
    return found


def _start(arguments: list[str]) -> subprocess.Popen[bytes]:
    quiet = subprocess.DEVNULL
    return subprocess.Popen([*BENCH, *arguments], cwd=ROOT, stdin=quiet, stdout=quiet, stderr=quiet)


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m tests.kills", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("command", nargs="*", help=f"{', '.join(COMMANDS)}; all in turn where none is named")
    parser.add_argument("--times", type=int, default=200, help="kills in all (200)")
    parser.add_argument("--seed", type=int, default=0, help="of the moments (0)")
    asked = parser.parse_args()
    if unknown := sorted(set(asked.command) - set(COMMANDS)):
        parser.error(f"there is no command {', '.join(unknown)}; there are {', '.join(COMMANDS)}.")
    if asked.times < 1:
        parser.error("--times must be 1 or more.")
    chance, done = random.Random(asked.seed), 0
    with tempfile.TemporaryDirectory(prefix="bench-kills-") as place:
        victims = [Victim(name, Path(place)) for name in asked.command or COMMANDS]
        while done < asked.times:
            before = done
            for victim in victims:
                if done < asked.times:
                    done += victim.chain(min(FEW, asked.times - done), chance)
            if done == before:
                sys.exit("The commands end before they can be killed.")
    print(f"{done} kills: no row lost, none doubled")


if __name__ == "__main__":
    main()
