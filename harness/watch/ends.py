"""How a process ended, and ending it with the one that watches it."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterable
from typing import Any

from shading_atlas_bench.kernels.journal import VARIABLE

SWITCH = "BENCH_SUPERVISED"  # 0 switches watching off, for debuggers; watched processes find 1
TICK = 0.2  # seconds between looks at the journal
KILLED = 137  # exit code, as shells have it, of who was ended by SIGKILL
CRASHES = {
    getattr(signal, name)
    for name in ("SIGABRT", "SIGBUS", "SIGFPE", "SIGILL", "SIGSEGV", "SIGSYS", "SIGTRAP")
    if hasattr(signal, name)
}
WINDOWS_CRASH = 0xC0000000  # exit codes from here on are exceptions of Windows


def overdue_steps(state: dict[str, Any] | None) -> list[dict[str, Any]]:
    """Steps of a journal's state that should have ended by now."""
    now = time.monotonic()
    steps = state["steps"].values() if state else ()
    return [step for step in steps if step["deadline"] and now > step["deadline"]]


def ended_by(steps: Iterable[dict[str, Any]], status: str, reason: str = "") -> list[dict[str, Any]]:
    """What is to be noted of these steps, with status and reason; nothing of those of which nothing is.

    reason: what happened to them; else they are past their time.
    """
    return [
        step["ended"] | {"status": status, "reason": f"{_joined(step['what'], reason or step['late'])}."}
        for step in steps
        if step["ended"]
    ]


def sentence_of(step: dict[str, Any], reason: str = "") -> str:
    """The same of one step for people, with whose it was."""
    return f"{_joined(step['who'], step['what'], reason or step['late'])}."


def _joined(*parts: str) -> str:
    return ": ".join(filter(None, parts))


def crashed(code: int) -> bool:
    """Whether an exit code is that of a process which ended by a fault of its own."""
    return -code in CRASHES or code >= WINDOWS_CRASH


def cause_of(code: int) -> str:
    """The signal, by its name or number, or the number of Windows' exception, that ended a process with this code."""
    if code > 0:
        return hex(code)
    known = {one.value: one.name for one in signal.Signals}
    return known.get(-code, f"signal {-code}")  # real-time signals have no names


def end_with_supervisor() -> None:
    """End this process when the one that watches it has ended, however that happened."""
    if os.environ.get(SWITCH) != "1" or VARIABLE not in os.environ:
        return

    def wait() -> None:
        while os.read(0, 1 << 10):  # nothing is ever written to it
            pass
        os._exit(KILLED)

    threading.Thread(target=wait, daemon=True).start()
