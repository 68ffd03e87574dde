"""Ending what hangs: first by an exception, and where Python never gets control back, from outside."""

from __future__ import annotations

import ctypes
import json
import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from shading_atlas_bench.harness.errors import InputError, is_stop
from shading_atlas_bench.kernels.journal import journal

GRACE = 5.0  # seconds between the exception and the end of the process
ENDED = "BENCH_ENDED"  # variable: the file with what the supervisor tells the process that goes on, a JSON list


class PackTimeoutError(RuntimeError):
    """A packer took longer than it may; the message says what the limit was."""


def longer_than(timeout: float) -> str:
    """What is said of somebody who took longer than the option of so many seconds allows."""
    return f"it took longer than --timeout {timeout:g} allows"


@contextmanager
def time_limit(
    seconds: float, what: str, ended: dict[str, Any] | None = None, *, who: str = "", late: str = ""
) -> Iterator[None]:
    """Raise PackTimeoutError inside the block after `seconds`, in whatever thread it runs.

    A hang inside a kernel never returns to Python, where exceptions are raised: GRACE seconds later the supervisor ends
    the process. The one that goes on finds `ended` in `ended_steps`, with its status and reason.
    who: whose work it is. late: what is said of it then; without one, how many seconds it may take.
    """
    late = late or f"it took longer than {seconds:g} s"
    alarm = _Alarm(threading.get_ident(), _error_saying(f"{late}."))
    timer = threading.Timer(seconds, alarm.ring)
    timer.daemon = True
    with journal().step(what, seconds + GRACE, ended, who=who, late=late):
        timer.start()
        try:
            alarm.switch_on()  # only now: raised inside `start`, it would break the threads' own book-keeping
            yield
        finally:
            timer.cancel()
            alarm.switch_off()


@contextmanager
def answer_within(seconds: float, who: str, doing: str) -> Iterator[None]:
    """A time limit for what packers do before anything could be noted of them: it ends the command.

    who, doing: of the sentence, like a packer's name and "making it". Raises InputError, also where the code that hangs
    makes another error of the one that ends it.
    """
    start = time.monotonic()
    try:
        with time_limit(seconds, doing, who=who):
            yield
    except BaseException as error:
        if is_stop(error) or time.monotonic() - start < seconds:
            raise
        raise InputError(f"{who} cannot be used: {doing} took longer than {seconds:g} s.") from error


def _error_saying(sentence: str) -> type[PackTimeoutError]:
    """An error with this message: what is raised in another thread is a class, and made there without arguments."""

    class _SaidError(PackTimeoutError):
        def __init__(self) -> None:
            super().__init__(sentence)

    return _SaidError


class _Alarm:
    """Raises PackTimeoutError in a thread while it is on; one that rang before raises when it is switched on."""

    def __init__(self, thread: int, error: type[PackTimeoutError] = PackTimeoutError) -> None:
        self._thread, self._lock, self._on, self._rang = ctypes.c_ulong(thread), threading.Lock(), False, False
        self._error = error

    def ring(self) -> None:
        with self._lock:
            self._rang = True
            if self._on:
                ctypes.pythonapi.PyThreadState_SetAsyncExc(self._thread, ctypes.py_object(self._error))

    def switch_on(self) -> None:
        with self._lock:
            self._on = True
            rang = self._rang
        if rang:
            raise self._error

    def switch_off(self) -> None:
        """No exception comes any more, not even one that was set and is not raised yet."""
        with self._lock:
            self._on = False
            if self._rang:  # else the interpreter would look for it at every step, and hang under a profiler
                ctypes.pythonapi.PyThreadState_SetAsyncExc(self._thread, None)


def ended_steps(**facts: object) -> list[dict[str, Any]]:
    """Steps with these facts in which earlier processes of this command ended: with `status` and `reason`."""
    file = os.environ.get(ENDED)
    known = json.loads(Path(file).read_text(encoding="utf-8")) if file else []
    return [step for step in known if all(step.get(name) == value for name, value in facts.items())]
