"""The entry point of `bench`: commands that use a device run in a process of their own, and this one watches it.

Compilers of drivers abort, kernels hang, packers crash; a process cannot survive any of that, but the one beside it
can. The watched process says in a journal what it is at. If it dies compiling, the kernel cache is thrown away and it
starts once more; if it dies again, the device is passed over from then on. If it dies or hangs in a step of a method,
it goes on without that method. Finished frames are in the store, so that whoever goes on knows what is left.
"""

from __future__ import annotations

import itertools
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from shading_atlas_bench.errors import visible
from shading_atlas_bench.harness.watch.ends import (
    KILLED,
    SWITCH,
    TICK,
    cause_of,
    crashed,
    ended_by,
    overdue_steps,
    sentence_of,
)
from shading_atlas_bench.harness.watch.memory import too_little
from shading_atlas_bench.harness.watch.processes import python
from shading_atlas_bench.kernels.journal import VARIABLE, read_journal

# `bench tables` runs these as processes of their own, each of which is watched.
WATCHED = ("run", "sweep", "claims", "check", "stress", "kernels", "doctor", "list")
COMMAND_LINE = "shading_atlas_bench.harness.cli.main"
HARMLESS = {"--help", "--list"}
ENDED, SERIAL = "BENCH_ENDED", "BENCH_SERIAL"  # variables for the process that goes on
# A terminal sends Ctrl-C to all processes. Those that are watched, and their compilers' own, never hear of it where it
# can be kept from them: as TERM, which ends them without a traceback, this one passes it on. Elsewhere, seconds later.
KEPT = frozenset({signal.SIGINT})
PATIENCE: dict[int, float] = {signal.SIGINT: 0.0 if hasattr(signal, "pthread_sigmask") else 1.0, signal.SIGTERM: 0.0}
LONGEST = 4.0  # seconds that a process has to end then: what is finished is in the store
FAILED, UNUSABLE, INTERRUPTED = 1, 2, 130
MOST_DEATHS = 2  # of one device's compiler
ILLEGAL = {getattr(signal, "SIGILL", 4)}  # instructions that the processor lacks: always the compiler's fault


def main() -> None:
    """Run the command line, watched where it uses a device."""
    arguments = sys.argv[1:]
    if not arguments or arguments[0] not in WATCHED or HARMLESS & set(arguments) or os.environ.get(SWITCH):
        from shading_atlas_bench.harness.cli.main import main as run_here

        run_here()
        return
    if short := too_little():
        _say(short)
        sys.exit(UNUSABLE)
    sys.exit(Supervisor(arguments).run())


class Supervisor:
    """One command, started until it ends by itself."""

    def __init__(self, arguments: list[str]) -> None:
        self.arguments = arguments
        self.again: list[str] = []  # arguments with which the command goes on
        self.ended: list[dict[str, Any]] = []
        self.serial = False
        self.deaths: Counter[str] = Counter()  # of each device's compiler
        self.stopped: tuple[int, float] | None = None  # by which signal, and when

    def run(self) -> int:
        """The exit code of the command."""
        signal.signal(signal.SIGINT, self._stop)
        signal.signal(signal.SIGTERM, self._stop)
        with tempfile.TemporaryDirectory(prefix="bench-") as folder:
            for number in itertools.count():
                journal = Path(folder) / f"journal-{number}"
                code, overdue = self._once(journal)
                state = read_journal(journal) or {"device": None, "again": None, "steps": {}, "building": {}}
                self.again = state["again"] or self.again
                exit_code = self._judge(code, overdue, state)
                if exit_code is not None:
                    return exit_code
        raise AssertionError("the numbers do not end")

    def _stop(self, number: int, _frame: object) -> None:
        self.stopped = self.stopped or (number, time.monotonic())

    def _once(self, journal: Path) -> tuple[int, list[dict[str, Any]]]:
        """Start the command and wait for it: its exit code, and the steps it was killed for because they hang."""
        ended = journal.with_name("ended")
        ended.write_text(json.dumps(self.ended), encoding="utf-8")
        environment = os.environ | {VARIABLE: str(journal), SWITCH: "1", ENDED: str(ended)}
        if self.serial:
            environment[SERIAL] = "1"
        command = python("-m", COMMAND_LINE, *self.arguments, *self.again)
        # The other end of its standard input closes with this process, however that ends; then it ends too.
        with _kept_back():
            child = subprocess.Popen(command, stdin=subprocess.PIPE, env=environment)
        waiting = threading.Thread(target=child.wait, daemon=True)  # `wait` with a timeout sleeps beyond the end
        waiting.start()
        told: float | None = None
        while True:
            waiting.join(TICK)
            if not waiting.is_alive():
                return child.returncode, []
            if self.stopped and not told and time.monotonic() > self.stopped[1] + PATIENCE[self.stopped[0]]:
                told = time.monotonic()
                child.terminate()
            if told and time.monotonic() > told + LONGEST:
                child.kill()
            if overdue := overdue_steps(read_journal(journal)):
                child.kill()
                waiting.join()
                return child.returncode, overdue

    def _judge(self, code: int, overdue: list[dict[str, Any]], state: dict[str, Any]) -> int | None:
        """What the end of a process means: the exit code of the command, or None to start it again."""
        if self.stopped:
            if code < 0:
                kept = " Finished results are kept: the same command goes on from there." if self.again else ""
                _say(f"Stopped.{kept}")
            return code if code >= 0 else INTERRUPTED
        building, device = list(state["building"].values()), state["device"]
        steps = list(state["steps"].values())
        if (overdue or crashed(code) or code >= 0) and sum(map(_has_owner, steps)) > 1 and not self.serial:
            self.serial = True  # whose fault it was shows when they run one after the other
            return None
        if overdue:
            return self._blame(overdue, "timeout")
        if building and device and (crashed(code) or code > 0):
            # The second time a kernel dies running, where only a method's step can have given it what it died of.
            methods_fault = (
                self.deaths[device["key"]]
                and any(map(_has_owner, steps))
                and -code not in ILLEGAL
                and _compiled(building[0])
            )
            if not methods_fault:
                return self._compiler_died(building[0]["what"], device)
        elif not crashed(code) and (code < 0 or not steps):
            return _passed_on(code)
        how = f"crashed ({cause_of(code)})" if crashed(code) else f"was ended with exit code {code}"
        return self._blame(steps, "failed", f"the process {how}")

    def _blame(self, steps: list[dict[str, Any]], status: str, reason: str = "") -> int | None:
        """End these steps and go on without them, or end the command where nothing is known that could go on."""
        ended = ended_by(steps, status, reason) if self.again else []
        if not ended:
            kept = " Finished results are kept: the same command goes on from there." if self.again else ""
            _say((" ".join(sentence_of(step, reason) for step in steps) or f"starting: {reason}.") + kept)
            return FAILED
        for step in filter(_has_owner, steps):
            _say(f"{sentence_of(step, reason)} Going on without it.")
        self.ended += ended
        return None

    def _compiler_died(self, what: str, device: dict[str, Any]) -> int | None:
        """A device's compiler died: heal its cache the first time, then pass the device over."""
        from shading_atlas_bench.kernels.runtime import kernel_cache
        from shading_atlas_bench.kernels.runtime.opencl import note_death, pocl_cache

        sentence = f"{device['name']} died while it built {what}."
        if refused := kernel_cache.refuses(pocl_cache()):
            hint = "make room, or set XDG_CACHE_HOME to another folder"
            _say(f"{sentence} Its kernel cache {pocl_cache()} cannot be written ({refused}): {hint}.")
            return FAILED
        self.deaths[device["key"]] += 1
        kernel_cache.discard(pocl_cache())
        if self.deaths[device["key"]] == 1:
            _say(f"{sentence} Its kernel cache is thrown away, and it starts once more.")
            return None
        note_death(device["key"], device["kernels"], f"{sentence} `bench doctor` tries it again.")
        self.ended.append({"device": device["key"], "status": "failed", "reason": sentence})
        if device["asked"]:
            _say(f"{sentence} Without --device and BENCH_DEVICE the next one is used.")
            return FAILED
        if self.deaths[device["key"]] > MOST_DEATHS:
            _say(f"{sentence} That cannot be remembered: make the cache folder writable.")
            return FAILED
        _say(f"{sentence} It is passed over from now on.")
        return None


@contextmanager
def _kept_back() -> Iterator[None]:
    """What is started in the block, and whatever that starts, does not get Ctrl-C; this process gets it afterwards."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, KEPT)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _has_owner(step: dict[str, Any]) -> bool:
    """Whether somebody is named whom it can be noted of, should the process end in this step."""
    return step["ended"] is not None


def _compiled(building: dict[str, Any]) -> bool:
    """Whether the compilation of what a process was building ended, so that it died running."""
    from shading_atlas_bench.kernels.runtime import kernel_cache
    from shading_atlas_bench.kernels.runtime.opencl import pocl_cache

    kernel, since = building["kernel"], building["since"]
    return kernel is not None and kernel_cache.holds(pocl_cache(), kernel, since)


def _passed_on(code: int) -> int:
    """The exit code for one that a process ended with by itself, or by a signal from outside."""
    if code == -getattr(signal, "SIGKILL", 9):
        _say("bench was killed from outside; if nobody did, memory ran out. Finished results are kept.")
        return KILLED
    return code if code >= 0 else 128 - code


def _say(sentence: str) -> None:
    print(f"bench: {visible(sentence)}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
