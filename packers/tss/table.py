"""The README's table: L-packing, Oversampling and both, measured by `bench run`.

python -m packers.tss.table hall village path/to/scene.glb
"""

from __future__ import annotations

import csv
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from statistics import median

STRATEGIES = {"L-packing": "lpacking", "Oversampling": "oversampling", "combined": "combined"}
FRAMES, SIZE, ATLAS, CRF = 4, "960x540", "4096x2048", "25"
METHOD = "packers.tss:TessellatedShadingStreaming"
HEADER = (
    "| scene | strategy | scale | samples | slanted | outside | ns per sample | sample / pixel | DSSIM | FLIP | bytes |"
)


def measure(scene: str, folder: Path) -> None:
    """Run all strategies on a scene; raises CalledProcessError if a row fails."""
    methods = [f"--method={METHOD}[strategy={name}]" for name in STRATEGIES.values()]
    settings = ["--frames", str(FRAMES), "--size", SIZE, "--atlas", ATLAS, "--crf", CRF, "--display-crf", CRF]
    command = [sys.executable, "-m", "harness", "run", "--scene", scene, *methods, *settings, "--out", str(folder)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def rows(scene: str, folder: Path) -> Iterator[str]:
    """A line of the table for each strategy: medians over the frames, pictures and bytes at CRF 25."""
    with open(folder / "frames.csv", newline="", encoding="utf-8") as file:
        frames = [row for row in csv.DictReader(file) if row["crf"] == CRF]
    with open(folder / "statistics.csv", newline="", encoding="utf-8") as file:
        statistics = list(csv.DictReader(file))
    for label, strategy in STRATEGIES.items():
        own = [row for row in frames if f"strategy={strategy}" in row["variant"]]
        told = [row for row in statistics if f"strategy={strategy}" in row["variant"]]

        def middle(column: str, own: list = own) -> float:
            return median(float(row[column]) for row in own)

        def reported(name: str, told: list = told) -> float:
            return median(float(row["value"]) for row in told if row["name"] == name)

        cost = 1e6 * median(float(row["gather_ms"]) / float(row["samples"]) for row in own)
        share, outside = reported("oversampling_share"), reported("oversampling_outside_share")
        yield (
            f"| {Path(scene).parent.name or scene} | {label} | {reported('scale'):.2f} | {middle('samples'):,.0f} "
            f"| {share:.0%} | {outside:.0%} | {cost:.0f} | {reported('gather_over_shading'):.2f} "
            f"| {middle('dssim'):.4f} | {middle('flip'):.4f} | {middle('bytes_total'):,.0f} |"
        )


def main(scenes: list[str]) -> None:
    """Print the table."""
    print(HEADER, "| --- | --- " + "| ---: " * 9 + "|", sep="\n")
    for scene in scenes:
        with tempfile.TemporaryDirectory() as folder:
            measure(scene, Path(folder))
            print("\n".join(rows(scene, Path(folder))), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:] or ["hall", "village"])
