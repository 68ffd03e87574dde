"""How fast and how large this tree is beside another commit: the same commands in turn, and the ratios.

python -m tests.speed HEAD~1                     every command, 7 pairs of each
python -m tests.speed HEAD default tiny          what is not committed yet, by the two commands named
python -m tests.speed v0.1.0 default --pairs 12  more pairs, narrower intervals
python -m tests.speed HEAD --python OTHER        the same code with another environment's Python

Each command runs with both versions once before it is timed, so that caches are filled; those called cold start with
empty caches each time. Ratios are this tree over the other commit, as medians of the pairs with their 95 % intervals.
Rows of results are compared, but for times and memory. Ctrl-C ends it with what has been measured.
"""

from __future__ import annotations

import argparse
import csv
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median

from shading_atlas_bench.reports.store.columns import FRAME_COLUMNS
from shading_atlas_bench.reports.store.csv_files import median_interval
from tests.harness.commands import ROOT

FOUR = ("run", "--method", "all")
UNITS = {"wall": "s", "processor": "s", "peak": "MB"}
VARYING = {column.name for column in FRAME_COLUMNS if column.kind == "time"} - {"network_ms"} | {"peak_mb"}


@dataclass(frozen=True)
class Command:
    """A command that is timed. cold: with empty caches. scene: a file below BENCH_SCENES that it opens."""

    meaning: str
    arguments: tuple[str, ...]
    cold: bool = False
    scene: str = ""

    def scene_file(self) -> Path | None:
        """The file of its scene; None where it opens one of the suite's own."""
        return Path(os.environ.get("BENCH_SCENES", ""), self.scene) if self.scene else None


COMMANDS = {
    "default": Command("a default run of all methods", FOUR),
    "cold": Command("the same as the first command ever run", FOUR, cold=True),
    "tiny": Command("one small frame", ("run", "--method", "sas", "--frames", "1", "--size", "480x270")),
    "atlas": Command("a large atlas", (*FOUR, "--frames", "1", "--size", "160x90", "--atlas", "8192x8192")),
    "pixels": Command("a large picture", (*FOUR, "--frames", "1", "--size", "3840x2160")),
    "viking": Command("4 million triangles", (*FOUR, "--frames", "1"), scene="viking_village/scene.glb"),
}


class CommandError(Exception):
    """A command that ended with an error, and what it said."""


@dataclass
class Version:
    """A version: its name, where its code lies, the Python that runs it and its caches.

    values: of each quantity, by command, in the order of measuring. rows: of the last results of each command.
    """

    name: str
    code: Path
    python: str
    place: Path
    values: dict[str, list[dict[str, float]]] = field(default_factory=dict)
    rows: dict[str, list[dict[str, str]]] = field(default_factory=dict)

    def check(self) -> None:
        """Exit with a sentence unless its own code is what its Python runs: another one may be installed."""
        line = [self.python, "-c", "import shading_atlas_bench; print(shading_atlas_bench.__file__)"]
        environment = os.environ | {"PYTHONPATH": str(self.code)}
        found = subprocess.run(line, cwd=self.code, env=environment, capture_output=True, text=True).stdout.strip()
        if not (found and Path(found).resolve().is_relative_to(self.code.resolve())):
            sys.exit(f"{self.name} has no shading_atlas_bench that {self.python} would run: give a later commit.")

    def run(self, name: str) -> dict[str, float]:
        """Run a command: seconds on the clock and of processors, and the most megabytes that one process had."""
        command, out, caches = COMMANDS[name], self.place / "results", self.place / "caches"
        shutil.rmtree(out, ignore_errors=True)
        if command.cold:
            caches = self.place / "cold"
            shutil.rmtree(caches, ignore_errors=True)
        kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
        environment = kept | {"PYTHONPATH": str(self.code), "XDG_CACHE_HOME": str(caches)}
        scene = ["--scene", str(file)] if (file := command.scene_file()) else []
        line = [self.python, "-m", "shading_atlas_bench", *command.arguments, *scene, "--out", str(out)]
        with (self.place / "log").open("wb") as log:
            start = time.perf_counter()
            process = subprocess.Popen(
                line, cwd=self.code, env=environment, stdin=subprocess.DEVNULL, stdout=log, stderr=log
            )
            _, status, used = os.wait4(process.pid, 0)
            wall = time.perf_counter() - start
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            told = (self.place / "log").read_text(encoding="utf-8", errors="replace")[-2000:]
            raise CommandError(f"{self.name}: {' '.join(line)} ended with {process.returncode}:\n{told}")
        self.rows[name] = _rows(out)
        return {"wall": wall, "processor": used.ru_utime + used.ru_stime, "peak": used.ru_maxrss / 1024}


def _rows(out: Path) -> list[dict[str, str]]:
    """The rows of frames.csv without what varies."""
    with (out / "frames.csv").open(newline="", encoding="utf-8") as file:
        return [{name: cell for name, cell in row.items() if name not in VARYING} for row in csv.DictReader(file)]


def difference(new: list[dict[str, str]], old: list[dict[str, str]]) -> str:
    """What differs between two results' rows, in the columns that both have; empty if nothing does."""
    if len(new) != len(old):
        return f"{len(new)} rows, and {len(old)}"
    columns = [name for name in (new[0] if new else {}) if name in old[0]]
    differing = [name for name in columns if any(a[name] != b[name] for a, b in zip(new, old, strict=True))]
    return f"rows differ in {', '.join(differing)}" if differing else ""


def ratio_of(new: list[float], old: list[float]) -> tuple[float, float | None, float | None]:
    """The median of the pairs' ratios and the ends of its 95 % interval, which fewer than 6 pairs do not have."""
    ratios = sorted(a / b for a, b in zip(new, old, strict=True))
    return (median(ratios), *median_interval(ratios))


@contextmanager
def checked_out(revision: str, place: Path) -> Iterator[Path]:
    """A commit's files, in a folder of Git's until the block ends. Exits with Git's words if it cannot."""
    git = ["git", "-C", str(ROOT), "worktree"]
    made = subprocess.run([*git, "add", "--quiet", "--detach", str(place), revision], capture_output=True, text=True)
    if made.returncode:
        sys.exit(f"{revision} cannot be checked out: {made.stderr.strip()}")
    try:
        yield place
    finally:
        subprocess.run([*git, "remove", "--force", str(place)], check=True)


def measure(name: str, versions: tuple[Version, Version], pairs: int) -> None:
    """Time a command with both versions in turn; which of them is first changes from pair to pair."""
    if not COMMANDS[name].cold:
        for version in versions:
            version.run(name)
    for pair in range(pairs):
        for version in versions if pair % 2 else versions[::-1]:
            version.values.setdefault(name, []).append(version.run(name))
        walls = [version.values[name][-1]["wall"] for version in versions]
        print(f"  {name} {pair + 1} of {pairs}: {walls[0]:.2f} s, {walls[1]:.2f} s", file=sys.stderr, flush=True)


def tell(name: str, new: Version, old: Version) -> None:
    """Print the medians of a command and their ratios."""
    pairs = min(len(version.values.get(name, [])) for version in (new, old))
    if not pairs:
        return
    print(f"\n{name}: {COMMANDS[name].meaning} ({pairs} pairs)")
    for quantity, unit in UNITS.items():
        ours, theirs = ([one[quantity] for one in version.values[name][:pairs]] for version in (new, old))
        ratio, low, high = ratio_of(ours, theirs)
        interval = "" if low is None else f" ({low:.2f} to {high:.2f})"
        print(f"  {quantity:10}{median(ours):9.2f} {unit:3}{median(theirs):9.2f} {unit:3}{ratio:7.2f}{interval}")
    print(f"  {difference(new.rows[name], old.rows[name]) or 'the same rows'}")


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m tests.speed", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("revision", help="the other commit, as Git names it")
    parser.add_argument("command", nargs="*", help=f"{', '.join(COMMANDS)}; all where none is named")
    parser.add_argument("--pairs", type=int, default=7, help="times that each command runs with both (7)")
    parser.add_argument("--python", default=sys.executable, help="the other commit's Python")
    asked = parser.parse_args()
    if unknown := sorted(set(asked.command) - set(COMMANDS)):
        parser.error(f"there is no command {', '.join(unknown)}; there are {', '.join(COMMANDS)}.")
    failed = 0
    with tempfile.TemporaryDirectory(prefix="bench-speed-") as folder:
        place = Path(folder)
        for side in ("new", "old"):
            (place / side).mkdir()
        with checked_out(asked.revision, place / "code") as code:
            new = Version("this tree", ROOT, sys.executable, place / "new")
            old = Version(asked.revision, code, asked.python, place / "old")
            new.check()
            old.check()
            try:
                for name in asked.command or COMMANDS:
                    if (scene := COMMANDS[name].scene_file()) and not scene.is_file():
                        print(f"  {name}: left out, as there is no {scene} (BENCH_SCENES)", file=sys.stderr)
                        continue
                    try:
                        measure(name, (new, old), asked.pairs)
                    except CommandError as error:
                        print(f"  {name}: {error}", file=sys.stderr)
                        failed = 1
            except KeyboardInterrupt:
                print("Stopped; this is what was measured.", file=sys.stderr)
            print(f"\n{'':12}{new.name:>11}{old.name[:12]:>13}  ratio")
            for name in COMMANDS:
                tell(name, new, old)
    sys.exit(failed)


if __name__ == "__main__":
    main()
