"""The memory that this process may have: the machine's, or less where a limit says so."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

_PROC = Path("/proc/self")


@dataclass(frozen=True)
class Bound:
    """What bounds memory: its bytes, and what it is, which follows "more than half of"."""

    size: int
    what: str


def memory_bound() -> Bound:
    """The tightest bound on this process' memory."""
    import psutil

    machine = Bound(psutil.virtual_memory().total, "this machine's memory")
    bounds = [machine, Bound(group_limit() or machine.size, "the memory that its control group (cgroup) may have")]
    bounds.append(Bound(address_limit() or machine.size, "the memory that a limit (ulimit -v) allows"))
    return min(bounds, key=lambda bound: bound.size)  # of equal ones the first


def address_limit() -> int | None:
    """The bytes of addresses that this process may have (`ulimit -v`); None where there is no limit."""
    if sys.platform == "win32":
        return None
    import resource

    (limit, _) = resource.getrlimit(resource.RLIMIT_AS)
    return None if limit == resource.RLIM_INFINITY else limit


@cache
def group_limit(proc: Path = _PROC) -> int | None:
    """The bytes of memory that this process' control group may have, or one above it (cgroups(7)); None where there is
    no limit, or no group. proc: what the kernel says of the process."""
    limits = [number for file in _limit_files(proc) if (number := _number(file)) is not None]
    return min(limits, default=None)


def _limit_files(proc: Path) -> Iterator[Path]:
    """The files with the limits of the process' group for memory and of those above it; some may not be there."""
    try:
        mounts = [line.split() for line in (proc / "mountinfo").read_text(encoding="utf-8").splitlines()]
        groups = [line.split(":", 2) for line in (proc / "cgroup").read_text(encoding="utf-8").splitlines()]
    except (OSError, ValueError):
        return
    paths = {}
    for number, controllers, path in groups:
        if number == "0":
            paths["cgroup2"] = path
        elif "memory" in controllers.split(","):
            paths["cgroup"] = path
    for fields in mounts:
        root, place = fields[3:5]
        kind, _, options = fields[fields.index("-") + 1 :][:3]
        if kind not in paths or (kind == "cgroup" and "memory" not in options.split(",")):
            continue
        group = Path(paths[kind])
        below = group.relative_to(root) if group.is_relative_to(root) else Path()  # a container sees its own part only
        for folder in (below, *below.parents):
            yield Path(place) / folder / ("memory.max" if kind == "cgroup2" else "memory.limit_in_bytes")


def _number(file: Path) -> int | None:
    """The number in a file; None where it holds another word, as "max", or is not there."""
    try:
        return int(file.read_text(encoding="ascii"))
    except (OSError, ValueError):
        return None
