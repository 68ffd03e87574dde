"""Names that may become parts of file names on every system, and texts that UTF-8 can hold and a terminal may show."""

from __future__ import annotations

import re
import unicodedata

LONGEST = 100  # bytes: systems take 255, and more is put behind it
ALLOWED = f"letters, digits, spaces, and . _ + - between them, up to {LONGEST} bytes in all"
_FITTING = re.compile(r"\w(?:[\w .+-]*[\w+-])?")  # Windows drops dots and spaces at the end
_UNSEEN = ("Cc", "Cf", "Cs", "Zl", "Zp")  # controls, formats, halves of letters, and Unicode's own line ends
_KEPT = "\n\t\u200c\u200d"  # the last two are letters' joiners, as in emoji and in scripts of India
_DEVICES = re.compile(r"(?:con|prn|aux|nul|com\d|lpt\d)(?:\..*)?", re.IGNORECASE)  # of Windows, in every folder


def fits_everywhere(name: object) -> bool:
    """Whether a file or folder may have this name on every system, with a few words behind it."""
    if type(name) is not str or not _FITTING.fullmatch(name) or _DEVICES.fullmatch(name):
        return False
    return len(name.encode()) <= LONGEST


def encodable(text: str) -> str:
    """The text with the halves of letters that UTF-8 does not have, as in names of files, written as escapes."""
    return text.encode("utf-8", errors="backslashreplace").decode("utf-8")


def visible(text: object) -> str:
    """The text with everything as an escape that is no letter to be seen: what steers a terminal, turns the direction
    of writing, or breaks a line without being a line's end. Line ends, tabs and what joins letters stay."""
    return "".join(_seen(letter) for letter in str(text))


def _seen(letter: str) -> str:
    if letter in _KEPT or unicodedata.category(letter) not in _UNSEEN:
        return letter
    return letter.encode("unicode_escape").decode("ascii")
