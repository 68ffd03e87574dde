"""What runs take at their peak beside what is estimated: the table that the estimate's constants are from.

python -m tests.memory                  every case
python -m tests.memory texels pixels    those whose names begin so

Large scenes are left out where BENCH_SCENES does not have them. Each run is a process of its own.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from shading_atlas_bench.harness.run.memory import memory_need, methods_at_once
from shading_atlas_bench.harness.workload.methods import find_methods
from shading_atlas_bench.harness.workload.session import open_scene
from shading_atlas_bench.harness.workload.settings import settings_of
from tests.harness.commands import ROOT

SMALL = {"method": ["all"], "frames": 4, "size": "160x90", "atlas": "512x512"}
PLAIN = {"codec": "none"}
CASES: dict[str, dict[str, Any]] = {
    "default": {"method": ["all"]},
    "smallest": SMALL | PLAIN | {"method": ["sas"]},
    "small": SMALL | PLAIN,
    "texels 1024, no codec": SMALL | PLAIN | {"atlas": "1024x1024"},
    "texels 2048, no codec": SMALL | PLAIN | {"atlas": "2048x2048"},
    "texels 4096, no codec": SMALL | PLAIN | {"atlas": "4096x4096"},
    "texels 4096, no codec, sas": SMALL | PLAIN | {"atlas": "4096x4096", "method": ["sas"]},
    "texels 2048": SMALL | {"atlas": "2048x2048"},
    "texels 4096": SMALL | {"atlas": "4096x4096"},
    "texels 4096, sas": SMALL | {"atlas": "4096x4096", "method": ["sas"]},
    "texels 4096, sas, one rate": SMALL | {"atlas": "4096x4096", "method": ["sas"], "crf": "25"},
    "texels 4096, two frames": SMALL | {"atlas": "4096x4096", "frames": 2},
    "texels 4096, jpeg": SMALL | {"atlas": "4096x4096", "codec": "jpeg"},
    "texels 4096, 6.3 GB": SMALL | {"atlas": "4096x4096", "memory": "6.3G"},
    "texels 8192, one frame": SMALL | {"atlas": "8192x8192", "frames": 1},
    "texels 8192, one frame, 7.2 GB": SMALL | {"atlas": "8192x8192", "frames": 1, "memory": "7.2G"},
    "pixels 1920": SMALL | PLAIN | {"size": "1920x1080"},
    "pixels 3840": SMALL | PLAIN | {"size": "3840x2160"},
    "pixels 7680": SMALL | PLAIN | {"size": "7680x4320", "frames": 1, "method": ["sas"]},
    "pixels 3840, sas": SMALL | PLAIN | {"size": "3840x2160", "method": ["sas"]},
    "triangles 500,000": SMALL | PLAIN | {"detail": 500_000},
    "triangles 1,000,000": SMALL | PLAIN | {"detail": 1_000_000},
    "triangles 2,000,000": SMALL | PLAIN | {"detail": 2_000_000},
    "triangles 1,000,000, sas": SMALL | PLAIN | {"detail": 1_000_000, "method": ["sas"]},
    "scene of 4 million": {"method": ["all"], "frames": 1, "scene": "viking_village/scene.glb"},
    "scene with many textures": {"method": ["all"], "frames": 1, "scene": "bistro_exterior/scene.glb"},
}


def estimated(options: dict[str, Any]) -> float:
    """Gigabytes."""
    settings = settings_of(options)
    scene, packers = open_scene(settings), find_methods(settings)
    return memory_need(settings, scene, packers, methods_at_once(settings, scene, packers)).total / 1e9


def measured(options: dict[str, Any]) -> float:
    """Gigabytes at the peak of a run. Exits with what it said if it fails."""
    given = {"method": options["method"][0]} | {name: value for name, value in options.items() if name != "method"}
    words = [word for name, value in given.items() for word in (f"--{name}", str(value))]
    with tempfile.TemporaryDirectory(prefix="bench-memory-") as folder:
        line = [sys.executable, "-m", "shading_atlas_bench", "run", *words, "--out", str(Path(folder) / "run")]
        process = subprocess.run(
            line, cwd=ROOT, env=os.environ | {"BENCH_SUPERVISED": "0"}, stdin=subprocess.DEVNULL, capture_output=True
        )
    if process.returncode:
        sys.exit(process.stderr.decode(errors="replace")[-1000:])
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024 / 1e9


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m tests.memory", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("case", nargs="*", help=f"beginnings of names: {', '.join(CASES)}")
    asked = parser.parse_args()
    print(f"{'GB':34}{'measured':>9}{'estimated':>10}{'ratio':>7}")
    for name, options in CASES.items():
        if asked.case and not name.startswith(tuple(asked.case)):
            continue
        scene = options.get("scene")
        if scene and not Path(os.environ.get("BENCH_SCENES", ""), scene).is_file():
            print(f"{name:34} left out: BENCH_SCENES has no {scene}")
            continue
        with get_context("spawn").Pool(1) as pool:  # whose peak is no later one's
            peak = pool.apply(measured, (options,))
            guess = pool.apply(estimated, (options,))
        print(f"{name:34}{peak:9.2f}{guess:10.2f}{guess / peak:7.2f}", flush=True)


if __name__ == "__main__":
    main()
