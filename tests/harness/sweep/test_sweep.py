"""`bench sweep` as a user meets it: whole, killed and resumed, refused, side by side, with methods that fail."""

from __future__ import annotations

import csv
import json
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from shading_atlas_bench.harness.cli.main import app
from shading_atlas_bench.harness.workload.session import workload_hashes
from shading_atlas_bench.harness.workload.settings import Settings
from shading_atlas_bench.reports.analysis.sweep import read_points
from shading_atlas_bench.reports.documents.digests import sweep_parts
from shading_atlas_bench.reports.store.columns import SWEEP_COLUMNS
from shading_atlas_bench.reports.store.database import StoreError
from shading_atlas_bench.reports.store.results import Store
from tests.harness.commands import BAD, ROOT, bench
from tests.reports.synthetic import alter

GRID = [
    "--method", "sas", "--method", "ppll", "--size", "160x90", "--frames", "2", "--atlas", "128x128",
    "--vary", "atlas=128,256", "--vary", "fit=0.5,0.9",
]  # fmt: skip
QUICK = ["--repetitions", "6", "--precision", "100", "--budget", "60"]
VARYING = {f"server_ms_{part}" for part in ("median", "low", "high", "mean", "max")}
VARYING |= {"repetitions", "stop", "pareto_time"}


def rows_of(folder: Path) -> list[dict[str, str]]:
    with open(folder / "sweep.csv", newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def lasting(folder: Path) -> list[dict[str, str]]:
    return [{name: value for name, value in row.items() if name not in VARYING} for row in rows_of(folder)]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished sweep of five cells."""
    folder = tmp_path_factory.mktemp("sweep") / "out"
    done = bench("sweep", *GRID, *QUICK, "--out", str(folder))
    assert done.returncode == 0, done.stdout + done.stderr
    assert max(map(len, done.stdout.splitlines())) <= 80
    assert "No clear winner" in done.stdout
    return folder


def test_the_documents_print_what_sweep_csv_says(whole: Path):
    rows = {(row["method"], row["varied"], row["coding"]): row for row in rows_of(whole)}
    parts = sweep_parts([whole])
    assert len(parts["cells"]) == len(rows) / 2
    for cell in parts["cells"]:
        displayed, lossless = (rows[cell["method"], cell["varied"], coding] for coding in ("displayed", "lossless"))
        assert cell["flip"] == float(displayed["flip_median"])
        assert cell["flip_lossless"] == float(lossless["flip_median"])
        assert cell["samples"] == float(displayed["samples_median"])
        assert cell["kbytes"] == float(displayed["bytes_total_median"]) / 1000
    assert [(row["coding"], row["machine"]) for row in parts["winners"]].count(("as displayed", True)) == 1
    assert len(parts["winners"]) == 6


def test_every_cell_is_a_row_with_its_times_and_errors(whole: Path):
    rows = rows_of(whole)
    assert list(rows[0]) == [column.name for column in SWEEP_COLUMNS]
    cells = [(row["method"], row["varied"], row["coding"]) for row in rows]
    texts = [f"atlas={atlas} fit={fit}" for atlas in (128, 256) for fit in (0.5, 0.9)]
    expected = [("sas", text) for text in texts] + [("ppll", "")]
    assert sorted(cells) == sorted((*cell, coding) for cell in expected for coding in ("displayed", "lossless"))
    for row in rows:
        assert row["stop"] in ("precise", "repetitions")
        assert row["comparable"] == "yes"
        if row["status"] == "ok":
            assert float(row["server_ms_low"]) <= float(row["server_ms_median"]) <= float(row["server_ms_high"])
            assert 0 < float(row["flip_median"]) < 1
            assert row["flip_low"] == ""  # two frames have no interval
            assert row["pareto_time"] in ("all", "method", "no")
    memory = {row["varied"][:9]: float(row["atlas_mb_median"]) for row in rows if row["method"] == "sas"}
    assert memory == {"atlas=128": pytest.approx(0.065536), "atlas=256": pytest.approx(0.262144)}


def test_the_report_holds_a_figure_and_a_sentence_for_every_choice(whole: Path):
    page = (whole / "report.html").read_text(encoding="utf-8")
    (text,) = re.findall(r'<script type="application/json" id="figures">(.*?)</script>', page, re.DOTALL)
    figures = json.loads(text)["sweep"]
    assert len(figures) == 5 * 4 * 2  # the picture is too small for IW-SSIM
    for key, figure in figures.items():
        assert figure["says"], key
        names = {trace["name"] for trace in figure["data"]}
        assert any(name.startswith("sas") for name in names)
    assert page.index('data-figure="sweep"') < page.index("<table")


def test_the_same_command_again_changes_nothing_and_another_plan_is_refused(whole: Path):
    before = (whole / "sweep.csv").read_text(encoding="utf-8")
    assert bench("sweep", *GRID, *QUICK, "--out", str(whole)).returncode == 0
    assert (whole / "sweep.csv").read_text(encoding="utf-8") == before
    done = bench("sweep", *GRID, *QUICK, "--latency", "20", "--out", str(whole))
    assert done.returncode == 2
    assert "latency" in done.stderr
    (whole / "sweep.csv").unlink()
    assert bench("report", str(whole)).returncode == 0
    assert (whole / "sweep.csv").read_text(encoding="utf-8") == before


def test_a_sweep_is_bound_to_all_that_its_scenes_are_drawn_from(whole: Path):
    with Store(whole, must_exist=True) as store:
        plan = store.plan()
    assert plan is not None
    hashes = workload_hashes(Settings(frames=2))
    assert plan["scenes"] == {"hall": hashes}
    with Store(next((whole / "cells").iterdir()), must_exist=True) as store:
        of_cell = store.plan()
    assert of_cell is not None
    assert hashes.items() <= of_cell.items()


def test_a_killed_sweep_resumes_and_ends_with_the_same_rows(whole: Path, tmp_path: Path):
    folder = tmp_path / "out"
    command = [sys.executable, "-m", "shading_atlas_bench", "sweep", *GRID, *QUICK, "--out", str(folder)]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    until = time.monotonic() + 200
    while len(list(folder.glob("cells/*"))) < 2 and time.monotonic() < until and process.poll() is None:
        time.sleep(0)
    process.kill()
    process.wait()
    assert not (folder / "sweep.csv").exists()
    assert bench("report", str(folder)).returncode == 0
    assert "unfinished" in {row["status"] for row in rows_of(folder)}
    assert bench("sweep", *GRID, *QUICK, "--out", str(folder)).returncode == 0
    assert lasting(folder) == lasting(whole)


def test_workers_measure_the_same_quality_and_no_time(whole: Path, tmp_path: Path):
    folder = tmp_path / "out"
    done = bench("sweep", *GRID, "--workers", "2", "--out", str(folder))
    assert done.returncode == 0, done.stderr
    rows = rows_of(folder)
    assert {(row["comparable"], row["stop"], row["pareto_time"]) for row in rows} == {("no", "not timed", "")}
    without = [{**row, "comparable": ""} for row in lasting(folder)]
    assert without == [{**row, "comparable": ""} for row in lasting(whole)]
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert 'value="server_ms"' not in page
    assert "do not compare" in page


def test_methods_that_fail_or_hang_are_rows_and_stop_nobody_else(tmp_path: Path):
    folder = tmp_path / "out"
    names = ("Failing", "Spinning", "Pointless", "AbortingAtOnce")
    methods = [argument for name in names for argument in ("--method", f"{BAD}:{name}")]
    small = ["--size", "160x90", "--frames", "2", "--atlas", "128x128", "--vary", "fit=0.5", "--codec", "none"]
    done = bench("sweep", *methods, "--method", "sas", *small, "--workers", "2", "--timeout", "3", "--out", str(folder))
    assert done.returncode == 1, done.stderr
    rows = {row["method"]: row for row in rows_of(folder)}
    statuses = {name: row["status"] for name, row in rows.items()}
    broken = {"failing": "failed", "spinning": "timeout", "aborting-at-once": "failed"}
    assert statuses == broken | {"pointless": "skipped", "sas": "ok"}
    assert all(row["flip_median"] == row["server_ms_median"] == "" for row in rows.values() if row["status"] != "ok")
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "one too many" in page


def test_a_method_in_two_settings_competes_with_itself(tmp_path: Path):
    folder = tmp_path / "out"
    methods = ["--method", "sas@published", "--method", "sas"]
    small = ["--size", "160x90", "--frames", "2", "--atlas", "256x256", "--codec", "none", "--vary", "samples=1,2"]
    done = bench("sweep", *methods, *small, "--repetitions", "1", "--out", str(folder))
    assert done.returncode == 0, done.stdout + done.stderr
    fronts = {line.split()[0] for line in done.stdout.splitlines() if " samples=" in line}
    assert fronts == {"sas", "sas@published"}
    cells = {(row["contender"], row["varied"]): row for row in rows_of(folder)}
    assert list(cells) == [(name, f"samples={n}") for name in ("sas@published", "sas") for n in (1, 2)]
    assert {row["method"] for row in cells.values()} == {"sas"}
    for contender in ("sas", "sas@published"):
        own = [row["pareto_samples"] for (name, _), row in cells.items() if name == contender]
        assert set(own) & {"method", "all"}, contender
    page = (folder / "report.html").read_text(encoding="utf-8")
    (text,) = re.findall(r'<script type="application/json" id="figures">(.*?)</script>', page, re.DOTALL)
    traces = json.loads(text)["sweep"]["flip/samples/lossless/"]["data"]
    assert {trace["name"]: trace["marker"]["color"] for trace in traces if trace["mode"] == "markers"}.keys() == {
        "sas", "sas@published"
    }  # fmt: skip
    assert len({trace["line"]["color"] for trace in traces if trace["mode"] == "lines"}) == 2
    assert "<td>sas<wbr>@published</td>" in page
    assert "Only sas has points here" not in done.stdout + page


def test_another_device_does_not_go_on_with_a_sweep(whole: Path, tmp_path: Path):
    folder = tmp_path / "out"
    shutil.copytree(whole, folder)
    with Store(folder) as store:
        plan = store.plan()
    assert plan is not None
    other = json.dumps(plan | {"device": "another"}, sort_keys=True)
    alter(folder, "UPDATE plan SET content = ?", other)
    done = bench("sweep", *GRID, *QUICK, "--out", str(folder))
    assert done.returncode == 2
    assert 'device was "another"' in done.stderr


@pytest.mark.parametrize("content", ["{}", "[]", '{"cells": [{}]}', '{"cells": "ab"}', '{"cells": [', ""])
def test_a_damaged_sweep_is_one_sentence(content: str, tmp_path: Path):
    Store(tmp_path).close()
    (tmp_path / "sweep.json").write_text(content, encoding="utf-8")
    shown = CliRunner().invoke(app, ["report", str(tmp_path)])
    assert (shown.exit_code, type(shown.exception)) == (2, SystemExit), shown.output
    assert "has no readable sweep.json" in " ".join(shown.output.split())


def test_a_dry_run_prints_the_grid_and_runs_nothing(tmp_path: Path):
    done = bench("sweep", *GRID, "--dry-run", "--out", str(tmp_path / "out"))
    assert done.returncode == 0, done.stderr
    assert "5 cells" in done.stdout
    assert "run once for this axis" in done.stdout
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--vary", "shadingrate=1"], "Did you mean 'shading_rate'?"),
        (["--precision", "0"], "--precision"),
        (["--workers", "0"], "--workers"),
        (["--repetitions", "0"], "--repetitions"),
        (["--vary", "scene=hell"], "hall"),
    ],
)
def test_unusable_arguments_are_one_sentence_and_exit_2(arguments: list[str], says: str, tmp_path: Path):
    done = bench("sweep", *arguments, "--out", str(tmp_path / "out"))
    assert done.returncode == 2, done.stdout
    assert says in done.stderr
    assert "Traceback" not in done.stderr


def _swapped(content: dict[str, Any]) -> None:
    """Two cells of one method in each other's folders."""
    one, other = (cell for cell in content["cells"] if cell["method"] == "sas" and cell["varied"]["fit"] == "0.5")
    one["folder"], other["folder"] = other["folder"], one["folder"]


EDITS: dict[str, Callable[[dict[str, Any]], object]] = {
    "folders swapped": _swapped,
    "a cell twice": lambda content: content["cells"].append(content["cells"][0]),
    "a cell less": lambda content: content["cells"].pop(),
    "other frames": lambda content: content.update(frames=9),
    "another setting": lambda content: content["cells"][0]["settings"].update(fov=61),
    "another variant": lambda content: content["cells"][0].update(variant=content["cells"][1]["variant"]),
    "another label": lambda content: content["cells"][0]["varied"].update(atlas="512"),
    "another contender": lambda content: content["cells"][0].update(contender="tss"),
    "another condition": lambda content: content["cells"][0].update(condition="fov 90"),
    "another coding": lambda content: content["cells"][0]["codings"].update(displayed=["none", None]),
    "times that can be compared": lambda content: content.update(timed=False),
}
OF_PLANS = ("folders swapped", "a cell twice", "other frames", "another setting")


@pytest.mark.parametrize("edit", EDITS)
def test_an_edited_sweep_is_refused(edit: str, whole: Path, tmp_path: Path):
    """Also one of an earlier version, whose plan has no hash of the grid, where the runs say otherwise."""
    folder = tmp_path / "out"
    shutil.copytree(whole, folder)
    content = json.loads((folder / "sweep.json").read_text(encoding="utf-8"))
    EDITS[edit](content)
    (folder / "sweep.json").write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(StoreError, match=r"sweep\.json"):
        read_points(folder)
    if edit in OF_PLANS:
        with Store(folder) as store:
            plan = store.plan()
        assert plan is not None
        del plan["grid"]
        alter(folder, "UPDATE plan SET content = ?", json.dumps(plan, sort_keys=True))
        with pytest.raises(StoreError, match=r"sweep\.json"):
            read_points(folder)


def test_folders_of_cells_that_were_renamed_are_refused(whole: Path, tmp_path: Path):
    folder = tmp_path / "out"
    shutil.copytree(whole, folder)
    one, other = sorted((folder / "cells").iterdir())[:2]
    one.rename(folder / "aside")
    other.rename(one)
    (folder / "aside").rename(other)
    with pytest.raises(StoreError, match=r"sweep\.json says that .* has the atlas_width \d+ in .*, whose run has \d+"):
        read_points(folder)


def test_a_cell_whose_store_was_being_made_is_not_measured(whole: Path, tmp_path: Path):
    """As a kill leaves it: an empty file."""
    folder = tmp_path / "out"
    shutil.copytree(whole, folder)
    one, *_ = sorted((folder / "cells").iterdir())
    (one / "results.sqlite").write_bytes(b"")
    assert {point.row["status"] for point in read_points(folder)} == {"ok", "unfinished"}
