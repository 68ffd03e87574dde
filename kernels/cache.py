"""The platform's cache folder: compiled kernels, scenes, shadow and environment maps, walks, visible sets, patches, the
pace of runs.

What is cached may be damaged at any time: a full disk, a power cut, another program. Files are therefore sealed with a
checksum, and what does not hold is as good as missing: its reader makes it again and writes it anew. A warning says so,
once per folder and process.
"""

import contextlib
import os
import shutil
import struct
import tempfile
import time
import warnings
import zlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import BinaryIO

import platformdirs

from shading_atlas_bench.errors import BenchError

VERSION = "0.1.0"
LONGEST_WRITE = 3600.0  # seconds
# At the end of a file: the number of bytes before it, and their CRC-32, begun with the file's name. Of the checksums in
# the standard library it is the fastest (2 to 3 GB/s), and it sees every change of up to 32 bits in a row for certain.
_SEAL = struct.Struct("<QI")


class CacheError(BenchError, RuntimeError):
    """The cache folder cannot be used; the message says what to do."""


def cache_root() -> Path:
    """The folder of all cached things, made when something is written; safe to delete at any time, also during a run.

    `XDG_CACHE_HOME` moves it. Its name carries the suite's version, so that no version reads another's files.
    """
    return Path(platformdirs.user_cache_dir("shading-atlas-bench")) / VERSION


def cache_folder(kind: str) -> Path:
    """A folder below `cache_root`, made if missing, for those who cannot do without. Raises CacheError."""
    folder = cache_root() / kind
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CacheError(
            f"The cache folder {folder} cannot be made ({error.strerror}): set XDG_CACHE_HOME to another one."
        ) from error
    return folder


def write_atomically(path: Path, write: Callable[[BinaryIO], object]) -> None:
    """Write a cached file through a temporary file and a rename, so that concurrent runs never read half of it.

    It replaces what is there. Where it cannot be written (a full disk, a folder without permission) a warning says so,
    and it is only made again next time.
    """
    _delete_parts()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".part")
        try:
            with os.fdopen(handle, "wb") as file:
                write(file)
            if path.is_dir():  # a file cannot replace a folder; nothing of a concurrent run's is one
                shutil.rmtree(path, ignore_errors=True)
            os.replace(temporary, path)
        except BaseException:
            Path(temporary).unlink(missing_ok=True)
            raise
    except OSError as error:
        _warn_once(f"The cache in {path.parent} cannot be written ({error.strerror}): what it lacks is made each time.")


@cache
def _delete_parts() -> None:
    """Delete, once per process, what killed ones left half-written: nobody writes a file for so long."""
    for part in cache_root().glob("*/*.part"):
        with contextlib.suppress(OSError):
            if time.time() - part.stat().st_mtime > LONGEST_WRITE:
                part.unlink()


def write_checked(path: Path, content: bytes) -> None:
    """`write_atomically` of what `read_checked` then reads."""
    write_atomically(path, lambda file: file.writelines([content, _seal(path, content)]))


def read_checked(path: Path) -> bytes | None:
    """What `write_checked` wrote there; None where it is missing, unreadable or damaged: then make it again."""
    if not os.path.lexists(path):
        return None
    try:
        if path.is_file():  # other things might block
            with path.open("rb") as file:  # in two parts: a copy of large contents would cost as much as reading them
                content = file.read(max(0, os.fstat(file.fileno()).st_size - _SEAL.size))
                if file.read() == _seal(path, content):
                    return content
    except FileNotFoundError:  # the cache was deleted just now
        return None
    except OSError:
        pass
    _warn_once(f"A cached file in {path.parent} was damaged: it is made again.")
    return None


@cache  # the filters of `warnings` forget what was said whenever somebody changes them
def _warn_once(sentence: str) -> None:
    warnings.warn(sentence, stacklevel=2)


def _seal(path: Path, content: bytes) -> bytes:
    """Of the content and of what it is: that of another file, or of one of another kind, is not taken for it."""
    return _SEAL.pack(len(content), zlib.crc32(content, zlib.crc32(f"{path.parent.name}/{path.name}".encode())))
