"""What this process is at, in a file for whoever watches it: one that aborts or hangs cannot say so itself.

BENCH_JOURNAL names the file. Nothing is written where it is not set, as in tests and in programs of others.
"""

from __future__ import annotations

import itertools
import json
import os
import time
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from threading import Lock
from typing import Any

VARIABLE = "BENCH_JOURNAL"
HEADER = 18  # length in ten digits, CRC-32 in eight hexadecimal ones


class Journal:
    """The state of a process as a JSON object that another one may read at any time.

    device: what is known of the device in use. again: arguments with which the same command goes on. steps: what is
    being done, each with `what`, `who` does it (or nothing), `deadline` (of time.monotonic, or null), what is said once
    that is past (`late`), and `ended` (what is to be noted of it should the process end here, or null). building: what
    a compiler is at, each with `what`, the `kernel`'s name, if it is that of one, and `since` when (of time.time).
    """

    def __init__(self, file: Path | None) -> None:
        self._handle = os.open(file, os.O_RDWR | os.O_CREAT) if file else None
        self._state: dict[str, Any] = {"device": None, "again": None, "steps": {}, "building": {}}
        self._numbers = itertools.count()
        self._lock = Lock()

    def note(self, **facts: object) -> None:
        """Set `device` or `again`."""
        with self._lock:
            self._state |= facts
            self._write()

    @contextmanager
    def step(
        self,
        what: str,
        seconds: float | None = None,
        ended: dict[str, Any] | None = None,
        *,
        who: str = "",
        late: str = "",
    ) -> Iterator[None]:
        """A step that may take `seconds`."""
        deadline = None if seconds is None else time.monotonic() + seconds
        late = late or f"it did not end within {seconds or 0:g} s"
        with self._entry("steps", {"what": what, "who": who, "deadline": deadline, "late": late, "ended": ended}):
            yield

    @contextmanager
    def building(self, what: str, kernel: str | None = None) -> Iterator[None]:
        """A source is compiled, or a kernel of it launched for the first time, which is when PoCL compiles it."""
        with self._entry("building", {"what": what, "kernel": kernel, "since": time.time()}):
            yield

    @contextmanager
    def _entry(self, kind: str, value: object) -> Iterator[None]:
        if self._handle is None:
            yield
            return
        number = str(next(self._numbers))
        with self._lock:
            self._state[kind][number] = value
            self._write()
        try:
            yield
        finally:
            with self._lock:
                del self._state[kind][number]
                self._write()

    def _write(self) -> None:
        if self._handle is not None:
            text = json.dumps(self._state).encode()
            os.lseek(self._handle, 0, os.SEEK_SET)
            os.write(self._handle, f"{len(text):010d}{zlib.crc32(text):08x}".encode() + text)


def read_journal(file: Path) -> dict[str, Any] | None:
    """The state that a process wrote last; None where there is none, or it is just being written."""
    try:
        content = file.read_bytes()
        text = content[HEADER : HEADER + int(content[:10])]
        return json.loads(text) if zlib.crc32(text) == int(content[10:HEADER], 16) else None
    except (OSError, ValueError):
        return None


@cache
def journal() -> Journal:
    """This process' journal."""
    file = os.environ.get(VARIABLE)
    return Journal(Path(file) if file else None)
