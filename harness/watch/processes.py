"""Python in a process of its own, started as this one was."""

from __future__ import annotations

import sys

SWITCHES = {"isolated": "-I", "ignore_environment": "-E", "no_user_site": "-s", "dont_write_bytecode": "-B"}


def python(*arguments: str) -> list[str]:
    """The command that runs this Python on `arguments`, with this process' flags.

    Modules of the working folder never take the place of installed ones, as they would for `python -m`.
    """
    flags = [f"-W{option}" for option in sys.warnoptions]
    flags += [f"-X{name}" if value is True else f"-X{name}={value}" for name, value in sys._xoptions.items()]
    switches = [letter for name, letter in SWITCHES.items() if getattr(sys.flags, name)]
    switches += ["-O"] * sys.flags.optimize + ["-b"] * sys.flags.bytes_warning
    return [sys.executable, "-P", *switches, *flags, *arguments]
