"""Nothing needs POSIX before it is used: every module is imported where the system offers no more than Windows does."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NAME = "shading_atlas_bench"
# Modules are imported twice: libraries, which know the system that they are on, are left as they are the second time.
IMPORT_ALL = """
import importlib, os, pkgutil, signal, sys
sys.path[:0] = [{root!r}, *sys.argv[1:]]
ours = {name!r}
names = [name for _, name, _ in pkgutil.walk_packages([{root!r} + "/" + ours], ours + ".") if "__main__" not in name]
names += sys.argv[2:]
for name in names:
    importlib.import_module(name)
for name in [name for name in sys.modules if name.partition(".")[0] in (ours, *sys.argv[2:])]:
    del sys.modules[name]
for name in ("fcntl", "grp", "pwd", "resource", "termios", "tty", "pty", "syslog"):
    sys.modules[name] = None
for module, lacking in (
    (signal, "SIGALRM SIGHUP SIGKILL SIGQUIT SIGUSR1 SIGUSR2 SIGCHLD ITIMER_REAL setitimer alarm pause sigwait"),
    (os, "fork forkpty getloadavg sched_getaffinity sched_yield getuid geteuid getgid killpg setsid mkfifo nice uname"),
):
    for name in lacking.split():
        vars(module).pop(name, None)
for name in names:
    importlib.import_module(name)
print(len(names))
"""


def import_all(*plugins: str) -> subprocess.CompletedProcess:
    """Import all modules, and `plugins`: a folder and the names of modules in it."""
    code = IMPORT_ALL.format(root=str(ROOT), name=NAME)
    command = [sys.executable, "-c", code, *plugins]
    return subprocess.run(command, cwd=ROOT, capture_output=True, encoding="utf-8", check=False, timeout=300)


def test_every_module_can_be_imported():
    done = import_all()
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 150


@pytest.mark.parametrize("line", ["import fcntl", "import signal; signal.SIGALRM"])
def test_a_module_that_needs_posix_is_found(line: str, tmp_path: Path):
    (tmp_path / "posix_only.py").write_text(line, encoding="utf-8")
    done = import_all(str(tmp_path), "posix_only")
    assert done.returncode == 1
    assert "posix_only.py" in done.stderr
