"""What transparency costs each method: `python -m packers.transparency SCENE ... [-- OPTIONS]` runs every scene as it
is and with see-through materials made opaque, and prints a Markdown table. Options are passed on to `bench run`.
"""

from __future__ import annotations

import csv
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median

METHODS = ("sas", "snakebinning", "tss")
RATE = "25"  # CRF of the displayed picture
HEADINGS = (
    "scene", "method", "FLIP", "opaque", "ratio", "FLIP, CRF 25", "opaque", "ratio", "samples", "alpha kB",
)  # fmt: skip


def main(arguments: list[str]) -> int:
    """Run and print; returns the worst exit code."""
    split = arguments.index("--") if "--" in arguments else len(arguments)
    scenes, options = arguments[:split], arguments[split + 1 :]
    if not scenes:
        print("Name at least one scene: python -m packers.transparency shells", file=sys.stderr)
        return 2
    print(f"| {' | '.join(HEADINGS)} |\n| --- | --- |{' --- |' * (len(HEADINGS) - 2)}")
    worst = 0
    for scene in scenes:
        with tempfile.TemporaryDirectory() as folder:
            runs = []
            for version in ((), ("--opaque",)):
                out = Path(folder) / f"run{len(runs)}"
                code = _run(scene, [*version, *options], out)
                if not (out / "frames.csv").is_file():
                    return code
                worst = max(worst, code)
                with (out / "frames.csv").open(newline="", encoding="utf-8") as file:
                    runs.append(list(csv.DictReader(file)))
            print("\n".join(_line(*runs, method) for method in METHODS), flush=True)
    return worst


def _run(scene: str, options: list[str], out: Path) -> int:
    """One run of all methods; shows what went wrong if anything did."""
    command = [sys.executable, "-m", "harness", "run", "--scene", scene, "--crf", RATE, "--out", str(out), *options]
    for method in METHODS:
        command += ["--method", method]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    if done.returncode:
        print(done.stdout or done.stderr, file=sys.stderr)
    return done.returncode


def _line(seen: list[dict[str, str]], opaque: list[dict[str, str]], method: str) -> str:
    """A method's line: numbers of the scene as it is, and ratios to those of its opaque version."""
    cells = [seen[0]["scene"], method]
    for codec in ("none", "h264"):
        own, other = (_median(rows, method, codec, "flip") for rows in (seen, opaque))
        cells += [_text(own, 4), _text(other, 4), _ratio(own, other)]
    cells.append(_ratio(*(_median(rows, method, "none", "samples") for rows in (seen, opaque))))
    alpha = _median(seen, method, "h264", "bytes_alpha")
    return f"| {' | '.join([*cells, _text(alpha and alpha / 1000, 1)])} |"


def _median(rows: list[dict[str, str]], method: str, codec: str, name: str) -> float | None:
    """Over the frames that have a value."""
    found = [float(r[name]) for r in rows if (r["method"], r["codec"]) == (method, codec) and r[name]]
    return median(found) if found else None


def _text(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"


def _ratio(value: float | None, other: float | None) -> str:
    return f"{value / other:.2f}" if value is not None and other else ""


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
