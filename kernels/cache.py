"""The platform's cache folder: compiled kernels, scenes, potentially visible sets, patches."""

import contextlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

import platformdirs

VERSION = "0.1.0"


class CacheError(RuntimeError):
    """The cache folder cannot be used; the message says what to do."""


def cache_folder(kind: str) -> Path:
    """The folder for one kind of cached thing, made if missing; safe to delete at any time, also during a run.

    `XDG_CACHE_HOME` moves it. Names carry the suite's version, so that no version reads another's files. Raises
    CacheError if it cannot be made.
    """
    folder = Path(platformdirs.user_cache_dir("shading-atlas-bench")) / VERSION / kind
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CacheError(
            f"The cache folder {folder} cannot be made ({error.strerror}): set XDG_CACHE_HOME to another one."
        ) from error
    return folder


def write_atomically(path: Path, write: Callable[[BinaryIO], None]) -> None:
    """Write a cached file through a temporary file and a rename, so that concurrent runs never read half of it.

    A file that cannot be written (a full disk, a cache deleted meanwhile) only means that it is made again next time.
    """
    with contextlib.suppress(OSError):
        handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".part")
        try:
            with os.fdopen(handle, "wb") as file:
                write(file)
            os.replace(temporary, path)
        except BaseException:
            Path(temporary).unlink(missing_ok=True)
            raise
