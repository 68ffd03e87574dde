"""Ending a packer that hangs: first by an exception, and where Python never gets control back, by a new process."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

GRACE = 5.0  # seconds between the exception and the new process


class PackTimeoutError(RuntimeError):
    """A packer took longer than `--timeout`."""


def _raise(_signal: int, _frame: object) -> None:
    raise PackTimeoutError


@contextmanager
def time_limit(seconds: float, give_up: Callable[[], None]) -> Iterator[None]:
    """Raise PackTimeoutError inside the block after `seconds`; if that cannot get through, call `give_up`.

    A hang inside a kernel never returns to Python, where exceptions are raised. GRACE seconds later `give_up` is called
    from another thread; it must not return. Off the main thread only that second limit works.
    """
    last_resort = threading.Timer(seconds + GRACE, give_up)
    last_resort.daemon = True
    main = threading.current_thread() is threading.main_thread()
    if main:
        before = signal.signal(signal.SIGALRM, _raise)
        signal.setitimer(signal.ITIMER_REAL, seconds)
    last_resort.start()
    try:
        yield
    finally:
        last_resort.cancel()
        if main:
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, before)


def restart(*extra: str) -> None:
    """Replace this process by the same command with `extra` arguments; finished frames are in the store."""
    sys.stderr.flush()
    os.execv(sys.executable, [sys.executable, "-m", "harness.cli", *sys.argv[1:], *extra])
