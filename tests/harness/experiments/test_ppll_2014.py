"""The thesis' own experiment, small: its tables and figures come out, with the published numbers beside ours."""

from __future__ import annotations

import csv

import pytest
from typer.testing import CliRunner

from shading_atlas_bench.harness.cli.main import app
from shading_atlas_bench.harness.errors import InputError
from shading_atlas_bench.harness.experiments import ppll_2014
from shading_atlas_bench.harness.experiments.claims import NamedRun, _hashes_of
from shading_atlas_bench.harness.experiments.ppll_2014 import (
    PUBLISHED_SIZES,
    Experiment,
    experiment_of,
    run_experiment,
)
from shading_atlas_bench.harness.workload.settings import SettingsError


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    """The files of an experiment with one model, which is the shells because the real one is not there."""
    folder = tmp_path_factory.mktemp("ppll-2014")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("BENCH_SCENES", str(folder / "none"))
        patch.setattr(ppll_2014, "MODELS", {"bunny": "bunny/bunny.ply"})
        patch.setattr(ppll_2014, "MOST_LAYERS", 8)
        run_experiment(Experiment(3, ((160, 120),)), folder)
    names = ("frames", "layers", "table_a1", "table_a2")
    read = {
        name: [*csv.DictReader((folder / f"{name}.csv").read_text(encoding="utf-8").splitlines())] for name in names
    }
    return read | {"html": (folder / "report.html").read_text(encoding="utf-8")}


def test_every_mode_is_in_both_tables(tables):
    modes = ["depth-limited", "difference", "bilateral"]
    assert [row["mode"] for row in tables["table_a1"]] == [row["mode"] for row in tables["table_a2"]] == modes
    assert len(tables["frames"]) == 9
    for row in tables["table_a1"]:
        assert 0 < float(row["lz4_kib"]) < float(row["uncompressed_kib"]) < float(row["padded_kib"])
        assert row["ratio_published"] == ""  # not one of the thesis' sizes
    for row in tables["frames"]:
        header = float(row["raw_bytes"]) - float(row["list_bytes"])
        assert float(row["padded_list_bytes"]) == float(row["padded_bytes"]) - header
        assert 0 < float(row["padded_list_lz4_bytes"]) < float(row["padded_list_bytes"])


def test_what_each_mode_promises(tables):
    limited, difference, bilateral = (float(row["sent_of_built"]) for row in tables["table_a1"])
    assert bilateral < difference <= 1.001
    assert limited < 1
    assert float(tables["table_a1"][1]["bad_pixels"]) == 0


def test_more_layers_leave_fewer_bad_pixels(tables):
    bad = [float(row["bad_pixels"]) for row in tables["layers"]]
    assert bad == sorted(bad, reverse=True)
    assert bad[0] > 0.05 > bad[-1]


def test_the_page_shows_tables_and_figures(tables):
    for title in ("Table A.1", "Table A.2", "Figure 6.1", "Figure 6.2", "Figure A.13", "Figures 6.3"):
        assert title in tables["html"]


def test_the_page_says_what_stands_in_for_a_model(tables, tmp_path, monkeypatch):
    assert "Shells stand in for bunny:" in tables["html"]
    for file in ppll_2014.MODELS.values():
        (tmp_path / file).parent.mkdir()
        (tmp_path / file).touch()
    monkeypatch.setenv("BENCH_SCENES", str(tmp_path))
    assert ppll_2014.stand_ins() == ""


def test_published_ratios_are_those_of_table_a1():
    shares = {key: [round(100 * b / a, 1) for a, b in pairs] for key, pairs in PUBLISHED_SIZES.items()}
    assert shares["depth-limited", "bunny"] == [70.2, 63.9, 63.7]
    assert shares["difference", "dragon"][1:] == [25.8, 28.0]
    assert shares["bilateral", "buddha"] == [30.6, 41.7, 29.1]


def test_options_of_the_preset():
    assert experiment_of({"size": "64x48", "frames": 2}) == Experiment(2, ((64, 48),))
    assert experiment_of({}).sizes == ((1024, 768), (1280, 720), (1600, 900))
    assert experiment_of({"preset": "ppll-2014", "device": "pthread"}) == Experiment(device="pthread")
    for options, says in (
        ({"frames": 0}, "--frames is 0"),
        ({"frames": 10**20}, "give 1 to 1,000,000"),
        ({"frames": "six"}, r"Expected `int`, got `str` - at `\$\.frames`"),
        ({"size": "8x8"}, "--size is 8x8"),
        ({"size": "640"}, "--size"),
    ):
        with pytest.raises(SettingsError, match=says):
            experiment_of(options)


@pytest.mark.parametrize(
    ("arguments", "refused"),
    [
        (["--atlas", "junk", "--scene", "nowhere.glb", "--crf", "99"], "--scene, --atlas, --crf"),
        (["--config", "x.json"], "--config"),
        (["--explain"], "--explain"),
        (["--opaque", "--dump"], "--opaque, --dump"),
        (["--seed", "0"], "--seed"),
        (["--no-skip", "blending"], "--no-skip"),
    ],
)
def test_what_the_preset_does_not_take_is_refused(arguments, refused):
    takes = "takes --method ppll[...], --frames, --size, --device, --out and --dry-run only, not"
    assert f"{takes} {refused}." in refusal(*arguments)


@pytest.mark.parametrize(
    "methods", [["sas"], ["all"], ["ppll", "sas"], ["ppll[mode=full]"], ["ppll[layers=2]"], ["ppll[preblend=true]"]]
)
def test_another_method_or_parameter_is_refused(methods):
    assert "takes one --method ppll[...], without mode, layers, layout, preblend." in refusal(
        *(word for method in methods for word in ("--method", method))
    )


def test_a_file_is_no_folder_for_results(tmp_path):
    out = tmp_path / "file.txt"
    out.write_text("years of work", encoding="utf-8")
    small = ("--frames", "1", "--size", "64x64")
    assert f"{out} is a file" in refusal(*small, "--out", str(out))
    assert f"{out}/below cannot be made" in refusal(*small, "--out", str(out / "below"))
    assert out.read_text(encoding="utf-8") == "years of work"


def test_a_sweep_refuses_the_preset():
    assert "only bench run takes it" in refusal(command="sweep")


def test_a_parameter_out_of_range_is_refused(tmp_path, monkeypatch):
    monkeypatch.setenv("BENCH_SCENES", str(tmp_path))
    with pytest.raises(InputError, match="tolerance must not be negative"):
        run_experiment(Experiment(1, ((160, 120),), parameters={"tolerance": -1}), tmp_path / "out")


def refusal(*arguments, command="run"):
    """What is printed where options beside the preset are refused: one sentence on one line."""
    shown = CliRunner().invoke(app, [command, "--preset", "ppll-2014", *arguments])
    assert (shown.exit_code, type(shown.exception)) == (2, SystemExit), shown.output
    assert len(shown.output.splitlines()) == 1
    return shown.output


def test_a_dry_run_says_what_would_be_measured(tmp_path):
    out = tmp_path / "out"
    shown = CliRunner().invoke(app, ["run", "--preset", "ppll-2014", "--frames", "2", "--dry-run", "--out", str(out)])
    assert shown.exit_code == 0
    assert "54 frames" in shown.output
    assert "1600x900" in shown.output
    assert not out.exists()


def test_parameters_of_lists_hold_for_all_modes(tables, tmp_path, monkeypatch):
    monkeypatch.setenv("BENCH_SCENES", str(tmp_path))
    monkeypatch.setattr(ppll_2014, "MODELS", {"bunny": "bunny/bunny.ply"})
    monkeypatch.setattr(ppll_2014, "MOST_LAYERS", 1)
    wanted = experiment_of({"size": "160x120", "frames": 3, "method": ["ppll[tolerance=64]"]})
    assert wanted.parameters == {"tolerance": 64}
    run_experiment(wanted, tmp_path / "out")
    rows = [*csv.DictReader((tmp_path / "out" / "frames.csv").read_text(encoding="utf-8").splitlines())]
    sent, before = (
        [int(row["fragments_sent"]) for row in found if row["mode"] == "difference"]
        for found in (rows, tables["frames"])
    )
    assert sent[0] == before[0]
    assert sum(sent[1:]) < sum(before[1:])


def test_another_model_is_another_experiment(monkeypatch, tmp_path):
    """Its hashes are among what `bench claims` compares before it takes results that are there."""
    monkeypatch.setenv("BENCH_SCENES", str(tmp_path))
    monkeypatch.setattr(ppll_2014, "MODELS", {"bunny": "bunny/bunny.ply"})
    named = NamedRun("lists", {"preset": "ppll-2014"}, ())
    found = [_hashes_of(named)]
    file = tmp_path / "bunny" / "bunny.obj"
    monkeypatch.setattr(ppll_2014, "MODELS", {"bunny": "bunny/bunny.obj"})
    file.parent.mkdir()
    for size in (1, 2):
        file.write_text(f"v 0 0 0\nv {size} 0 0\nv 0 {size} {size}\nf 1 2 3\n", encoding="utf-8")
        found.append(_hashes_of(named))
    assert len({hashes["bunny"] for hashes in found}) == 3
