"""PoCL's library of built-ins (vload16, sqrt, convert_float8 and all the others) against PoCL's compiler.

The PoCL of PyPI chooses the processor it compiles for by its name, and the library by the processor's features. On
processors newer than its LLVM the two disagree: a library with 512-bit registers is linked to code without them, whose
values of 512 bits are passed in another way, and the compiler aborts. So the compiler is asked, in a process of its
own, and the answer remembered per driver and processor; where the library does not suit it, a folder of links that
mirrors the package shows the driver one that does under the name it looks for.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from shading_atlas_bench.kernels.cache import cache_folder, read_checked, write_checked

# What a library's code needs of the processor, as the compiler's macros name it; the widest first.
NEEDS = {
    "avx512": frozenset({"AVX512F", "AVX512BW", "AVX512CD", "AVX512DQ", "AVX512VL", "AVX2", "FMA"}),
    "avx2": frozenset({"AVX2", "FMA"}),
    "avx_fma4": frozenset({"AVX", "FMA4"}),
    "avx_f16c": frozenset({"AVX", "F16C"}),
    "avx": frozenset({"AVX"}),
    "sse41": frozenset({"SSE4_1"}),
    "ssse3": frozenset({"SSSE3"}),
    "sse2": frozenset({"SSE2"}),
}
MACROS = sorted(frozenset[str]().union(*NEEDS.values(), {"CLWB"}))
LINKED = re.compile(r"Using \S*/kernel-\S*-(\w+)\.bc as the built-in lib")
PROBE = Path(__file__).with_name("probe.py")
PATIENCE = 120.0  # seconds for one question; it takes one or two


@dataclass(frozen=True)
class Package:
    """The PoCL that came with pip: the folders of its libraries, as pyopencl and its companion package have them."""

    libraries: Path
    companions: Path

    @property
    def driver(self) -> Path:
        """The driver itself."""
        return next(self.libraries.glob("libpocl*.so*"))

    @property
    def builtins(self) -> dict[str, Path]:
        """The libraries of built-ins by what they need."""
        found = sorted((self.companions / "share" / "pocl").glob("kernel-*.bc"))
        return {file.stem.rsplit("-", 1)[1]: file for file in found}

    def digest(self) -> str:
        """A hash of the driver's files, as far as the file system knows them, and of the processor."""
        files = sorted([*self.libraries.iterdir(), *self.companions.rglob("*")])
        stats = [(file, file.stat()) for file in files if file.is_file()]
        facts = [(str(file), stat.st_size, stat.st_mtime_ns) for file, stat in stats]
        return hashlib.sha256(json.dumps([facts, processor()]).encode()).hexdigest()[:16]


@dataclass(frozen=True)
class Answer:
    """What the driver says: its version, the macros its compiler defines, the library of built-ins it takes."""

    driver: str
    macros: frozenset[str]
    library: str


def installed_package() -> Package | None:
    """The PoCL of PyPI in this environment; None where there is none."""
    libraries, companions = (_libraries_of(name) for name in ("pyopencl", "pocl_binary_distribution"))
    if libraries is None or companions is None:
        return None
    if not any(libraries.glob("libpocl*.so*")) or not companions.is_dir():
        return None
    return Package(libraries, companions)


def _libraries_of(name: str) -> Path | None:
    """Where a Python package has its libraries; None where it is not installed."""
    spec = find_spec(name)
    if spec is None or not spec.submodule_search_locations:
        return None
    return Path(spec.submodule_search_locations[0]) / ".libs"


def processor() -> str:
    """Name and features of the processor, as the system has them."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    wanted = ("model name", "cpu family", "model\t", "stepping", "flags", "Features")
    return "\n".join(dict.fromkeys(line for line in lines if line.startswith(wanted)))


def ask(home: Path) -> Answer | None:
    """Ask the PoCL of a home folder; None where it cannot answer (it aborts, hangs, or speaks otherwise)."""
    with tempfile.TemporaryDirectory() as kernels, tempfile.TemporaryDirectory() as nowhere:
        environment = os.environ | {
            "POCL_CACHE_DIR": kernels,
            "POCL_DEBUG": "llvm",
            "OCL_ICD_VENDORS": nowhere,  # an empty folder: only the PoCL of `home` is to answer
        }
        command = [sys.executable, "-P", str(PROBE), str(home), *MACROS]
        try:
            said = subprocess.run(
                command, env=environment, capture_output=True, text=True, timeout=PATIENCE, check=True, errors="replace"
            )
            found = json.loads(said.stdout)
        except (OSError, ValueError, subprocess.SubprocessError):
            return None
    linked = LINKED.search(said.stderr)
    return Answer(found["driver"], frozenset(found["macros"]), linked[1]) if linked else None


def remembered_answer(package: Package, home: Path) -> Answer | None:
    """As `ask`, from memory where this driver was asked on this processor before."""
    file = cache_folder("opencl") / f"answer-{package.digest()}.json"
    if content := read_checked(file):
        known = json.loads(content)
        return Answer(known["driver"], frozenset(known["macros"]), known["library"])
    answer = ask(home)
    if answer:
        write_checked(file, json.dumps(vars(answer) | {"macros": sorted(answer.macros)}).encode())
    return answer


def fitting(answer: Answer, available: Iterable[str]) -> str:
    """The library that suits the compiler: its own choice where it can, else the widest it has the registers for.

    A narrower one would not do: wide values are then passed in another way, too. Its own choice also where none suits:
    then nothing is known that would be better.
    """
    if NEEDS.get(answer.library, frozenset()) <= answer.macros:
        return answer.library
    known = set(available)
    suits = [name for name, needs in NEEDS.items() if name in known and needs <= answer.macros]
    return suits[0] if suits else answer.library
