"""The command line in a process of its own, as tests of several rooms start it."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
BAD = Path(__file__).parent / "bad_packers.py"


def bench(*arguments: str, **environment: str) -> subprocess.CompletedProcess:
    """Run `bench` with these arguments at 80 columns, watched as a user's is; `environment` on top of this process'."""
    return subprocess.run(
        [sys.executable, "-m", "shading_atlas_bench", *arguments],
        cwd=ROOT, env=os.environ | {"COLUMNS": "80"} | environment, capture_output=True, text=True, timeout=300,
        check=False,
    )  # fmt: skip
