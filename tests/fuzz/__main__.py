"""Fuzz the doors that strangers' things come through.

python -m tests.fuzz                     every target, 10,000 cases each
python -m tests.fuzz json --cases 500    the targets of tests/fuzz/test_json.py
python -m tests.fuzz json --seconds 60   on a machine that is busy with other things

A case fails if it ends in anything but a result or an error for people, takes over 10 seconds, or writes outside of its
folder. Hypothesis prints the smallest one that it finds, and how to run it again.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path

from tests.fuzz.cases import CASES, LONGEST, SECONDS

HERE = Path(__file__).parent
DOORS = sorted(path.stem.removeprefix("test_") for path in HERE.glob("test_*.py"))


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m tests.fuzz", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("door", nargs="*", help=f"{', '.join(DOORS)}; all where none is named")
    parser.add_argument("--cases", type=int, default=10_000, help="cases of each target (10000)")
    parser.add_argument("--seconds", type=float, default=LONGEST, help=f"that a case may take ({LONGEST})")
    asked = parser.parse_args()
    if asked.cases < 1:
        parser.error("--cases must be 1 or more.")
    if not 0 < asked.seconds < 1e6:
        parser.error("--seconds must be over 0 and below a million.")
    unknown = sorted(set(asked.door) - set(DOORS))
    if unknown:
        parser.error(f"there is no door {', '.join(unknown)}; there are {', '.join(DOORS)}.")
    files = [str(HERE / f"test_{door}.py") for door in asked.door or DOORS]
    command = [sys.executable, "-m", "pytest", "-n", "0", "-p", "no:cacheprovider", "--durations=0", "-q", *files]
    return subprocess.run(command, env=os.environ | {CASES: str(asked.cases), SECONDS: str(asked.seconds)}).returncode


if __name__ == "__main__":
    sys.exit(main())
