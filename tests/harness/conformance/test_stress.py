"""The stress test: its catalogue, what a trial notices, and a run that resumes."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from shading_atlas_bench.harness.cli.main import app
from shading_atlas_bench.harness.conformance.catalogue import CATALOGUE, facing, room, scattered, scene_of, walk
from shading_atlas_bench.harness.conformance.stress import Contender, Log, StressRun, _folder_for
from shading_atlas_bench.harness.conformance.trial import Stage, TrialCase, TrialResult, try_method, try_rasteriser
from shading_atlas_bench.harness.errors import InputError
from shading_atlas_bench.harness.measure.exact import draw_exact
from shading_atlas_bench.harness.watch.watchdog import time_limit
from shading_atlas_bench.packers.example.grid import Grid
from shading_atlas_bench.reports.pages.stress import magnitude, matrix
from shading_atlas_bench.scenes.model import SceneError
from shading_atlas_bench.scenes.paths import PathError
from tests.harness import faulty_packers as faulty
from tests.harness.commands import BAD, bench

FAULTY = Path(faulty.__file__)


@pytest.fixture(scope="module")
def stage(device) -> Stage:
    """Two frames of a small room."""
    scene = scene_of(room()[::3])
    return Stage.of(device, TrialCase(scene, walk(scene), size=(96, 54), atlas=(128, 128)))


def test_the_catalogue_holds_what_a_test_needs():
    assert len(CATALOGUE) >= 35
    for test in CATALOGUE.values():
        assert len(test.magnitudes) >= 6, test.name
        assert len(set(test.magnitudes)) == len(test.magnitudes)


@pytest.mark.parametrize("name", CATALOGUE)
def test_every_test_makes_a_case_at_both_ends(name):
    for value in (CATALOGUE[name].magnitudes[0], CATALOGUE[name].magnitudes[-1]):
        try:
            case = CATALOGUE[name].make(value)
        except (SceneError, PathError):
            assert CATALOGUE[name].refusable
            continue
        assert np.isfinite(case.scene.positions).all()
        assert all(np.isfinite(pose.position).all() for pose in case.poses)


def test_a_sound_packer_passes(stage):
    found = try_method(stage, Grid)
    assert (found.status, found.sentence) == ("ok", "")
    assert found.error is not None
    assert 0 < found.error < 0.1
    assert found.wrong == found.holes == 0


@pytest.mark.parametrize(
    ("packer", "status", "words"),
    [
        (faulty.WrongTexel, "invalid", ["Frame 0: 1 texels differ by up to 128 levels", "of triangle"]),
        (faulty.UnwrittenTexel, "invalid", ["touch 1 texels that were not written", "triangles ", "texels ("]),
        (faulty.Unsteady, "nondeterministic", ["packed a second time: other bytes in the blob noise"]),
        (faulty.NotANumber, "invalid", ["the statistic 'waste' is nan, and no finite number"]),
        (faulty.Elsewhere, "invalid", ["find another surface", "First: triangles 0, 1"]),
    ],
)
def test_a_planted_fault_is_named(stage, packer, status, words):
    found = try_method(stage, packer)
    assert found.status == status
    assert all(word in found.sentence for word in words), found.sentence


def test_a_hang_ends_in_a_sentence(stage):
    with time_limit(0.2, "hanging"):
        found = try_method(stage, faulty.Hanging)
    assert (found.status, found.sentence) == ("timeout", "it took longer than 0.2 s.")


def test_an_atlas_too_small_must_be_explained(device):
    scene = scene_of(facing(scattered(200, 2.0), 0.2))
    stage = Stage.of(device, TrialCase(scene, walk(scene, 1), size=(96, 54), atlas=(12, 12)))
    assert "there are more triangles than texels" in try_method(stage, Grid).sentence
    found = try_method(stage, faulty.Silent)
    assert found.status == "invalid"
    assert "have no place and are not listed" in found.sentence


def test_the_rasteriser_is_judged_by_float64(stage):
    assert try_rasteriser(stage).status == "ok"
    wrong = stage.last.triangle.copy()
    row, column = np.argwhere(wrong >= 0)[len(wrong)]
    wrong[row, column] = (wrong[row, column] + 7) % stage.server.triangles.count
    assert stage.last.wrong(wrong).sum() == 1
    assert stage.last.holes(np.zeros(wrong.shape, bool)).mean() > 0.3


def test_the_float64_picture_is_the_reference_but_for_rounding(stage):
    view, eye = stage.views[-1], stage.frames[-1].server.eye
    rgb = stage.forward.draw(view, eye)[0].rgb.get()[..., :3].astype(int)
    same = draw_exact(stage.server, view, eye)
    off = np.abs(rgb - same.rgb).max(axis=2)
    inside = np.ones_like(off, bool)
    for axis in (0, 1):
        for step in (1, -1):
            inside &= same.triangle == np.roll(same.triangle, step, axis)
    assert off[inside].max() <= 2
    assert inside.mean() > 0.4


def run(*arguments: str):
    return CliRunner().invoke(app, ["stress", *arguments])


def test_a_run_reports_and_resumes(tmp_path):
    out = tmp_path / "out"
    arguments = ["--method", f"{FAULTY}:Crashing", "--quick", "--out", str(out)]
    result = run(*arguments, "--test", "empty-frames")
    assert result.exit_code == 1
    assert "failed" in result.stdout
    assert "there is no first triangle" in " ".join(result.stdout.split())
    assert max(len(line) for line in result.stdout.splitlines()) <= 80 or str(out) in result.stdout
    rows = list(csv.DictReader((out / "stress.csv").read_text(encoding="utf-8").splitlines()))
    assert {(row["method"], row["passed"]) for row in rows} == {("raster", "1"), ("crashing", "0")}
    page = (out / "stress.html").read_text(encoding="utf-8")
    assert "there is no first triangle" in page
    log = out / "stress.jsonl"
    lines = log.read_text(encoding="utf-8").splitlines()
    log.write_text("\n".join([*lines[:3], lines[3][: len(lines[3]) // 2]]), encoding="utf-8")  # killed while writing
    assert run(*arguments, "--test", "empty-frames").exit_code == 1
    again = [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines()[1:]]
    first = [json.loads(line) for line in lines[1:]]
    assert [row | {"seconds": 0} for row in again] == [row | {"seconds": 0} for row in first]
    refused = run(*arguments, "--test", "fan")
    assert refused.exit_code == 2


@pytest.mark.parametrize("begun", ["", '{"tests": ["empty-fr', "[]\n", "\xff\xfe\n"])
def test_a_log_that_does_not_say_what_it_is_of_is_refused(begun, tmp_path, monkeypatch):
    """A kill may have cut off its first line. Another command passes such a log over."""
    monkeypatch.chdir(tmp_path)
    for folder in (Path("out"), Path("runs/20200101-000000-stress")):
        folder.mkdir(parents=True)
        (folder / "stress.jsonl").write_text(begun, encoding="latin-1")
    arguments = ["--method", f"{FAULTY}:Crashing", "--test", "empty-frames", "--quick"]
    refused = run(*arguments, "--out", "out")
    assert (refused.exit_code, type(refused.exception)) == (2, SystemExit), refused.output
    assert "out/stress.jsonl does not begin" in " ".join(refused.output.split())
    assert _folder_for({"device": "A"}) != Path("runs/20200101-000000-stress")


def test_a_trial_that_was_cut_off_is_no_trial(tmp_path):
    """Also where the rest ends as a whole one does."""
    Log.open(tmp_path / "out", {"device": "A"}).add({"step": 0, "facts": {"a": 1}, "more": 2})
    file = tmp_path / "out" / "stress.jsonl"
    file.write_text(file.read_text(encoding="utf-8").partition(', "more"')[0], encoding="utf-8")
    assert Log.open(tmp_path / "out", {"device": "A"}).rows == []
    assert file.read_text(encoding="utf-8") == '{"device": "A"}\n'


def test_crashes_are_trials_that_failed(tmp_path):
    """Also where the first magnitude, which the others are compared with, has no picture."""
    command = ["stress", "--method", f"{BAD}:AbortingAtOnce", "--test", "world-offset", "--quick"]
    done = bench(*command, "--out", str(tmp_path / "out"))
    assert done.returncode == 1, done.stderr
    assert "Traceback" not in done.stderr
    rows = list(csv.DictReader((tmp_path / "out" / "stress.csv").read_text(encoding="utf-8").splitlines()))
    found = {(row["method"], row["status"]) for row in rows}
    assert found == {("raster", "ok"), ("aborting-at-once", "failed")}
    assert all("SIGABRT" in row["reason"] for row in rows if row["status"] == "failed")


def test_without_a_first_picture_nothing_has_drifted(tmp_path):
    row = Contender("m", "", "m", None)
    log = Log.open(tmp_path / "out", {"device": "A"})
    device: Any = None  # nothing is done on it
    stress = StressRun(device, [], [row], log, True, 1.0)
    stress._keep(row, CATALOGUE["world-offset"], 0, TrialResult("failed", "crashed"))
    stress._keep(row, CATALOGUE["world-offset"], 1, TrialResult("ok", error=0.5))
    assert [known["status"] for known in log.rows] == ["failed", "ok"]
    with pytest.raises(InputError, match="other device"):
        Log.open(tmp_path / "out", {"device": "B"})
    assert Log.open(tmp_path / "new", {"device": "A"}).rows == []
    assert Log.open(tmp_path / "new", {"device": "B"}).rows == []  # nothing was done on the first


@pytest.mark.parametrize("arguments", [["--test", "fann"], ["--method", "nobody"]])
def test_unusable_arguments_are_refused(arguments, tmp_path):
    assert run(*arguments, "--out", str(tmp_path / "out")).exit_code == 2


def test_the_matrix_says_how_far_each_came():
    row = {"test": "t", "label": "m", "status": "ok", "reason": None}
    rows = [row | {"step": k, "magnitude": 10.0**k, "passed": int(k != 2)} for k in (3, 0, 1, 2)]
    reach = matrix(rows)["t"]["m"]
    assert reach.broken
    assert (reach.reached, reach.hardest, reach.broken["step"], reach.text) == (10, 1000, 2, "10 !")
    assert matrix([rows[1]])["t"]["m"].text == "1"
    assert [magnitude(x) for x in (1e6, 1e-7, 8192, 0.003, 10_000, 0)] == ["1e6", "1e-7", "8192", "0.003", "1e4", "0"]


def test_a_scene_far_away_stays_the_same(device):
    near, far = (CATALOGUE["world-offset"].make(value) for value in (1.0, 1e7))
    np.testing.assert_allclose(near.scene.positions, far.scene.positions, atol=1e-6)
    both = [Stage.of(device, replace(case, size=(96, 54), poses=case.poses[:1])) for case in (near, far)]
    rgb = [stage.last.rgb.astype(int) for stage in both if stage.last]
    assert np.abs(rgb[0] - rgb[1]).max() <= 1


TOLD = {"label": "tss", "folder": "tss-1a2b", "magnitude": 0.25, "unit": "m", "passed": 0, "step": 5, "variant": "a=1"}


@pytest.mark.parametrize("name", [*TOLD, "twice", "test"])
def test_a_trial_that_contradicts_itself_is_refused(name: str, tmp_path: Path):
    row, test = Contender("raster", "", "raster", None), CATALOGUE["empty-frames"]
    log = Log.open(tmp_path / "out", {"device": "A"})
    device: Any = None  # nothing is done on it
    StressRun(device, [test], [row], log, True, 1.0)._keep(row, test, 0, TrialResult("ok"))
    Log.open(log.folder, {"device": "A"}).check([test], [row])
    edited = log.rows[0] | ({name: TOLD[name]} if name in TOLD else {})
    if name == "twice":
        log.add(edited)
    else:
        (log.folder / "stress.jsonl").write_text(f'{{"device": "A"}}\n{json.dumps(edited)}\n', encoding="utf-8")
    with pytest.raises(InputError, match=r"stress\.jsonl has a trial that was changed, or is there twice"):
        Log.open(log.folder, {"device": "A"}).check([] if name == "test" else [test], [row])
