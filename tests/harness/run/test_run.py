"""`bench run` as a user meets it: whole, resumed, killed, refused, failing, timed out, dumped, replayed."""

import csv
import json
import re
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from shading_atlas_bench.harness.workload.session import workload_hashes
from shading_atlas_bench.harness.workload.settings import read_settings
from shading_atlas_bench.reports.store.columns import FRAME_COLUMNS
from tests.harness.commands import BAD, ROOT, bench

SMALL = ["--method", "sas", "--frames", "3", "--size", "192x168", "--atlas", "256x256", "--crf", "25"]
VARYING = {column.name for column in FRAME_COLUMNS if column.kind == "time"} - {"network_ms"} | {"peak_mb"}


def rows_of(folder: Path) -> list[dict[str, str]]:
    with open(folder / "frames.csv", newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def lasting(folder: Path) -> list[dict[str, str]]:
    """The rows without what may differ between equal runs."""
    return [{name: value for name, value in row.items() if name not in VARYING} for row in rows_of(folder)]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished, dumped run of the small hall."""
    folder = tmp_path_factory.mktemp("whole") / "run"
    done = bench("run", *SMALL, "--dump", "--out", str(folder))
    assert done.returncode == 0, done.stdout + done.stderr
    assert max(len(line) for line in done.stdout.splitlines() if str(folder) not in line) <= 80
    assert "packing ms" in done.stdout
    return folder


def test_a_run_leaves_every_file_and_one_row_per_codec_and_frame(whole: Path):
    for name in ("results.sqlite", "frames.csv", "summary.csv", "stages.csv", "report.html", "run.json"):
        assert (whole / name).stat().st_size > 0
    rows = rows_of(whole)
    assert [(row["codec"], row["crf"]) for row in rows].count(("none", "")) == 3
    assert [(row["codec"], row["crf"]) for row in rows].count(("h264", "25")) == 3
    assert {row["status"] for row in rows} == {"ok"}
    for row in rows:
        assert float(row["server_ms"]) == pytest.approx(float(row["structs_ms"]) + float(row["gather_ms"]))
        assert 0 < float(row["flip"]) < 0.3
        assert float(row["missing_px"]) < 0.01
        assert int(row["placed_triangles"]) == int(row["pvs_triangles"])
        total = sum(int(row[name]) for name in ("bytes_video", "bytes_metadata", "bytes_geometry"))
        assert int(row["bytes_total"]) == total


def test_a_run_says_how_fast_in_ratios(whole: Path):
    with open(whole / "statistics.csv", newline="", encoding="utf-8") as file:
        values = {(row["frame"], row["name"]): float(row["value"]) for row in csv.DictReader(file)}
    for row in rows_of(whole):
        share, cost, pixel = (
            values[row["frame"], name] for name in ("structs_share", "gather_over_shading", "reference_shading_ns")
        )
        assert share == pytest.approx(float(row["structs_ms"]) / float(row["server_ms"]))
        assert cost == pytest.approx(1e6 * float(row["gather_ms"]) / float(row["samples"]) / pixel)
    assert "gathered sample / reference" in (whole / "report.html").read_text(encoding="utf-8")


def test_the_work_group_size_changes_no_byte(whole: Path, tmp_path: Path):
    folder = tmp_path / "run"
    done = bench("run", *SMALL, "--dump", "--out", str(folder), BENCH_LOCAL_SIZE="7")
    assert done.returncode == 0, done.stderr
    assert lasting(folder) == lasting(whole)
    for ours in sorted((whole / "dump").rglob("*.npz")):
        theirs = np.load(folder / "dump" / ours.relative_to(whole / "dump"))
        for name, values in np.load(ours).items():
            assert np.array_equal(values, theirs[name], equal_nan=True), (ours.name, name)


def test_a_killed_run_resumes_and_ends_with_the_same_rows(whole: Path, tmp_path: Path):
    folder = tmp_path / "run"
    command = [sys.executable, "-m", "shading_atlas_bench", "run", *SMALL, "--out", str(folder)]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        until = time.monotonic() + 200
        while not _finished(folder) and time.monotonic() < until and process.poll() is None:
            time.sleep(0)
    finally:
        process.kill()
        process.wait()
    assert 1 <= _finished(folder) <= 3
    done = bench("run", *SMALL, "--out", str(folder))
    assert done.returncode == 0, done.stderr
    assert lasting(folder) == lasting(whole)


def _finished(folder: Path) -> int:
    """Frames committed so far."""
    try:
        with closing(sqlite3.connect(f"{(folder / 'results.sqlite').as_uri()}?mode=ro", uri=True)) as connection:
            return connection.execute("SELECT count(*) FROM finished").fetchone()[0]
    except sqlite3.OperationalError:
        return 0


def test_another_plan_in_the_same_folder_is_refused_by_name(whole: Path):
    done = bench("run", *SMALL, "--latency", "30", "--out", str(whole))
    assert done.returncode == 2
    assert "latency" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_saved_run_can_be_replayed(whole: Path, tmp_path: Path):
    folder = tmp_path / "run"
    done = bench("run", "--config", str(whole / "run.json"), "--out", str(folder))
    assert done.returncode == 0, done.stderr
    assert lasting(folder) == lasting(whole)


def test_the_dump_is_what_others_can_check(whole: Path):
    scene = np.load(whole / "dump" / "scene.npz")
    (method,) = (folder for folder in (whole / "dump").iterdir() if folder.is_dir())
    frame = np.load(method / "frame_0000.npz")
    count = len(scene["positions"])
    owner, bary, atlas = frame["owner"], frame["bary"], frame["atlas"]
    assert owner.shape == atlas.shape[:2] == bary.shape[:2] == (256, 256)
    assert owner.min() >= -1
    assert owner.max() < count
    assert (atlas[..., 3] == 255).tolist() == (owner >= 0).tolist()
    assert frame["client"].shape == frame["reference"].shape == (168, 192, 3)
    # The novel view's camera must project a visible triangle onto a pixel that shows it.
    row, column = np.argwhere(frame["visibility"] >= 0)[1000]
    corners = scene["positions"][frame["visibility"][row, column]].astype(np.float64)
    clip = np.c_[corners, np.ones(3)] @ (frame["projection"] @ frame["view"]).T
    if (clip[:, 3] > 0).all():
        x = (clip[:, 0] / clip[:, 3] + 1) / 2 * 192
        y = (1 - clip[:, 1] / clip[:, 3]) / 2 * 168
        assert x.min() - 1 <= column + 0.5 <= x.max() + 1
        assert y.min() - 1 <= row + 0.5 <= y.max() + 1


def test_bad_packers_end_as_rows_and_stop_nobody_else(tmp_path: Path):
    folder = tmp_path / "run"
    names = ("Failing", "Sleeping", "Pointless", "Unprepared")
    methods = [argument for name in names for argument in ("--method", f"{BAD}:{name}")]
    done = bench("run", *SMALL, *methods, "--method", "sas", "--timeout", "3", "--out", str(folder))
    assert done.returncode == 1, done.stderr
    statuses: dict[str, list[str]] = {}
    for row in rows_of(folder):
        statuses.setdefault(row["method"], []).append(row["status"])
        assert (row["status"] == "ok") == (row["reason"] == "")
    assert statuses == {
        "failing": ["ok", "failed", "failed"] * 2,
        "sleeping": ["timeout"] * 6,
        "pointless": ["skipped"] * 6,
        "unprepared": ["failed"] * 6,
        "sas": ["ok"] * 6,
    }
    assert any("one too many" in row["reason"] for row in rows_of(folder))
    assert all(row["server_ms"] == "" for row in rows_of(folder) if row["status"] != "ok")


def test_a_hang_inside_a_kernel_ends_as_rows_too(tmp_path: Path):
    folder = tmp_path / "run"
    done = bench(
        "run", *SMALL, "--method", f"{BAD}:Spinning", "--method", "sas", "--timeout", "2", "--out", str(folder)
    )
    assert done.returncode == 1, done.stderr
    statuses = {(row["method"], row["status"]) for row in rows_of(folder)}
    assert statuses == {("spinning", "timeout"), ("sas", "ok")}


def test_repeats_are_kept_and_change_nothing_else(whole: Path, tmp_path: Path):
    folder = tmp_path / "run"
    done = bench("run", *SMALL, "--repeat", "3", "--out", str(folder))
    assert done.returncode == 0, done.stderr
    assert lasting(folder) == lasting(whole)
    with closing(sqlite3.connect(folder / "results.sqlite")) as connection:
        assert connection.execute("SELECT count(DISTINCT repetition) FROM repeats").fetchone()[0] == 3


def test_a_dry_run_says_what_would_run_and_runs_nothing(tmp_path: Path):
    done = bench("run", *SMALL, "--method", "sas@published", "--dry-run", "--out", str(tmp_path / "run"))
    assert done.returncode == 0, done.stderr
    named = [name for name in re.findall(r"^\S+", done.stdout, re.MULTILINE) if "sas" in name]
    assert named == ["sas", "sas@published"]
    assert "alpha mask" in done.stdout
    assert not (tmp_path / "run").exists()


def test_reports_are_rebuilt_and_runs_compared(whole: Path):
    before = (whole / "frames.csv").read_text(encoding="utf-8")
    (whole / "frames.csv").unlink()
    assert bench("report", str(whole)).returncode == 0
    assert (whole / "frames.csv").read_text(encoding="utf-8") == before
    done = bench("compare", str(whole), str(whole))
    assert done.returncode == 0, done.stderr
    assert "same" in done.stdout
    assert "better" not in done.stdout
    assert "worse" not in done.stdout


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--scene", "hell"], "hall"),
        (["--scene", "nowhere/scene.glb"], "nowhere/scene.glb"),
        (["--method", "saz"], "sas"),
        (["--method", "sas[resue=true]"], "reuse"),
        (["--path", "wlak"], "walk"),
        (["--head-motion", "nowhere.txt"], "nowhere.txt"),
        (["--size", "960"], "--size"),
        (["--cell", "0.1"], "--cell"),
        (["--fov", "100"], "field of view"),
        (["--device", "abacus"], "abacus"),
        (["--config", "nowhere.json"], "nowhere.json"),
        (["--crf", "99"], "--crf"),
        (["--seed", "-1"], "--seed"),
        (["--scene", ""], "--scene"),
        (["--unit", "2"], "--unit"),
        (["--unit", "furlong"], "km"),
        (["--codec", "none", "--crf", "5"], "--crf"),
        (["--method", "sas[fit=2]"], "fit"),
        (["--method", "sas[superblock=100]"], "superblock"),
        (["--method", "mine.py"], "mine.py:"),
        (["--head-motion", "nowhere.txt", "--dry-run"], "nowhere.txt"),
        (["--device", "abacus", "--dry-run"], "abacus"),
        (["--device", ""], "--device is empty"),
        (["--frames", "9" * 20], "--frames"),
    ],
)
def test_unusable_arguments_are_one_sentence_and_exit_2(arguments: list[str], says: str, tmp_path: Path):
    done = bench("run", "--frames", "1", *arguments, "--out", str(tmp_path / "run"))
    assert done.returncode == 2, done.stdout
    assert says in done.stderr
    assert "Traceback" not in done.stderr


def test_results_go_into_a_folder_of_their_own(tmp_path: Path):
    (tmp_path / "thesis.tex").write_text("years of work", encoding="utf-8")
    for out in (tmp_path, tmp_path / "thesis.tex"):
        done = bench("run", *SMALL, "--out", str(out))
        assert done.returncode == 2
        assert "--out" in done.stderr
    assert [entry.name for entry in tmp_path.iterdir()] == ["thesis.tex"]


def test_results_of_an_edited_packer_do_not_mix_with_older_ones(tmp_path: Path):
    source = tmp_path / "mine.py"
    source.write_text(
        "from packers.sas import ShadingAtlasStreaming\n\nclass Mine(ShadingAtlasStreaming):\n    name = 'mine'\n",
        encoding="utf-8",
    )
    small = [*SMALL, "--frames", "1", "--codec", "none", "--method", f"{source}:Mine", "--out", str(tmp_path / "run")]
    small = [argument for argument in small if argument not in ("--crf", "25")]
    assert bench("run", *small).returncode == 0
    source.write_text(source.read_text(encoding="utf-8") + "\n# edited\n", encoding="utf-8")
    done = bench("run", *small)
    assert done.returncode == 2
    assert "mine" in done.stderr


def test_a_stopped_run_says_what_is_kept(tmp_path: Path):
    folder = tmp_path / "run"
    command = [sys.executable, "-m", "shading_atlas_bench", "run", *SMALL, "--out", str(folder)]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    until = time.monotonic() + 200
    while not _finished(folder) and time.monotonic() < until and process.poll() is None:
        time.sleep(0)
    process.terminate()
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "--out" in said.split("Stopped.")[1]
    assert "Traceback" not in said


def test_run_json_says_what_ran(whole: Path):
    saved = json.loads((whole / "run.json").read_text(encoding="utf-8"))
    assert saved["settings"]["frames"] == 3
    for name in ("scene_hash", "path_hash"):
        assert saved["plan"][name] == rows_of(whole)[0][name]
    settings = read_settings(whole / "run.json")
    assert saved["plan"].items() >= workload_hashes(settings).items()
