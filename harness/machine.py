"""What the operating system says of this process and of the machine, on Linux, Windows and macOS alike."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import psutil

STATUS = Path("/proc/self/status")


def peak_memory() -> int:
    """The most memory that this process has had resident so far, in bytes."""
    if STATUS.is_file():  # Linux; its ru_maxrss would begin with the peak of the process that started this one
        return int(re.search(r"^VmHWM:\s*(\d+) kB$", STATUS.read_text(encoding="utf-8"), re.MULTILINE)[1]) * 1024
    if sys.platform == "win32":
        return psutil.Process().memory_info().peak_wset
    import resource

    unit = 1 if sys.platform == "darwin" else 1024  # bytes on macOS, kibibytes on the BSDs
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def load() -> float:
    """Processes that ran or waited for a core in the last minute, on average; 0 on Windows for the first seconds."""
    return psutil.getloadavg()[0]
