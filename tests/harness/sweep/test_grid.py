"""The grid of a sweep, its order, and the rule that stops its timing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from shading_atlas_bench.harness.errors import InputError
from shading_atlas_bench.harness.sweep import timing
from shading_atlas_bench.harness.sweep.grid import SweepCell, make_grid, shuffled
from shading_atlas_bench.harness.sweep.run import check_scenes
from shading_atlas_bench.harness.sweep.timing import StopRule, Timed
from shading_atlas_bench.harness.workload.settings import Settings, SettingsError, settings_of

ALL = Settings(methods=("ppll", "sas", "snakebinning"), frames=2)


def of(cells: list[SweepCell], method: str) -> list[SweepCell]:
    return [cell for cell in cells if cell.packer.name == method]


def test_a_parameter_is_varied_only_for_methods_that_have_it():
    grid = make_grid(ALL, ["shading_rate=0.5,0.7,1.0", "atlas=512,1024x256"])
    rates = [vars(cell.packer)["shading_rate"] for cell in of(grid.cells, "snakebinning")]
    assert rates == [0.5, 0.5, 0.7, 0.7, 1.0, 1.0]
    sizes = [(cell.settings.atlas_width, cell.settings.atlas_height) for cell in of(grid.cells, "sas")]
    assert sizes == [(512, 512), (1024, 256)]
    assert len(of(grid.cells, "ppll")) == 1
    assert of(grid.cells, "ppll")[0].varied == {}
    assert {what for what, _ in grid.left_out} == {"sas, shading_rate", "ppll, shading_rate", "ppll, atlas"}


def test_the_work_concerns_methods_without_an_atlas_too():
    grid = make_grid(ALL, ["cell=pvs1,0.2,125,0.08:80,0.3/160", "crf=15"])
    cells = [(cell.settings.cell_radius, cell.settings.cell_fov) for cell in of(grid.cells, "ppll")]
    assert cells == [(0.1, 90), (0.2, 125), (0.08, 80), (0.3, 160)]
    assert {cell.settings.display_crf for cell in of(grid.cells, "sas")} == {15}
    assert len({cell.settings for cell in grid.cells}) == 8
    assert len(set(grid.folders().values())) == 8


def test_equal_cells_run_once_and_repeated_names_add_values():
    grid = make_grid(Settings(methods=("sas",)), ["cell=0.1,90", "cell=pvs1", "cell=0.2,125", "fit=0.75,0.9,0.75"])
    assert len(grid.cells) == 4


def test_without_vary_each_parameter_takes_its_own_values_in_turn():
    cells = make_grid(Settings(methods=("sas",)), []).cells
    parameters = cells[0].packer.parameters
    assert len(cells) == 1 + sum(len(set(p.sweep) - {p.default}) for p in parameters.values())
    assert all(len(cell.varied) <= 1 for cell in cells)
    named = make_grid(Settings(methods=("sas",)), ["fit"]).cells
    assert [vars(cell.packer)["fit"] for cell in named] == list(parameters["fit"].sweep)


def test_fixed_parameters_make_contenders_and_varied_ones_do_not():
    methods = ("sas@published", "sas", "sas[reuse=true]", "sas[reuse=true,fit=0.9]", "ppll")
    by_samples = make_grid(Settings(methods=methods), ["samples=1,8"]).cells
    names = ["sas@published", "sas", "sas[reuse=true]", "sas[fit=0.9,reuse=true]"]
    assert [cell.contender for cell in by_samples] == [name for name in names for _ in range(2)] + ["ppll"]
    by_reuse = make_grid(Settings(methods=methods), ["reuse=true,false", "complete=true,false"]).cells
    assert [cell.contender for cell in by_reuse] == ["sas"] * 4 + ["sas[fit=0.9]"] * 4 + ["ppll"]


def test_a_cell_of_two_contenders_is_of_the_one_in_which_nothing_is_varied():
    grid = make_grid(Settings(methods=("sas", "sas@published")), [])
    own = [cell.contender for cell in grid.cells if not cell.varied]
    assert own == ["sas", "sas@published"]
    assert ("sas, complete=true", "it is a cell of sas@published") in grid.left_out
    assert ("sas@published, complete=false", "it is a cell of sas") in grid.left_out
    assert len({cell.key for cell in grid.cells}) == len(grid.cells)


def test_combinations_that_cannot_be_are_left_out_with_their_reason():
    grid = make_grid(Settings(methods=("sas",)), ["fov=60,100", "cell=0.08/80,0.2/125"])
    assert len(grid.cells) == 3
    assert [what for what, why in grid.left_out if "field of view" in why] == ["fov=100, cell=0.08/80"]
    with pytest.raises(SettingsError, match="fov=100 cannot be used"):
        make_grid(Settings(methods=("sas",)), ["fov=60,100"])


def test_rates_are_varied_only_where_the_coding_has_them():
    for codec in ("jpeg", "none"):
        with pytest.raises(SettingsError, match=f"--vary crf is for --codec h264, not {codec}"):
            make_grid(Settings(methods=("sas",), codec=codec), ["crf=15,25"])


def test_a_preset_s_view_cell_is_varied():
    grid = make_grid(settings_of({"preset": "snakebinning-2021"}), ["cell=pvs1,pvs2,pvs3"])
    cells = {(cell.settings.cell_radius, cell.settings.cell_fov) for cell in of(grid.cells, "sas")}
    assert cells == {(0.1, 90), (0.2, 125), (0.3, 160)}
    assert {(cell.settings.scene, cell.settings.atlas_width) for cell in grid.cells} == {("village", 8192)}


@pytest.mark.parametrize(
    ("vary", "says"),
    [
        ("shadingrate=1", "shading_rate"),
        ("atlsa=512", "'atlas'"),
        ("atlas=", "atlas=1024"),
        ("atlas=5", "from 16 to 8192"),
        ("fit=2", "fit"),
        ("fit=wide", "a number"),
        ("reuse=perhaps", "true or false"),
        ("cell=0.1", "half a cell"),
        ("latency=soon", "latency"),
        ("crf=99", "51"),
    ],
)
def test_unusable_axes_are_one_sentence(vary: str, says: str):
    with pytest.raises((InputError, SettingsError), match=says):
        make_grid(ALL, [vary])


def test_the_order_is_seeded_and_mixes_methods():
    cells = make_grid(ALL, ["shading_rate=0.5,0.7,1.0", "atlas=512,1024,2048"]).cells
    orders = [shuffled(cells, seed, turn) for seed, turn in ((0, 0), (0, 0), (0, 1), (1, 0))]
    names = [[(cell.key, cell.settings) for cell in order] for order in orders]
    assert names[0] == names[1]
    assert names[0] != names[2]
    assert names[0] != names[3]
    assert sorted(map(repr, names[0])) == sorted(repr((cell.key, cell.settings)) for cell in cells)
    assert [cell.packer.name for cell in orders[0]] != sorted(cell.packer.name for cell in orders[0])


def test_timing_stops_when_precise_and_not_before_there_is_an_interval():
    rule = StopRule(precision=0.05, repetitions=20, budget=100)
    assert rule.stop([10.0] * 5, 0) is None
    assert rule.stop([10.0] * 6, 0) == "precise"
    assert rule.stop([10.0, 10.6] * 3, 0) is None
    assert rule.stop([10.0, 10.4] * 3, 0) == "precise"


def test_timing_stops_at_its_limits():
    rule = StopRule(precision=0.01, repetitions=9, budget=30)
    noisy = list(np.random.default_rng(0).normal(10, 2, 9))
    assert rule.stop(noisy, 0) == "repetitions"
    assert rule.stop(noisy[:8], 30) == "budget"
    assert rule.stop(noisy[:8], 29) is None


def test_more_passes_narrow_the_interval_until_it_is_precise():
    draws = np.random.default_rng(3).normal(10, 0.5, 400)
    counts = []
    for precision in (0.2, 0.1, 0.05):
        rule = StopRule(precision, repetitions=400, budget=1)
        counts.append(next(n for n in range(1, 401) if rule.stop(list(draws[:n]), 0) == "precise"))
    assert counts == sorted(counts)
    assert counts[0] < counts[-1]


def test_the_budget_counts_preparing_and_packing_by_the_clock(tmp_path, monkeypatch):
    passed = [(0, "wall/prepare", 400.0), (0, "pack", 30.0), (0, "wall/pack", 100.0), (1, "wall/pack", 250.0)]
    monkeypatch.setattr(timing, "_one_pass", lambda *_: passed)
    session: Any = None  # what replaces a pass needs none
    (cell,) = make_grid(Settings(methods=("sas",), frames=2), ["fit=0.5"]).cells
    timed = Timed(cell, tmp_path, [30.0], spent=0.0)
    assert timed.again(session, warm=True)
    assert timed.again(session, warm=True)
    assert timed.spent == pytest.approx(2 * 0.75)
    assert StopRule(precision=0, repetitions=9, budget=1.4).stop(timed.times, timed.spent) == "budget"
    assert timed.goes_on(StopRule(precision=0, repetitions=9, budget=1.6))


def corner(size: float) -> str:
    return f"v 0 0 0\nv {size} 0 0\nv 0 {size} 0\nv 0 0 {size}\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def test_edited_scenes_and_paths_are_others_also_where_names_are_the_same(tmp_path: Path):
    files = [tmp_path / folder / "box.obj" for folder in ("a", "b")]
    for file in files:
        file.parent.mkdir()
        file.write_text(corner(1), encoding="utf-8")
    path = tmp_path / "path.txt"
    path.write_text("".join(f"{16.7 * i} 0 0 3 0 0 0 1\n" for i in range(3)), encoding="utf-8")
    settings = replace(ALL, methods=("sas",), path=str(path))
    grid = make_grid(settings, [f"scene={','.join(map(str, files))}"])
    found = [check_scenes(grid)]
    files[0].write_text(corner(2), encoding="utf-8")
    found.append(check_scenes(grid))
    path.write_text(path.read_text(encoding="utf-8").replace(" 0 0 3 ", " 0 0 4 "), encoding="utf-8")
    found.append(check_scenes(grid))
    a, b = map(str, files)
    assert [hashes[a]["scene_hash"] == found[0][a]["scene_hash"] for hashes in found] == [True, False, False]
    assert [hashes[b] == found[0][b] for hashes in found] == [True, True, False]
