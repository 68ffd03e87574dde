"""Names that may become parts of file names on every system."""

from __future__ import annotations

import re

ALLOWED = "letters, digits, spaces, and . _ + - between them"
_FITTING = re.compile(r"\w(?:[\w .+-]*[\w+-])?")  # Windows drops dots and spaces at the end
_DEVICES = re.compile(r"(?:con|prn|aux|nul|com\d|lpt\d)(?:\..*)?", re.IGNORECASE)  # of Windows, in every folder


def fits_everywhere(name: str) -> bool:
    """Whether a file or folder may have this name on every system."""
    return bool(_FITTING.fullmatch(name)) and not _DEVICES.fullmatch(name)
