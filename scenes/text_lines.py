"""Text files, and their numbers, read by kinds of lines at once instead of one by one."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from shading_atlas_bench.scenes.files import shown
from shading_atlas_bench.scenes.model import Indices

_Number = TypeVar("_Number", np.float64, np.int64)

_BLANK = 32  # it and all bytes below it separate words
_MARKS = {b"\xff\xfe": "utf-16-le", b"\xfe\xff": "utf-16-be"}
_CONTROLS = bytes(range(_BLANK))
# Old Macs' line ends become ours, and all other control characters blanks.
_SEPARATORS = bytes.maketrans(_CONTROLS, bytes(ord("\n") if byte in b"\n\r" else _BLANK for byte in _CONTROLS))


class TextLines:
    """The lines of a text that hold any words; the text is as `file_text` gives it.

    starts, ends: int64 (L), the first byte of each line's first word, and the byte after the line.
    counts: int64 (L), words of each line.
    """

    def __init__(self, text: bytes) -> None:
        self.text = text + b"\n\n\n"
        self.bytes = np.frombuffer(self.text, np.uint8)
        words = np.flatnonzero(np.diff(self.bytes > _BLANK, prepend=False))[::2]  # where blank and filled alternate
        ends = np.flatnonzero(self.bytes == ord("\n"))
        before = np.searchsorted(words, ends)  # words up to each line's end
        counts = np.diff(before, prepend=0)
        kept = counts > 0
        self.starts, self.ends, self.counts = words[(before - counts)[kept]], ends[kept], counts[kept]

    def line(self, number: int) -> bytes:
        """One line from its first word on."""
        return self.text[self.starts[number] : self.ends[number]]

    def joined(self, lines: Indices, keyword: int = 0) -> bytes:
        """The text of some lines, int (n), rising, each without the first `keyword` bytes of its first word."""
        if not len(lines):
            return b""
        leads = np.diff(lines, prepend=lines[0] - 2) != 1  # of runs of neighbouring lines
        first = np.flatnonzero(leads)
        start, end = self.starts[lines[first]], self.ends[lines[np.append(first[1:], len(lines)) - 1]]
        text = b"\n".join([self.text[a:b] for a, b in zip(start.tolist(), end.tolist(), strict=True)])
        if not keyword:
            return text
        lengths = end - start + 1
        moved = np.cumsum(lengths) - lengths - start
        part = np.frombuffer(text, np.uint8).copy()
        places = self.starts[lines] + moved[np.cumsum(leads) - 1]
        for byte in range(keyword):
            part[places + byte] = _BLANK
        return part.tobytes()


def file_text(path: Path) -> bytes:
    """The bytes of a text file, whose lines end in \\n, without a byte order mark.

    Other control characters become spaces. UTF-16 becomes UTF-8; other encodings stay as they are: all of them hold
    ASCII.
    """
    data = path.read_bytes()
    encoding = _MARKS.get(data[:2])
    data = data[2:].decode(encoding, errors="replace").encode() if encoding else data.removeprefix(b"\xef\xbb\xbf")
    return data.replace(b"\r\n", b"\n").translate(_SEPARATORS)


def numbers(text: bytes, count: int, dtype: type[_Number]) -> NDArray[_Number]:
    """The `count` numbers of a text of nothing else, float64 or int64 (count); raises ValueError, naming the first word
    that is none."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)  # what NumPy before 2.4 says instead of raising
            values = np.fromstring(text, dtype, sep=" ") if text.strip() else np.zeros(0, dtype)
    except (ValueError, DeprecationWarning):
        raise ValueError(f"{_no_number(text, dtype)} is not a number") from None
    if len(values) != count:
        raise ValueError("it has more or fewer numbers than words")
    return values


def _no_number(text: bytes, dtype: type[np.float64] | type[np.int64]) -> str:
    for word in text.split():
        try:
            dtype(word)
        except ValueError:
            return shown(word[:40])
    return "a word"


def count_words(text: bytes) -> int:
    """How many words a text has, between blanks and line ends."""
    return len(np.flatnonzero(np.diff(np.frombuffer(text, np.uint8) > _BLANK, prepend=False))[::2])
