"""What a run takes is told before it starts; what does not fit is refused; less room means fewer methods at once."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from shading_atlas_bench.harness.errors import InputError
from shading_atlas_bench.harness.run.memory import (
    AIM,
    AT_ONCE,
    MOST,
    memory_need,
    methods_at_once,
    processes_with_room,
    refusal,
)
from shading_atlas_bench.harness.workload.methods import find_methods
from shading_atlas_bench.harness.workload.settings import Settings, SettingsError, settings_of
from shading_atlas_bench.memory import Bound
from shading_atlas_bench.scenes.hall import make_hall
from shading_atlas_bench.scenes.model import Scene
from tests.harness.commands import bench
from tests.speed import _rows, difference

PACKERS = find_methods(Settings())
SMALL = ("--size", "64x48", "--atlas", "512x512", "--frames", "2", "--crf", "25", "--metrics", "psnr")


@pytest.fixture(scope="module")
def scene() -> Scene:
    return make_hall(detail=40_000, seed=0)


def total(scene: Scene, at_once: int = AT_ONCE, methods: int = len(PACKERS), **changed: Any) -> int:
    return memory_need(replace(Settings(), **changed), scene, PACKERS[:methods], at_once).total


@given(
    size=st.sampled_from(["width", "height", "atlas_width", "atlas_height", "frames"]),
    small=st.integers(16, 8192),
    more=st.integers(0, 8192),
    at_once=st.integers(1, AT_ONCE),
    methods=st.integers(1, len(PACKERS)),
)
def test_more_of_anything_never_takes_less(scene, size, small, more, at_once, methods):
    large = min(8192, small + more)
    assert total(scene, at_once, methods, **{size: small}) <= total(scene, at_once, methods, **{size: large})
    assert total(scene, 1, methods) <= total(scene, at_once, methods)
    assert total(scene, at_once, 1) <= total(scene, at_once, methods)
    assert total(scene, at_once, methods, codec="none") <= total(scene, at_once, methods, crf=(25,))
    assert total(scene, at_once, methods, crf=(25,)) <= total(scene, at_once, methods)


def test_it_is_linear_in_texels_pixels_and_triangles(scene):
    sizes = [{"atlas_width": 1024 * n} for n in (1, 2, 3)], [{"width": 400 * n} for n in (1, 2, 3)]
    for changes in sizes:
        first, second, third = (total(scene, **change) for change in changes)
        assert third - second == pytest.approx(second - first, abs=10)
    first, second, third = (
        memory_need(Settings(), make_hall(detail=count, seed=0), PACKERS).scene for count in (40_000, 80_000, 160_000)
    )
    assert third - second == pytest.approx(2 * (second - first), rel=0.1)


def test_less_memory_means_fewer_methods_at_once(scene):
    needs = {count: total(scene, count) for count in range(1, AT_ONCE + 1)}
    for count, need in needs.items():
        found = methods_at_once(replace(Settings(), memory=need), scene, PACKERS)
        assert needs[found] <= need
        assert found >= count
    with pytest.raises(InputError, match=r"--memory allows .* GB: give "):
        methods_at_once(replace(Settings(), memory=needs[1] - 1), scene, PACKERS)


@pytest.mark.parametrize(("share", "runs"), [(AIM + 0.01, True), (MOST - 0.01, True), (MOST + 0.01, False)])
def test_without_the_option_the_machine_decides(scene, monkeypatch, share, runs):
    need = total(scene, 1)
    bound = Bound(int(need / share), "this machine's memory")
    monkeypatch.setattr("shading_atlas_bench.harness.run.memory.memory_bound", lambda: bound)
    if runs:
        assert methods_at_once(Settings(), scene, PACKERS) == 1
    else:
        with pytest.raises(InputError, match="90% of this machine's memory are "):
            methods_at_once(Settings(), scene, PACKERS)


@pytest.mark.parametrize(
    ("change", "remedy"),
    [
        ({"atlas_width": 8192, "atlas_height": 8192}, "--atlas"),
        ({"atlas_width": 8192, "atlas_height": 8192, "codec": "none"}, "--atlas"),
        ({"width": 8192, "height": 8192, "atlas_width": 64, "atlas_height": 64}, "--size"),
    ],
)
def test_what_is_refused_says_what_to_change(scene, change, remedy):
    with pytest.raises(InputError, match=f": give .*{remedy}"):
        methods_at_once(replace(Settings(), memory=1_000_000_000, **change), scene, PACKERS)


@given(
    sizes=st.lists(st.integers(64, 8192), min_size=1, max_size=4), wanted=st.integers(1, 8), memory=st.floats(5e8, 2e10)
)
def test_processes_side_by_side_have_room_for_the_largest_that_has_room_alone(scene, sizes, wanted, memory):
    runs = [replace(Settings(), atlas_width=size, atlas_height=size, memory=int(memory)) for size in sizes]
    packers = [PACKERS[number % len(PACKERS)] for number in range(len(runs))]
    count = processes_with_room(runs, scene, packers, wanted)
    assert 1 <= count <= wanted
    for run, packer in zip(runs, packers, strict=True):
        alone, crowded = refusal(run, scene, [packer]), refusal(run, scene, [packer], count)
        assert bool(alone) == bool(crowded)
        assert ("fewer --workers" in crowded) == bool(crowded and count > 1)
    largest = max(memory_need(run, scene, [packer], 1).total for run, packer in zip(runs, packers, strict=True))
    assert count == wanted or (count + 1) * largest > int(memory)


def test_a_sweep_goes_on_beside_cells_that_do_not_fit(tmp_path: Path):
    out = tmp_path / "sweep"
    sweep = ("sweep", "--method", "sas", "--vary", "atlas=512x512,8192x8192", "--workers", "2", "--memory", "2G")
    done = bench(*sweep, "--size", "64x48", "--frames", "2", "--out", str(out))
    assert done.returncode == 1, done.stderr
    with (out / "sweep.csv").open(newline="", encoding="utf-8") as file:
        reasons = {row["varied"]: row["reason"] for row in csv.DictReader(file)}
    assert reasons["atlas=512x512"] == ""
    assert "--memory allows 1 GB for each of 2 workers: give a smaller --atlas, or" in reasons["atlas=8192x8192"]
    again = bench(*sweep[:-1], "40G", "--size", "64x48", "--frames", "2", "--out", str(out))
    assert again.returncode == 1, again.stderr


@pytest.mark.parametrize(("text", "size"), [("4G", 4e9), ("0.5 gb", 5e8), ("500M", 5e8), ("1.25G", 1.25e9)])
def test_sizes_are_read(text, size):
    assert settings_of({"memory": text}).memory == size


@pytest.mark.parametrize("text", ["", "4", "4T", "-4G", "inf", "nanG", "1e3G", "0G", "9999999G"])
def test_what_is_no_size_is_refused(text):
    with pytest.raises(SettingsError, match="--memory"):
        settings_of({"memory": text})


def test_a_run_that_cannot_fit_ends_before_it_starts(tmp_path: Path):
    for further in ((), ("--dry-run",)):
        done = bench("run", *SMALL, "--memory", "100M", *further, "--out", str(tmp_path / "run"))
        assert done.returncode == 2
        assert "This run takes about" in " ".join(done.stderr.split())
        assert "Traceback" not in done.stderr
        assert not (tmp_path / "run" / "results.sqlite").exists()


def test_one_method_at_a_time_gives_the_same_rows(tmp_path: Path, scene):
    settings = settings_of({"size": "64x48", "atlas": "512x512", "frames": 2, "crf": "25", "metrics": "psnr"})
    need = memory_need(settings, make_hall(seed=0), PACKERS, 1).total
    rows = []
    for number, memory in enumerate(("40G", f"{-(-need // 1_000_000)}M")):
        out = tmp_path / str(number)
        done = bench("run", *SMALL, "--memory", memory, "--out", str(out))
        assert done.returncode == 0, done.stderr
        rows.append(_rows(out))
    assert difference(*rows) == ""
