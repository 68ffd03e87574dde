"""`bench claims` as a user meets it: whole, again, quick, reusing, failing, refused, stopped."""

import csv
import json
import re
import shutil
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest

from shading_atlas_bench.harness.errors import InputError
from shading_atlas_bench.harness.experiments.claims import WORKLOAD, ClaimsRequest, needs, variants_of
from shading_atlas_bench.harness.workload.session import workload_hashes
from shading_atlas_bench.harness.workload.settings import Settings
from shading_atlas_bench.reports.analysis.claims import DEFAULT_FILE, FEWEST
from shading_atlas_bench.reports.store.results import Store
from tests.harness.commands import bench
from tests.reports.synthetic import alter
from tests.scenes.test_load_files import box

TINY = """
[papers]
book = "A book"
[quick]
frames = 2
[runs.tiny]
method = ["sas", "sas[fit=0.5]", "ppll"]
scene = "hall"
frames = 6
size = "160x90"
atlas = "128x128"
crf = "25"
[runs.elsewhere]
method = ["sas"]
scene = "no/such/scene.glb"
frames = 6
[[claims]]
id = "more-samples"
paper = "book"
source = "table 1"
methods = ["sas", "ppll"]
kind = "ordering"
claim = "Lists take more samples than an atlas."
published = "more"
why = "It is a test."
runs = ["tiny"]
measure = { value = "samples", method = "ppll", over = { method = "sas" } }
rule = { above = 1 }
[[claims]]
id = "no-error"
paper = "book"
source = "table 2"
methods = ["sas"]
kind = "absolute"
claim = "There is no error."
published = "0"
why = "It is a test."
runs = ["tiny", "elsewhere"]
measure = { value = "flip", method = "sas", crf = 25 }
rule = { below = 0.0001 }
[[causes]]
id = "the-atlas"
claims = ["no-error"]
places = ["tiny"]
cause = "It is the atlas."
test = "a method without one"
measure = { value = "flip", method = "ppll" }
"""


def rows_of(folder: Path) -> list[list[str]]:
    with open(folder / "claims.csv", newline="", encoding="utf-8") as file:
        return [[row[name] for name in ("id", "run", "verdict")] for row in csv.DictReader(file)]


@pytest.fixture(scope="module")
def claims(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("claims") / "tiny.toml"
    file.write_text(TINY, encoding="utf-8")
    return file


@pytest.fixture(scope="module")
def whole(claims: Path) -> Path:
    """The finished measurement of one claim."""
    folder = claims.parent / "out"
    done = bench("claims", "--file", str(claims), "--id", "more-samples", "--out", str(folder))
    assert done.returncode == 0, done.stdout + done.stderr
    assert max(len(line) for line in done.stdout.splitlines() if str(folder) not in line) <= 80
    assert "1 confirmed" in done.stdout
    return folder


def test_a_claim_is_measured_once_and_its_page_needs_nothing_else(whole: Path, claims: Path):
    assert rows_of(whole) == [["more-samples", "tiny", "confirmed"]]
    page = (whole / "claims.html").read_text(encoding="utf-8")
    assert "Lists take more samples than an atlas." in page
    words = re.sub(r"<[^>]+>", "", page)
    assert "bench run --method sas --method ppll --scene hall" in words, "only the methods that the claim needs"
    assert "http" not in page
    before = (whole / "tiny" / "results.sqlite").stat().st_mtime_ns
    (whole / "claims.csv").unlink()
    done = bench("report", str(whole))
    assert done.returncode == 0, done.stderr
    again = bench("claims", "--file", str(claims), "--id", "more-samples", "--out", str(whole))
    assert again.returncode == 0, again.stderr
    assert "Run 1" not in again.stderr
    assert rows_of(whole) == [["more-samples", "tiny", "confirmed"]]
    assert (whole / "tiny" / "results.sqlite").stat().st_mtime_ns == before


@pytest.mark.parametrize("name", ["scene_hash", "drawn_hash", "path_hash"])
def test_a_run_of_a_scene_or_path_that_was_edited_since_is_not_reused(
    name: str, whole: Path, claims: Path, tmp_path: Path
):
    shutil.copytree(whole / "tiny", tmp_path / "tiny")
    with Store(tmp_path / "tiny") as store:
        plan = store.plan()
    assert plan is not None
    plan |= {name: "another"}
    alter(tmp_path / "tiny", "UPDATE plan SET content = ?", json.dumps(plan, sort_keys=True))
    done = bench("claims", "--file", str(claims), "--reuse", str(tmp_path / "tiny"), "--out", str(tmp_path / "out"))
    assert done.returncode == 2
    assert "another scene or path of the same name" in " ".join(done.stderr.split())


def test_runs_are_reused_and_a_run_that_cannot_be_made_is_a_row_with_its_reason(whole: Path, claims: Path):
    folder = claims.parent / "reusing"
    done = bench("claims", "--file", str(claims), "--reuse", str(whole / "tiny"), "--out", str(folder))
    assert done.returncode == 1, done.stdout + done.stderr
    assert rows_of(folder) == [
        ["more-samples", "tiny", "confirmed"],
        ["no-error", "tiny", "not confirmed"],
        ["no-error", "elsewhere", "not measured"],
    ]
    assert "no/such/scene.glb" in (folder / "claims.csv").read_text(encoding="utf-8")
    assert not (folder / "tiny").exists()
    with open(folder / "causes.csv", newline="", encoding="utf-8") as file:
        (cause,) = csv.DictReader(file)
    assert [cause[name] for name in ("id", "claim", "run", "verdict")] == [
        "the-atlas",
        "no-error",
        "tiny",
        "refuted",
    ]
    assert "the-atlas? refuted" in done.stdout
    assert "It is the atlas." in (folder / "claims.html").read_text(encoding="utf-8")
    state = json.loads((folder / "claims.json").read_text(encoding="utf-8"))
    assert state["runs"]["tiny"]["reused"]
    of_claims = claims.parent / "of_claims"
    options = ["--id", "more-samples", "--reuse", str(whole), "--out", str(of_claims)]
    assert bench("claims", "--file", str(claims), *options).returncode == 0


def _elsewhere(run: dict[str, Any]) -> None:
    run["folder"] = "elsewhere"


def _reused(run: dict[str, Any]) -> None:
    run |= {"folder": "elsewhere", "reused": True}


@pytest.mark.parametrize("edit", [_elsewhere, _reused, None], ids=["folder", "reused", "results"])
def test_another_runs_results_are_not_taken_for_those_of_a_claim(
    edit: Callable[[dict[str, Any]], None] | None, whole: Path, claims: Path, tmp_path: Path
):
    """Whether claims.json names another run's folder, or another run was put into its folder."""
    folder = tmp_path / "out"
    shutil.copytree(whole, folder)
    with Store(whole / "tiny") as store:
        plan = store.plan()
    assert plan is not None
    settings = plan["settings"]
    assert isinstance(settings, dict)
    other = folder / ("elsewhere" if edit else "tiny")
    shutil.copytree(whole / "tiny", other, dirs_exist_ok=True)
    alter(other, "UPDATE plan SET content = ?", json.dumps(plan | {"settings": settings | {"frames": 7}}))
    if edit:
        state = json.loads((folder / "claims.json").read_text(encoding="utf-8"))
        edit(state["runs"]["tiny"])
        (folder / "claims.json").write_text(json.dumps(state), encoding="utf-8")
    done = bench("report", str(folder))
    assert (done.returncode, done.stdout) == (2, "")
    assert "the run tiny is in" in " ".join(done.stderr.split())
    if edit:
        again = bench("claims", "--file", str(claims), "--id", "more-samples", "--out", str(folder))
        assert again.returncode == 0, again.stderr
        assert rows_of(folder) == [["more-samples", "tiny", "confirmed"]]


def test_results_of_other_settings_are_not_reused(whole: Path, claims: Path):
    other = claims.parent / "other"
    changes = {"frames = 6\nsize": "frames = 7\nsize", 'size = "160x90"': 'size = "176x96"', '"hall"': '"village"'}
    for old, new in changes.items():
        (claims.parent / "changed.toml").write_text(TINY.replace(old, new, 1), encoding="utf-8")
        arguments = ["--file", str(claims.parent / "changed.toml"), "--id", "more-samples", "--out", str(other)]
        done = bench("claims", *arguments, "--reuse", str(whole / "tiny"))
        assert done.returncode == 2, done.stdout
        assert "no run that these claims need" in done.stderr


def test_a_dry_run_says_what_it_takes_and_runs_nothing(claims: Path):
    folder = claims.parent / "dry"
    done = bench("claims", "--file", str(claims), "--quick", "--dry-run", "--out", str(folder))
    assert done.returncode == 0, done.stderr
    assert max(map(len, done.stdout.splitlines())) <= 80
    assert "--frames 2" in " ".join(done.stdout.split())
    assert "no/such/scene.glb" in done.stdout
    assert not folder.exists()


def test_what_was_left_by_a_stop_is_kept_and_said(whole: Path, claims: Path):
    """As a kill leaves it: frames are committed, but the run is not marked as made."""
    folder = claims.parent / "stopped"
    shutil.copytree(whole, folder)
    state = json.loads((folder / "claims.json").read_text(encoding="utf-8"))
    state["runs"]["tiny"] |= {"problem": "It has not been run yet: the same command goes on.", "made": None}
    (folder / "claims.json").write_text(json.dumps(state), encoding="utf-8")
    assert bench("report", str(folder)).returncode == 0
    assert rows_of(folder) == [["more-samples", "tiny", "not measured"]]
    done = bench("claims", "--file", str(claims), "--id", "more-samples", "--out", str(folder))
    assert done.returncode == 0, done.stderr
    assert rows_of(folder) == [["more-samples", "tiny", "confirmed"]]
    assert (folder / "tiny" / "frames.csv").read_text(encoding="utf-8") == (whole / "tiny" / "frames.csv").read_text(
        encoding="utf-8"
    )


def test_the_runs_of_the_suite_are_ones_that_bench_run_takes():
    for quick in (False, True):
        claims, runs = needs(ClaimsRequest(quick=quick))
        assert {run.name for run in runs} == set(claims.runs)
        frames = [run.options["frames"] for run in runs]
        assert min(frames) >= FEWEST, "enough for an interval"
        coded = [run.options["frames"] for run in runs if "crf" in run.options]
        assert min(coded) > FEWEST, "and without the keyframe"
        variants = variants_of(claims)
        assert len(set(variants.values())) == len(variants)
    assert any("--crf 5,25,35" in run.command for run in runs)


def test_options_that_the_thesis_experiment_does_not_take_are_refused(tmp_path: Path):
    text, run = DEFAULT_FILE.read_text(encoding="utf-8"), "[runs.thesis]\n"
    assert text.count(run) == 1
    file = tmp_path / "thesis.toml"
    file.write_text(text.replace(run, f'{run}atlas = "64x64"\nseize = "64x64"\n'), encoding="utf-8")
    with pytest.raises(InputError, match=r"--size, --device, --out and --dry-run only, not --atlas, --seize\."):
        needs(ClaimsRequest(("bilateral-grows",), file=file))


def test_claims_do_not_allow_what_only_their_user_may(tmp_path: Path):
    file = tmp_path / "claims.toml"
    file.write_text(TINY, encoding="utf-8")
    _, runs = needs(ClaimsRequest(file=file, allow_outside=True))
    assert all(run.settings().allow_outside for run in runs if run.name == "tiny")
    file.write_text(TINY.replace("[runs.tiny]\n", "[runs.tiny]\nallow_outside = true\n"), encoding="utf-8")
    with pytest.raises(InputError, match=r"The run tiny of .* allows files outside"):
        needs(ClaimsRequest(file=file))


def test_damaged_states_are_one_sentence(whole: Path, claims: Path):
    folder = claims.parent / "damaged"
    folder.mkdir()
    state = (whole / "claims.json").read_text(encoding="utf-8")
    for text in (state[: len(state) // 2], "{}"):
        (folder / "claims.json").write_text(text, encoding="utf-8")
        for arguments in (["claims", "--file", str(claims), "--out", str(folder)], ["report", str(folder)]):
            done = bench(*arguments)
            assert done.returncode == 2, (arguments, done.stdout)
            assert f"{folder} has no readable claims.json" in done.stderr
            assert len(done.stderr.splitlines()) == 1


def test_what_cannot_be_used_is_one_sentence(whole: Path, claims: Path):
    misspelt = claims.parent / "misspelt.toml"
    misspelt.write_text(TINY.replace('size = "160x90"', 'seize = "160x90"'), encoding="utf-8")
    for arguments in (
        ["--id", "more-smaples"],
        ["--out", str(whole / "tiny")],
        ["--out", str(claims)],
        ["--file", str(claims.parent / "absent.toml")],
        ["--file", str(misspelt)],
    ):
        done = bench("claims", "--file", str(claims), *arguments)
        assert done.returncode == 2, (arguments, done.stdout)
        assert done.stderr.startswith("bench: ")
        assert len(done.stderr.splitlines()) == 1


def test_runs_of_one_workload_are_told_by_all_settings_that_its_hashes_read(tmp_path: Path) -> None:
    """Two claims' runs that differ in a setting left out of WORKLOAD would be taken for runs of one scene and path."""
    read: set[str] = set()

    class Noting(Settings):
        def __getattribute__(self, name: str) -> object:
            read.add(name)
            return super().__getattribute__(name)

    (tmp_path / "mine.obj").write_text(box(6, inwards=False), encoding="utf-8")
    made = [Noting(scene=scene, frames=2) for scene in ("hall", str(tmp_path / "mine.obj"))]
    read.clear()  # of what making them read
    for settings in made:
        workload_hashes(settings)
    assert read & {field.name for field in fields(Settings)} == set(WORKLOAD)
