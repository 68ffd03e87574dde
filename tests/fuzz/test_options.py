"""Every option of every command with values that nothing expects: settings that are whole, or a sentence; no frame."""

from __future__ import annotations

import json
import math
from dataclasses import astuple
from pathlib import Path

import pytest
import typer
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner, Result

from shading_atlas_bench.harness.cli.main import app
from shading_atlas_bench.harness.cli.options import OPTIONS, RUN, SWEEP
from shading_atlas_bench.harness.workload.settings import Settings
from tests.fuzz.cases import fuzzed, nothing_beside
from tests.fuzz.values import NUMBERS, TEXTS

ODD = ["inf", "-inf", "nan", "1e10", "1e400", "-1", "0", "9" * 5000, "0x10", "1_0", "٣", "½", "1,2", "true", "None"]
PAIRS = st.tuples(*[st.sampled_from([*ODD, "960", "540", "0.1", "90"])] * 2)
VALUES = st.one_of(
    st.sampled_from(ODD),
    PAIRS.flatmap(lambda pair: st.sampled_from("x,/:").map(lambda mark: mark.join(pair))),
    NUMBERS.map(str),
    TEXTS,
    st.sampled_from(["hall", "walk", "pvs1", "h264", "none", "client", "sas", "sas@published", "flip", "default", "m"]),
)
VARIED = st.tuples(
    st.sampled_from(["atlas", "samples", "crf", "cell", "size", "fov", "latency", "pvs_density", "scene", "superblock"])
    | TEXTS,
    VALUES,
).map("=".join)
FLAGS = {
    command: [option.flag for option in OPTIONS if command in option.commands and option.kind is not bool]
    for command in (RUN, SWEEP)
} | {
    "check": ["--out", "--timeout", "--device"],
    "stress": ["--method", "--test", "--out", "--timeout", "--device"],
    "kernels": ["--kernel", "--variant", "--out", "--repeat", "--device"],
    "claims": ["--id", "--out", "--reuse", "--file", "--device"],
    "report": [],
    "compare": [],
    "list": ["--scene", "--unit"],
}  # fmt: skip
LACKING = {"check": ["sas"], RUN: ["--dry-run"], SWEEP: ["--dry-run"], "claims": ["--dry-run"]}


@st.composite
def command_lines(draw: st.DrawFn) -> list[str]:
    command = draw(st.sampled_from(sorted(FLAGS)))
    arguments = [command, *LACKING.get(command, ())]
    for flag in draw(st.lists(st.sampled_from(FLAGS[command] or ["--"]), max_size=3)):
        value = draw(VARIED if flag == "--vary" else VALUES)
        arguments += [f"{flag}={value}"] if draw(st.booleans()) else [flag, value]
    return arguments + draw(st.lists(VALUES, max_size=1))


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[Settings]:
    """The settings that commands came to; what they would do with them is not done."""
    from shading_atlas_bench.harness.cli import catalogue, dry_run, scene_view, sweep_tables
    from shading_atlas_bench.harness.conformance import check, stress
    from shading_atlas_bench.harness.kernel_timing import timing
    from shading_atlas_bench.harness.sweep.grid import make_grid

    found: list[Settings] = []

    def grid(wanted, out):
        found.extend(cell.settings for cell in make_grid(wanted.settings, wanted.vary).cells)

    monkeypatch.setattr(dry_run, "show_plan", lambda settings, out: found.append(settings))
    monkeypatch.setattr(sweep_tables, "show_grid", grid)
    monkeypatch.setattr(check, "run_check", lambda *_: True)
    monkeypatch.setattr(stress, "run_stress", lambda *_: True)
    monkeypatch.setattr(timing, "_measure_all", lambda *_: pytest.fail("a kernel ran"))
    monkeypatch.setattr(timing, "bench_kernels", lambda *_: None)
    monkeypatch.setattr(scene_view, "show_scene", lambda *_: None)
    monkeypatch.setattr(catalogue, "show_catalogue", lambda: None)
    place = tmp_path / "here"
    place.mkdir()
    monkeypatch.chdir(place)
    return found


def told(arguments: list[str]) -> Result:
    """What a command says; as typed, so without what no command line can hold."""
    typed = [argument.replace("\0", "") for argument in arguments]
    return CliRunner().invoke(app, typed)


@fuzzed
@given(command_lines())
def test_options(asked: list[Settings], arguments: list[str]) -> None:
    asked.clear()
    with nothing_beside(Path.cwd()):
        done = told(arguments)
    assert done.exception is None or isinstance(done.exception, SystemExit | typer.Exit), (arguments, done.output)
    assert done.exit_code in (0, 1, 2), (arguments, done.output)
    for settings in asked:
        numbers = [value for value in astuple(settings) if isinstance(value, float)]
        assert all(map(math.isfinite, numbers)), settings
        replayed = json.loads(json.dumps({"settings": settings.to_json()}, allow_nan=False))["settings"]
        assert Settings.from_json(replayed, "run.json") == settings
