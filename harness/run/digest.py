"""Which program made a result: hashes of all files that its work goes through.

Rows of two programs must not mix, so a run that goes on, a reused one and a sweep's cells compare these. Whole folders
count, also what hardly matters in them: a needless refusal costs a measurement, a missed one makes numbers wrong.
"""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from shading_atlas_bench.harness.plugins import own_classes, source_file
from shading_atlas_bench.kernels.device import METHOD_KERNELS
from shading_atlas_bench.kernels.source_digest import source_digest
from shading_atlas_bench.packers.interface import Packer

SUITE = __name__.partition(".")[0]
ROOT = Path(__file__).parents[2].resolve()  # the package's folder, resolved last: those in it are links
SHARED = ("arithmetic", "kernels", "scenes", "reports/store", "packers", "harness")
SOURCES = (".py", ".cl", ".clh", ".h", ".hpp", ".inc")  # beside a packer that is a single file


@cache
def suite_digest() -> str:
    """A hash of the files that all methods share: stages, scenes, measuring. An edit of one method is not in it."""
    methods = _methods()
    files = [file for name in SHARED for file in _below(ROOT / name)]
    shared = (file for file in files if not any(file.is_relative_to(own) for own in methods))
    return source_digest(ROOT, shared)


def method_digest(packer: type[Packer]) -> str:
    """A hash of the files of one method: of its class, and of every class below Packer that it is derived from.

    A class in a package counts with the folder of its top package, whole but for __pycache__, *.md and hidden files;
    one of the suite with its method's folder. A class in a single file counts with the sources in the same folder
    (SOURCES) and with all that is in the folder `kernels` there, but with no other folder: it may lie in anybody's
    home. What else a method imports from other packages does not count.

    Raises ValueError for a class that does not lie in a file.
    """
    parts = dict.fromkeys(part for kind in own_classes(packer) for part in _parts(kind))
    return hashlib.sha256(" ".join(source_digest(*part) for part in parts).encode()).hexdigest()[:16]


def _parts(kind: type) -> Iterator[tuple[Path, tuple[Path, ...]]]:
    """The folders that a class lies in, each with the files in it that count."""
    top, *inner = kind.__module__.split(".")
    if top == SUITE:
        own = ROOT.joinpath(*inner[:2])
        packages = [own] if own in _methods() else []  # what is shared is in the suite's digest
    else:
        packages = sorted(map(Path, getattr(sys.modules.get(top), "__path__", [])))  # several of a namespace
        file = source_file(kind)
        if not packages and (file.parent / "__init__.py").is_file():  # named by its path
            packages = [_top(file.parent)]
        if not packages:
            for one in dict.fromkeys((file, file.resolve())):  # kernels may be looked for at either end of a link
                yield one.parent, _beside(one)
    for folder in packages:
        yield folder, tuple(sorted(_below(folder)))


def _top(package: Path) -> Path:
    return _top(package.parent) if (package.parent / "__init__.py").is_file() else package


def _beside(file: Path) -> tuple[Path, ...]:
    """A single file, and what counts beside it."""
    sources = (one for one in file.parent.iterdir() if one.suffix in SOURCES and _counts(one.name) and one.is_file())
    return tuple(sorted({file, *sources, *_below(file.parent / METHOD_KERNELS)}))


def _methods() -> list[Path]:
    """The folders of the suite's own methods."""
    return sorted(found.parent for found in (ROOT / "packers").glob("*/__init__.py"))


def _below(folder: Path) -> Iterator[Path]:
    """All files below a folder that count; through links to other folders, each folder once."""
    seen = set()
    for place, folders, names in os.walk(folder, followlinks=True):
        real = os.path.realpath(place)
        folders[:] = () if real in seen else sorted(filter(_counts, folders))
        if real not in seen:
            seen.add(real)
            files = (Path(place, name) for name in names if _counts(name))
            yield from (file for file in files if file.is_file())  # a link may lead nowhere


def _counts(name: str) -> bool:
    return not (name.startswith(".") or name == "__pycache__" or name.endswith(".md"))
