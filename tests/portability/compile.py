"""Every kernel compiled for GPUs, without one: with clang and libclc for NVIDIA's and AMD's.

`python -m tests.portability.compile` compiles what the kernels' cases and small runs of all methods build, with their
own options, and exits with 1 if anything does not compile. Where NVIDIA's assembler is found (on the path, or from
`pip install nvidia-cuda-nvcc-cu12`), it tells the registers, stack and spills of every kernel on a Turing GPU; `--out
FILE` writes them as CSV.
"""

from __future__ import annotations

import argparse
import csv
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import astuple, dataclass, fields
from importlib.util import find_spec
from pathlib import Path

from tests.portability.builds import Build, builds_of_cases, builds_of_runs

LIBRARIES = Path("/usr/lib/clc")
CLANGS = ("clang-14", "clang-15", "clang-16", "clang")  # a library's bitcode is read by its own clang and later ones
MISSING = "clang or libclc is missing: install them (Debian, Ubuntu: apt install clang-14 libclc-14)."
COMMON = ("-x", "cl", "-O2", "-Xclang", "-finclude-default-header", "-Werror=uninitialized", "-Wno-unused-value")


@dataclass(frozen=True)
class Target:
    """What to compile for: clang's options, libclc's library, and whether to stop at assembler text."""

    name: str
    options: tuple[str, ...]
    library: str
    to: str


TURING = "sm_75"
TARGETS = (
    # clang 14 declares vstore_half only with cl_khr_fp16, though OpenCL C (6.12.7) has it without.
    Target(
        f"NVIDIA {TURING}",
        ("-target", "nvptx64-nvidia-nvcl", "-Xclang", "-target-cpu", "-Xclang", TURING, "-Xclang",
         "-cl-ext=+cl_khr_fp16"),
        "nvptx64--nvidiacl.bc", "-S",
    ),
    Target("AMD gfx900", ("-target", "amdgcn-amd-amdhsa", "-mcpu=gfx900", "-nogpulib"), "amdgcn--amdhsa.bc", "-c"),
)  # fmt: skip


@dataclass(frozen=True)
class Usage:
    """What a kernel takes of a GPU, by NVIDIA's assembler: registers per work-item; bytes of stack and spilled."""

    build: str
    kernel: str
    registers: int
    stack: int
    spill_stores: int
    spill_loads: int


def find_clang() -> str | None:
    """A clang, where there is libclc for it."""
    found = [path for path in map(shutil.which, CLANGS) if path]
    complete = all((LIBRARIES / target.library).is_file() for target in TARGETS)
    return found[0] if found and complete else None


def find_ptxas() -> str | None:
    """NVIDIA's assembler."""
    package = find_spec("nvidia")
    folders = [Path(folder) / "cuda_nvcc" / "bin" for folder in (package and package.submodule_search_locations) or ()]
    return shutil.which("ptxas", path=os.pathsep.join([os.environ.get("PATH", ""), *map(str, folders)]))


def compile_for(target: Target, clang: str, build: Build, result: Path, to: str = "") -> str:
    """Compile a build into a file; what clang says if it does not compile, else nothing. to: the last step, if not
    the target's."""
    library = ("-Xclang", "-mlink-builtin-bitcode", "-Xclang", str(LIBRARIES / target.library), "-Wno-linker-warnings")
    command = [clang, *COMMON, *build.options, *target.options, *library, to or target.to, "-o", str(result), "-"]
    done = subprocess.run(command, input=build.source, capture_output=True, text=True, check=False)
    return done.stderr if done.returncode else ""


def usage_of(ptxas: str, build: Build, assembler: Path) -> list[Usage]:
    """The kernels of a build; raises RuntimeError with what ptxas says if it does not get through."""
    command = [ptxas, "-v", f"-arch={TURING}", str(assembler), "-o", os.devnull]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(done.stderr)
    return parse_usage(build.name, done.stdout + done.stderr)


def parse_usage(build: str, text: str) -> list[Usage]:
    """What `ptxas -v` prints of each entry point."""
    found = []
    for part in text.split("Compiling entry function ")[1:]:
        kernel = part.split("'")[1]
        # Functions that are called have properties of their own, in any order.
        own = part.split(f"Function properties for {kernel}")[1]
        sizes = re.findall(r"(\d+) bytes stack frame, (\d+) bytes spill stores, (\d+) bytes spill loads", own)[0]
        registers = re.findall(r"Used (\d+) registers", part)[0]
        found.append(Usage(build, kernel, *map(int, (registers, *sizes))))
    return found


def compile_all(
    builds: Iterable[Build], clang: str, ptxas: str | None
) -> tuple[list[tuple[str, str, str]], list[Usage]]:
    """Compile for all targets: which target and build failed and why, and what the kernels take by ptxas."""

    def one(build: Build) -> tuple[list[tuple[str, str, str]], list[Usage]]:
        failed, usage = [], []
        with tempfile.TemporaryDirectory() as folder:
            for target in TARGETS:
                result = Path(folder) / "result"
                error = compile_for(target, clang, build, result)
                if not error and ptxas and target.to == "-S":
                    try:
                        usage = usage_of(ptxas, build, result)
                    except RuntimeError as refused:
                        error = str(refused)
                if error:
                    failed.append((target.name, build.name, error))
        return failed, usage

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        parts = list(pool.map(one, builds))
    return [failure for failed, _ in parts for failure in failed], [row for _, usage in parts for row in usage]


def show_usage(usage: Sequence[Usage]) -> None:
    """A table of 80 columns, a line per kernel, the build above it."""
    print(f"{'':44}{'registers':>10}{'stack':>9}{'spilled':>9}")
    build = ""
    for row in usage:
        if build != (build := row.build):
            print(build if len(build) <= 80 else f"{build[:77]}...")
        print(f"  {row.kernel:42}{row.registers:10}{row.stack:9}{row.spill_stores + row.spill_loads:9}")
    large, spill = sum(row.stack > 256 for row in usage), sum(row.spill_stores + row.spill_loads > 0 for row in usage)
    print(f"{len(usage)} kernels on {TURING}: {large} with more than 256 bytes of stack, {spill} that spill.")


def main(arguments: Sequence[str]) -> int:
    """The exit code: 1 if something does not compile; 0 if all does, or there is no compiler, and it says so."""
    parser = argparse.ArgumentParser(prog="python -m tests.portability.compile", description=__doc__)
    parser.add_argument("--out", type=Path, help="CSV of what every kernel takes")
    out = parser.parse_args(arguments).out
    clang = find_clang()
    if not clang:
        print(f"Skipped: {MISSING}")
        return 0
    started = time.monotonic()
    builds = sorted({*builds_of_cases(), *builds_of_runs()})
    noted = time.monotonic()
    failures, usage = compile_all(builds, clang, find_ptxas())
    if usage:
        show_usage(usage)
    else:
        print("Registers, stack and spills need ptxas: pip install nvidia-cuda-nvcc-cu12 brings it.")
    if out and usage:
        with out.open("w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows([[field.name for field in fields(Usage)], *map(astuple, usage)])
    for target, build, error in failures:
        print(f"{build} does not compile for {target}:\n{error}", file=sys.stderr)
    count = len(builds)
    print(
        f"{count} builds ({noted - started:.0f} s to note them), {time.monotonic() - noted:.0f} s for "
        f"{' and '.join(target.name for target in TARGETS)}: {len(failures)} failed."
    )
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
