"""What each part of SnakeBinning contributes: `python -m packers.snakebinning.table` runs the suite with each switch
flipped and prints a Markdown table. All arguments are passed on to `bench run`.
"""

from __future__ import annotations

import csv
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path
from statistics import median

RATE = "25"  # CRF of the bytes and of the displayed picture
VARIANTS = {
    "as published": "",
    "no hysteresis": "hysteresis=false",
    "no spare capacity": "capacity=0",
    "no freezing": "freeze=0",
    "no mapping": "mapping=off",
    "hierarchical mapping": "mapping=hierarchical",
    "linear bins": "logarithmic=false",
    "no perspective": "perspective=false",
    "no full footprint": "full_footprint=false",
    "first superblock with room": "assignment=first",
    "enlarged by half a texel": "enlarge=paper",
    "no slicing": "slicing=0",
    "shading rate 1": "shading_rate=1.0",
}
HEADINGS = ("", "samples", "fill", "coherence", "video bytes", "metadata bytes", "FLIP")


def main(arguments: list[str]) -> int:
    """Run and print; returns the exit code."""
    methods = [f"snakebinning[{values}]" if values else "snakebinning" for values in VARIANTS.values()] + ["sas", "tss"]
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "harness", "run", "--crf", RATE, "--out", f"{folder}/run", *arguments]
        for method in methods:
            command += ["--method", method]
        code = subprocess.run(command, stdout=sys.stderr, check=False).returncode
        if not Path(folder, "run", "frames.csv").is_file():
            return code
        with open(Path(folder, "run", "frames.csv"), newline="", encoding="utf-8") as file:
            print("\n".join(table_of(list(csv.DictReader(file)))))
    return code


def table_of(rows: list[dict[str, str]]) -> list[str]:
    """Lines of the table: medians over the frames after the first, a line per variant, then one per other method."""
    lanes: dict[tuple[str, str], list[dict[str, str]]] = {}
    for row in rows:
        if row["frame"] != "0":
            lanes.setdefault((row["method"], row["variant"]), []).append(row)
    ours = [variant for method, variant in lanes if method == "snakebinning"]
    usual = Counter(part for variant in ours for part in variant.split(","))
    named = {}
    for variant in ours:
        changed = [part for part in variant.split(",") if usual[part] <= len(ours) / 2]
        name = next(n for n, value in VARIANTS.items() if (value and changed[:1] and changed[0].startswith(value))
                    or (not value and not changed))  # fmt: skip
        named[name] = lanes["snakebinning", variant]
    ordered = {name: named[name] for name in VARIANTS if name in named}
    ordered |= {method: lane for (method, _), lane in lanes.items() if method != "snakebinning"}
    lines = ["| " + " | ".join(HEADINGS) + " |", "|" + " --- |" * len(HEADINGS)]
    return lines + [f"| {name} | {' | '.join(_cells(lane))} |" for name, lane in ordered.items()]


def _cells(rows: list[dict[str, str]]) -> list[str]:
    plain = [row for row in rows if row["codec"] == "none"]
    coded = [row for row in rows if row["codec"] != "none"]
    return [
        f"{_median(plain, 'samples'):,.0f}",
        f"{_median(plain, 'fill'):.2f}",
        f"{_median(plain, 'coherence'):.3f}",
        f"{_median(coded, 'bytes_video'):,.0f}",
        f"{_median(plain, 'bytes_metadata'):,.0f}",
        f"{_median(plain, 'flip'):.4f}",
    ]


def _median(rows: list[dict[str, str]], column: str) -> float:
    values = [float(row[column]) for row in rows if row[column]]
    return median(values) if values else float("nan")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
