"""A run's numbers, but for times and memory, are the same on every processor, with any threads, folders, time zone.

Those that no video codec has a part in are also those of golden_rows.csv, which
`python -m tests.portability.test_same_results` writes anew where a change is meant to change them.
"""

from __future__ import annotations

import csv
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from shading_atlas_bench.kernels.cache import cache_folder
from shading_atlas_bench.kernels.runtime.opencl import find_devices
from shading_atlas_bench.reports.store.columns import FRAME_COLUMNS
from tests.portability.test_golden_values import PROCESSORS, ROOT

VARYING = {column.name for column in FRAME_COLUMNS if column.kind == "time"} | {"peak_mb"}
SMALL = ["--frames", "2", "--size", "320x180", "--atlas", "512x512", "--crf", "25"]
GOLDEN = Path(__file__).with_name("golden_rows.csv")
KEPT = ("method", "frame", "status", "pvs_triangles", "placed_triangles", "samples", "fill", "coherence", "missing_px",
        "holes_px", "flip", "dssim", "iwssim", "psnr", "delta_e", "stretch_l2", "skipped")  # fmt: skip
DEEP = Path(*["d" * 200] * 17, "e" * 150)  # about 3,600 characters
LONGEST_OUT = 480  # characters, just below what SQLite opens

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="processors and affinity are set as Linux does")


def others() -> list[str]:
    """Usable devices beside the default one, by platform and name."""
    names = [f"{one.device.platform.name} {one.device.name}" for one in find_devices() if one.refused() is None]
    return list(dict.fromkeys(name for name in names[1:] if name != names[0]))


BENCH = (sys.executable, "-m", "shading_atlas_bench.harness.cli.main")


def frames(out: Path, method: str, work: Path = ROOT, wrap: tuple[str, ...] = (), /, **environment: str) -> list[dict]:
    """What frames.csv says of a small run in a process of its own, without what may vary."""
    done = subprocess.run(
        [*wrap, *BENCH, "run", "--method", method, *SMALL, "--out", str(out)],
        cwd=work, env=os.environ | {"PYTHONPATH": str(ROOT)} | environment, capture_output=True, text=True,
        timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    with open(out / "frames.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return [{name: value for name, value in row.items() if name not in VARYING} for row in rows]


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> list[dict]:
    """Rows of a run of all methods in the surroundings of the tests."""
    rows = frames(tmp_path_factory.mktemp("plain") / "run", "all")
    assert [row["status"] for row in rows] == ["ok"] * 14
    return rows


def kept_of(rows: list[dict]) -> list[dict]:
    """What golden_rows.csv has of rows."""
    return [{name: row[name] for name in KEPT} for row in rows if row["codec"] == "none"]


def write_golden(file: Path = GOLDEN) -> None:
    """Measure golden_rows.csv anew."""
    with tempfile.TemporaryDirectory() as folder, open(file, "w", newline="", encoding="utf-8") as golden:
        writer = csv.DictWriter(golden, KEPT, lineterminator="\n")
        writer.writeheader()
        writer.writerows(kept_of(frames(Path(folder) / "run", "all")))


def assert_same(found: list[dict], expected: list[dict]) -> None:
    """Rows of the methods found are those expected; names what differs."""
    methods = {row["method"] for row in found}
    expected = [row for row in expected if row["method"] in methods]
    assert len(found) == len(expected) > 0
    apart = [
        {name: (own[name], other[name]) for name in other if own[name] != other[name]}
        for own, other in zip(found, expected, strict=True)
    ]
    assert apart == [{}] * len(apart)


def caches(folder: Path) -> dict[str, str]:
    """An empty cache but for compiled kernels, so that scenes and visible sets are computed."""
    return {
        "XDG_CACHE_HOME": str(folder),
        "POCL_CACHE_DIR": os.environ.get("POCL_CACHE_DIR", str(cache_folder("pocl"))),
    }


def test_what_no_codec_has_a_part_in_is_what_was_kept(plain):
    with open(GOLDEN, newline="", encoding="utf-8") as file:
        golden = list(csv.DictReader(file))
    assert len(golden) == 8, "two frames of four methods"
    assert kept_of(plain) == golden


def test_the_oldest_processor_measures_the_same(plain, tmp_path):
    """With eight threads of OpenCL on one core, another time zone, order of hashes and memory full of garbage."""
    found = frames(
        tmp_path / "run",
        "all",
        ROOT,
        ("taskset", "-c", str(min(os.sched_getaffinity(0)))),
        **PROCESSORS["oldest"],
        **caches(tmp_path / "cache"),
        POCL_MAX_PTHREAD_COUNT="8",
        PYTHONHASHSEED="7",
        TZ="Asia/Kathmandu",
        MALLOC_PERTURB_="165",
    )
    assert_same(found, plain)


def test_one_thread_in_a_deep_working_folder_changes_nothing(plain, tmp_path):
    (tmp_path / DEEP).mkdir(parents=True)
    found = frames(tmp_path / "run", "tss", tmp_path / DEEP, POCL_MAX_PTHREAD_COUNT="1")
    assert_same(found, plain)


def test_three_threads_and_a_deep_folder_of_results_change_nothing(plain, tmp_path):
    left = LONGEST_OUT - len(str(tmp_path)) - 2
    out = tmp_path / ("f" * (left // 2)) / ("g" * (left - left // 2))
    assert_same(frames(out, "snakebinning", POCL_MAX_PTHREAD_COUNT="3"), plain)


def test_how_kernels_are_compiled_changes_nothing(plain, tmp_path):
    """Each work-item's loop as it is, without PoCL's cache of kernels."""
    compiled = {"POCL_KERNEL_CACHE": "0", "POCL_WORK_GROUP_METHOD": "loops", "XDG_CACHE_HOME": str(tmp_path / "cache")}
    assert_same(frames(tmp_path / "run", "sas", **compiled), plain)


def test_every_runtime_measures_the_same(plain, tmp_path):
    if not (names := others()):
        pytest.skip("there is one OpenCL runtime; `pip install -e '.[intel]'` brings another")
    for number, name in enumerate(names):
        found = frames(tmp_path / str(number), "all", BENCH_DEVICE=name)
        assert {row["device"] for row in found} != {plain[0]["device"]}
        assert_same([row | {"device": ""} for row in found], [row | {"device": ""} for row in plain])


def test_a_driver_without_threads_of_its_own_ends_and_measures_the_same(plain, tmp_path):
    """It runs kernels in the thread that launches them, and locks itself where two threads use one queue."""
    found = frames(tmp_path / "run", "all", POCL_DEVICES="basic", BENCH_DEVICE="Portable", **caches(tmp_path / "cache"))
    assert_same([row | {"device": ""} for row in found], [row | {"device": ""} for row in plain])


if __name__ == "__main__":
    write_golden()
