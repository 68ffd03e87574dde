"""The harness' errors, and what is told of those of others."""

from __future__ import annotations

import signal
import traceback
from pathlib import Path

from shading_atlas_bench.errors import BenchError

LONGEST = 300  # letters of somebody else's text in a sentence


class InputError(BenchError, ValueError):
    """Arguments or input that cannot be used; the message is one sentence."""


class StoppedError(Exception):
    """Long work was interrupted; the message says what is kept and how to go on."""


class StopAsked(KeyboardInterrupt):  # no error, as the exception that it is derived from
    """Ctrl-C or a signal asks for the end, inside of `harness.watch.stops.stops_apart`."""


def is_stop(error: BaseException) -> bool:
    """Whether all work is to end with this exception, which a packer cannot ask for.

    As long as Python's own handler of Ctrl-C stands, nobody can tell a packer's KeyboardInterrupt from a person's.
    """
    untold = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    return isinstance(error, StopAsked) or (isinstance(error, KeyboardInterrupt) and untold)


def told(error: BaseException) -> str:
    """Somebody else's exception in one line: its kind, what it says and where it was raised."""
    place = traceback.extract_tb(error.__traceback__)[-1:]
    where = [plain(f"({Path(frame.filename).name}, line {frame.lineno})") for frame in place]
    text = text_of(error)
    return " ".join([plain(type(error).__name__ + f": {text}" * bool(text)), *where])


def text_of(error: BaseException) -> str:
    """What somebody else's exception says, in one line; empty where that cannot be told."""
    try:
        return plain(str(error))
    except BaseException as mute:  # its own code is run, which may raise anything
        if is_stop(mute):
            raise
        return ""


def plain(text: str, most: int = LONGEST) -> str:
    """Somebody else's text in one line, of letters that every file and terminal takes, cut off after `most`."""
    start = " ".join(str.__str__(text)[: 4 * most].split())
    line = "".join(letter if letter.isprintable() else ascii(letter)[1:-1] for letter in start)
    return line if len(line) <= most else line[: most - 1] + "…"
