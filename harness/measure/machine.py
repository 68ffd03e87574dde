"""What the operating system says of this process and of the machine, on Linux, Windows and macOS alike."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import psutil

ROOT = Path(__file__).resolve().parents[2]
STATUS = Path("/proc/self/status")


def peak_memory() -> int:
    """The most memory that this process has had resident so far, in bytes."""
    status = STATUS.read_text(encoding="utf-8") if STATUS.is_file() else ""
    # Linux; its ru_maxrss would begin with the peak of the process that started this one.
    if peak := re.search(r"^VmHWM:\s*(\d+) kB$", status, re.MULTILINE):
        return int(peak[1]) * 1024
    if sys.platform == "win32":
        return int(psutil.Process().memory_info().peak_wset)
    import resource

    unit = 1 if sys.platform == "darwin" else 1024  # bytes on macOS, kibibytes on the BSDs
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def load() -> float:
    """Processes that ran or waited for a core in the last minute, on average; 0 on Windows for the first seconds."""
    return float(psutil.getloadavg()[0])


def commit() -> str:
    """The commit of the repository that this program runs from, marked where its sources were changed since.

    Empty where it is no clone, or git is not there.
    """
    try:
        if Path(_git("rev-parse", "--show-toplevel")).resolve() != ROOT.resolve():
            return ""  # an installed copy, in an environment inside somebody's own repository
        revision = _git("rev-parse", "--short=10", "HEAD")
        changed = _git("status", "--porcelain", "--untracked-files=no", "--", "*.py", "*.cl", "*.toml")
    except (OSError, subprocess.CalledProcessError):
        return ""
    return f"{revision} with changes" if changed else revision


def _git(*arguments: str) -> str:
    command = ["git", "-C", str(ROOT), *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True, encoding="utf-8").stdout.strip()
