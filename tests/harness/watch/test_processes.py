"""Child processes have the flags of their parent: with others they could be another program."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from shading_atlas_bench.harness.watch.ends import cause_of
from shading_atlas_bench.harness.watch.processes import python
from tests.harness.commands import ROOT

SHOW = "import sys; print(sys.flags)"
ASK = f"""
import subprocess, sys
from shading_atlas_bench.harness.watch.processes import python
print(subprocess.run(python("-c", {SHOW!r}), capture_output=True, text=True).stdout.strip())
{SHOW}
"""


@pytest.mark.parametrize("flags", [["-P"], ["-P", "-O", "-B"], ["-P", "-s", "-bb", "-Xutf8=1"], ["-I"], ["-E", "-P"]])
def test_a_child_has_its_parents_flags(flags: list[str]) -> None:
    done = subprocess.run([sys.executable, *flags, "-c", ASK], capture_output=True, text=True, check=False)
    if done.returncode and "ModuleNotFoundError" in done.stderr:
        pytest.skip("the suite is not installed where the environment is ignored")
    child, parent = done.stdout.splitlines()
    assert child == parent


def test_a_child_runs_no_code_of_the_working_folder(tmp_path: Path) -> None:
    """Neither a package of the suite's names there, nor a module of Python's."""
    for name in (
        "shading_atlas_bench/__init__.py",
        "harness/__init__.py",
        "kernels/__init__.py",
        "json.py",
        "typer.py",
    ):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("from pathlib import Path\nPath('ran').touch()\n", encoding="utf-8")
    command = python("-m", "shading_atlas_bench.harness.cli.main", "report", "none")
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert (done.returncode, "has no results.sqlite" in done.stderr) == (2, True), done.stderr
    assert not (tmp_path / "ran").exists()


def test_every_exit_code_has_a_cause():
    assert cause_of(-signal.SIGTERM) == "SIGTERM"
    assert cause_of(0xC0000005) == "0xc0000005"
    assert [cause_of(-35), cause_of(-200)] == ["signal 35", "signal 200"]  # of real time, and of nowhere
