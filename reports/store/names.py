"""Names that may become parts of file names on every system, and texts that UTF-8 can hold."""

from __future__ import annotations

import hashlib
import re

LONGEST = 100  # bytes: systems take 255, and more is put behind it
ALLOWED = f"letters, digits, spaces, and . _ + - between them, up to {LONGEST} bytes in all"
_FITTING = re.compile(r"\w(?:[\w .+-]*[\w+-])?")  # Windows drops dots and spaces at the end
_DEVICES = re.compile(r"(?:con|prn|aux|nul|com\d|lpt\d)(?:\..*)?", re.IGNORECASE)  # of Windows, in every folder


def fits_everywhere(name: object) -> bool:
    """Whether a file or folder may have this name on every system, with a few words behind it."""
    if type(name) is not str or not _FITTING.fullmatch(name) or _DEVICES.fullmatch(name):
        return False
    return len(name.encode()) <= LONGEST


def folder_name(method: str, variant: str) -> str:
    """The folder of a method's pictures and of its dumped frames: its name and a hash of its parameters."""
    digest = hashlib.sha256(variant.encode()).hexdigest()[:8]
    return f"{re.sub(r'[^A-Za-z0-9._]+', '_', method)}-{digest}"


def encodable(text: str) -> str:
    """The text with the halves of letters that UTF-8 does not have, as in names of files, written as escapes."""
    return text.encode("utf-8", errors="backslashreplace").decode("utf-8")
