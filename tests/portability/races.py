"""Every kernel under Oclgrind, an OpenCL device that finds data races and accesses out of bounds.

`python -m tests.portability.races` makes each kernel's case at a small size, in a process of its own, and prints what
was found; it exits with 1 if anything was that is not explained below. `--case NAME` makes only that one. Oclgrind's
check for uninitialised memory is left out: version 21.10 loses track in vectors made of vectors, and finds what is not
there, or crashes. `test_memory.py` looks for that on any device.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

from shading_atlas_bench.harness.cases import find_cases
from shading_atlas_bench.kernels.case import INPUTS
from shading_atlas_bench.kernels.device import Device
from tests.portability.small import small_trial

MISSING = "Oclgrind is missing: install it (Debian, Ubuntu: apt install oclgrind)."
# Stores of equal values count. Without optimisation: LLVM's rewriting makes a true lane of a comparison of vectors 255
# in Oclgrind, where it is -1.
OCLGRIND = (
    "oclgrind",
    "--data-races",
    "--uniform-writes",
    "--max-errors",
    "1000",
    "--build-options",
    "-cl-opt-disable",
)
SECONDS = 600  # for one case


@dataclass(frozen=True, order=True)
class Race:
    """What was found, in which kernel, at which line of its source."""

    kernel: str
    what: str
    line: str


BYTES = "items store the same byte, see raster/mark.cl"
EXPLAINED = {
    Race("mark_visible", "Write-write data race", "flags[row[i]] = 1;"): BYTES,
    Race("mark_layers", "Write-write data race", "flags[triangle[at]] = 1;"): BYTES,
    Race("mark_layers", "Write-write data race", "flags[opaque[pixel]] = 1;"): BYTES,
    Race("note_seen", "Write-write data race", "last_seen[row[i] / CLUSTER] = now;"): "items store the same word",
}


def races_in(log: str) -> list[Race]:
    """What an Oclgrind log tells, in order, each once: without addresses and items."""
    found = set()
    for part in log.split("\n\n"):
        message = part.strip().splitlines()
        kernel = re.search(r"^\s*Kernel:\s+(\w+)", part, re.MULTILINE)
        if kernel:
            what = re.sub(r" at \w+ memory address.*", "", message[0])
            found.add(Race(kernel[1], what, message[-1].strip()))
    return sorted(found)


def under_oclgrind(command: Sequence[str]) -> tuple[list[Race], str]:
    """Run a command with Oclgrind as its only OpenCL device: what was found, and how it failed, if it did."""
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log"
        log.touch()
        try:
            done = subprocess.run(
                [*OCLGRIND, "--log", str(log), *command], capture_output=True, text=True, timeout=SECONDS, check=False
            )
        except subprocess.TimeoutExpired:
            return races_in(log.read_text(encoding="utf-8")), f"not done after {SECONDS} s"
        last = done.stderr.strip().rpartition("\n")[2]
        failure = f"it ended with {done.returncode}: {last}" if done.returncode else ""
        return races_in(log.read_text(encoding="utf-8")), failure


def check(name: str) -> tuple[list[Race], str]:
    """A case under Oclgrind."""
    return under_oclgrind([sys.executable, "-W", "ignore", "-m", "tests.portability.races", "--make", name])


def make(name: str) -> None:
    """Run a case on Oclgrind's device, with no more memory than was asked for.

    Functions stay calls: inlined, they hold intrinsics that Oclgrind does not know.
    """
    import pyopencl as cl

    class Program(cl.Program):
        def __init__(self, context: cl.Context, source: str, *rest: object) -> None:
            plain = source.replace("__attribute__((always_inline)) ", "").replace("static inline ", "static ")
            super().__init__(context, plain, *rest)

    with mock.patch.object(cl, "Program", Program), mock.patch.object(Device, "recycled", Device.empty):
        device = Device.open("oclgrind")
        (case,) = (case for case in find_cases() if case.name == name)
        for kind in INPUTS:
            trial = small_trial(case, device, kind)
            trial.run()
            trial.run()  # the first leaves something that later ones forget
        device.finish()


def main(arguments: Sequence[str]) -> int:
    """The exit code: 1 if anything unexplained was found; 0 if nothing was, or Oclgrind is missing, and it says so."""
    names = [case.name for case in find_cases()]
    parser = argparse.ArgumentParser(prog="python -m tests.portability.races", description=__doc__)
    parser.add_argument("--case", choices=names, metavar="NAME", help="make only this case, as raster/drawing")
    parser.add_argument("--make", choices=names, help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.make:
        make(options.make)
        return 0
    if not shutil.which("oclgrind"):
        print(f"Skipped: {MISSING}")
        return 0
    bad = 0
    for case in [options.case] if options.case else names:
        found, failure = check(case)
        unexplained = [finding for finding in found if finding not in EXPLAINED]
        bad += bool(unexplained or failure)
        print(f"{case:40} {failure or ('findings' if unexplained else 'explained' if found else 'clean')}", flush=True)
        for finding in found:
            print(f"  {finding.kernel}: {finding.what}: {EXPLAINED.get(finding, 'NOT EXPLAINED')}\n    {finding.line}")
    print(f"{bad} cases with findings that are not explained." if bad else "Nothing that is not explained.")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
