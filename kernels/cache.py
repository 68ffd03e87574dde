"""The platform's cache folder: compiled kernels, scenes, potentially visible sets, patches."""

import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

import platformdirs

VERSION = "0.1.0"


def cache_folder(kind: str) -> Path:
    """The folder for one kind of cached thing, made if missing; safe to delete at any time.

    `XDG_CACHE_HOME` moves it. Names carry the suite's version, so that no version reads another's files.
    """
    folder = Path(platformdirs.user_cache_dir("shading-atlas-bench")) / VERSION / kind
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def write_atomically(path: Path, write: Callable[[BinaryIO], None]) -> None:
    """Write `path` through a temporary file and a rename, so that concurrent runs never read half a file."""
    handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".part")
    try:
        with os.fdopen(handle, "wb") as file:
            write(file)
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
