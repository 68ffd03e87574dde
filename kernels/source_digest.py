"""A hash of source files: what was made by other sources is not taken for what these would make."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable
from pathlib import Path


def source_digest(root: Path, files: Iterable[Path]) -> str:
    """16 hexadecimal digits over the files' paths below `root` and their contents; the order given does not count.

    Raises ValueError for a file that is not below `root`, OSError for one that cannot be read.
    """
    digest = hashlib.sha256()
    for file in sorted(files):
        with open(file, "rb") as content:
            own = hashlib.file_digest(content, "sha256").hexdigest()
        digest.update(os.fsencode(file.relative_to(root).as_posix()) + f" {own}\n".encode())
    return digest.hexdigest()[:16]
