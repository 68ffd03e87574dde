"""Which program made a result: hashes of all sources that its work goes through.

Rows of two programs must not mix, so a run that goes on, a reused one and a sweep's cells compare these. Whole folders
count, also what hardly matters in them: a needless refusal costs a measurement, a missed one makes numbers wrong.
"""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Iterable
from functools import cache
from pathlib import Path

from shading_atlas_bench.packers.interface import Packer

ROOT = Path(__file__).parents[2].resolve()  # the package's folder, resolved last: those in it are links
SHARED = ("arithmetic", "kernels", "scenes", "reports/store", "packers", "harness")
SOURCES = (".py", ".cl", ".h")


@cache
def suite_digest() -> str:
    """A hash of the sources that all methods share: stages, scenes, measuring. An edit of one method is not in it."""
    files = [file for name in SHARED for file in _sources(ROOT / name)]
    return _digest(ROOT, (file for file in files if not any(file.is_relative_to(own) for own in _methods())))


def method_digest(packer: type[Packer]) -> str:
    """A hash of the sources of one method: its folder whole, kernels included.

    A packer that is a single file outside of a package is that file, and the OpenCL sources beside it.
    """
    file = Path(inspect.getfile(packer)).resolve()
    if (file.parent / "__init__.py").is_file():
        return _digest(file.parent, _sources(file.parent))
    beside = (other for other in file.parent.iterdir() if other.suffix in SOURCES and other.suffix != ".py")
    return _digest(file.parent, [file, *beside])


def _methods() -> list[Path]:
    """The folders of the suite's own methods."""
    return sorted(found.parent for found in (ROOT / "packers").glob("*/__init__.py"))


def _sources(folder: Path) -> list[Path]:
    return [file for file in folder.rglob("*") if file.suffix in SOURCES]


def _digest(root: Path, files: Iterable[Path]) -> str:
    digest = hashlib.sha256()
    for file in sorted(files):
        content = file.read_bytes()
        digest.update(f"{file.relative_to(root).as_posix()} {len(content)}\n".encode() + content)
    return digest.hexdigest()[:16]
