"""PoCL's cache of compiled kernels: damaged ones are thrown away before PoCL loads them.

PoCL takes what it finds: of an emptied program it makes one without kernels, a flipped byte of machine code it runs. So
every process that has compiled something leaves a seal, the size and CRC-32 of each file, and every process that
starts compares. One folder holds one program, in all its forms.
"""

from __future__ import annotations

import json
import os
import shutil
import tempfile
import zlib
from pathlib import Path

import psutil

from shading_atlas_bench.kernels.cache import write_atomically

SEAL = "seal.json"
SEALED = (".bc", ".so")  # PoCL rewrites the others: logs and times of access
ROOM = 1 << 20  # bytes; what is compiled of a kernel has a tenth of that
CLOCK = 0.02  # seconds that a file's time may lag behind the clock
Seals = dict[str, tuple[int, int]]


def heal(folder: Path) -> int:
    """Delete every program that is not as it was sealed, and all where the seal itself is damaged; how many it knew.

    A file without a seal is of a process that was killed, or of one that is still running: it stays unless it is empty,
    or the system started after it was written, which may have been in the middle of it.
    """
    seals = _read(folder)
    if seals is None:
        discard(folder)
        return 0
    damaged = {
        "/".join(name.split("/")[:2])
        for name in _files(folder)
        if (seals[name] != _measure(folder, name) if name in seals else not _may_be_whole(folder / name))
    }
    for program in damaged:
        shutil.rmtree(folder / program, ignore_errors=True)
    if damaged:
        seal(folder)  # which forgets theirs
    return len(damaged)


def seal(folder: Path) -> None:
    """Seal every file that has no seal yet, and forget the seals of those that are gone."""
    seals, found = _read(folder) or {}, _files(folder)
    new = {name: measured for name in found if name not in seals and (measured := _measure(folder, name))}
    kept = {name: seals[name] for name in found if name in seals}
    if new or kept != seals:
        text = json.dumps({"crc": zlib.crc32(_text(kept | new)), "files": kept | new})
        write_atomically(folder / SEAL, lambda out: out.write(text.encode()))


def discard(folder: Path) -> None:
    """Delete all compiled kernels; PoCL compiles them again."""
    for entry in folder.iterdir() if folder.is_dir() else ():
        if entry.is_dir():
            shutil.rmtree(entry, ignore_errors=True)
        else:
            entry.unlink(missing_ok=True)


def refuses(folder: Path) -> str | None:
    """Why nothing can be compiled into this folder; None where there is room for a kernel."""
    try:
        with tempfile.NamedTemporaryFile(dir=folder) as file:
            file.write(bytes(ROOM))
            file.flush()
    except OSError as error:
        return error.strerror
    return None


def holds(folder: Path, kernel: str, since: float) -> bool:
    """Whether machine code of a kernel of this name was written after `since` (of time.time): others may share it."""
    return any(file.stat().st_mtime >= since - CLOCK for file in folder.glob(f"*/*/{kernel}/*/{kernel}.so"))


def _files(folder: Path) -> list[str]:
    """Sealed files, and folders in their place: PROGRAM/..., where a program is a folder in a folder."""
    found, start = [], len(os.path.join(folder, ""))  # strings: a Path for each would take longer than its checksum
    for place, folders, files in os.walk(folder):
        within = place[start:].replace(os.sep, "/")
        if "/" in within:
            found += [f"{within}/{name}" for name in (*folders, *files) if name.endswith(SEALED)]
    return found


def _measure(folder: Path, name: str) -> tuple[int, int] | None:
    try:
        with open(f"{folder}/{name}", "rb") as file:
            content = file.read()
    except OSError:
        return None
    return len(content), zlib.crc32(content)


def _may_be_whole(file: Path) -> bool:
    try:
        stat = file.stat()
    except OSError:
        return False
    return file.is_file() and stat.st_size > 0 and stat.st_mtime >= psutil.boot_time()


def _read(folder: Path) -> Seals | None:
    """The seals, none where there is no such file yet; None where it is damaged itself."""
    try:
        record = json.loads((folder / SEAL).read_bytes())
        files = {str(name): (int(size), int(crc)) for name, (size, crc) in record["files"].items()}
        return files if record["crc"] == zlib.crc32(_text(files)) else None
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def _text(files: Seals) -> bytes:
    return json.dumps({name: list(value) for name, value in files.items()}, sort_keys=True).encode()
