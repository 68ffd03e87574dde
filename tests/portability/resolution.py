"""Whether all dependencies can be had on each system, as wheels: `python -m tests.portability.resolution`.

Asks PyPI through uv (`pip install uv`), which evaluates markers as the other system would and downloads metadata only.
Prints a table, and why where something cannot be had; exits with 1 then. `--extra NAME` takes an extra along.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path

from rich.console import Console
from rich.table import Table

ROOT = Path(__file__).parents[2]
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
PLATFORMS = {  # what the README calls it, and what uv does
    "Linux x86-64, glibc 2.28": "x86_64-manylinux_2_28",
    "Linux x86-64, glibc 2.36": "x86_64-manylinux_2_36",
    "Linux ARM, glibc 2.28": "aarch64-manylinux_2_28",
    "Linux ARM, glibc 2.36": "aarch64-manylinux_2_36",
    "Windows x86-64": "x86_64-pc-windows-msvc",
    "macOS 14 ARM": "aarch64-apple-darwin",
    "macOS 14 x86-64": "x86_64-apple-darwin",
}


def resolve(platform: str, python: str, extras: list[str]) -> str:
    """Empty where all can be had, else uv's sentence about what cannot."""
    command = [sys.executable, "-m", "uv", "pip", "compile", "--quiet", "--only-binary", ":all:"]
    command += ["--python-platform", platform, "--python-version", python]
    command += [word for extra in extras for word in ("--extra", extra)]
    environment = os.environ | {"MACOSX_DEPLOYMENT_TARGET": "14.0"}
    done = subprocess.run(
        [*command, str(ROOT / "pyproject.toml")],
        env=environment,
        capture_output=True,
        encoding="utf-8",
        check=False,
        timeout=300,
    )
    return (
        ""
        if done.returncode == 0
        else " ".join(done.stderr.partition("cause:")[2].partition("hint:")[0].split()) or done.stderr
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--extra", action="append", default=[])
    extras = parser.parse_args().extra
    table = Table("system", *PYTHONS, title=" + ".join(["dependencies", *extras]), title_justify="left", box=None)
    causes = []
    for name, platform in PLATFORMS.items():
        found = [resolve(platform, python, extras) for python in PYTHONS]
        table.add_row(name, *("no" if cause else "yes" for cause in found))
        causes += [f"{name}, Python {python}: {cause}" for python, cause in zip(PYTHONS, found, strict=True) if cause]
    console = Console(highlight=False)
    console.print(table)
    for cause in causes:
        console.print(cause, markup=False)
    sys.exit(1 if causes else 0)


if __name__ == "__main__":
    main()
