"""Child processes have the flags of their parent: with others they could be another program."""

from __future__ import annotations

import subprocess
import sys

import pytest

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
