"""A packer's mistake is its own lane's failure: whatever it returns or raises ends in one sentence in its own rows."""

from __future__ import annotations

import json
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from shading_atlas_bench.harness.conformance.catalogue import room, scene_of
from shading_atlas_bench.harness.conformance.check import Kit, guarded_run
from shading_atlas_bench.harness.conformance.trial import Stage, try_method
from shading_atlas_bench.harness.errors import StopAsked, is_stop
from shading_atlas_bench.harness.measure.returned import verdict_on
from shading_atlas_bench.harness.run.run import run
from shading_atlas_bench.harness.watch.stops import stops_apart
from shading_atlas_bench.harness.workload import session
from shading_atlas_bench.harness.workload.session import open_session
from shading_atlas_bench.harness.workload.settings import Settings
from shading_atlas_bench.packers.interface import Packer
from shading_atlas_bench.reports.pages.html import write_report
from shading_atlas_bench.reports.store.results import Store
from shading_atlas_bench.scenes.model import Camera
from tests.fuzz.cases import nothing_beside
from tests.harness import returning_packers as returning

FILE = Path(returning.__file__)
GRID = "shading_atlas_bench.packers.example.grid:Grid"
WRONG = returning.RETURNING | returning.RAISING
SMALL: dict[str, Any] = {
    "scene": "hall", "frames": 2, "width": 80, "height": 45, "atlas_width": 128, "atlas_height": 128, "path": "orbit",
    "codec": "none", "metrics": ("psnr",), "dump": True,
}  # fmt: skip
# Asked of a packer only where a frame is like the one before it.
SELDOM = {"settled-unlucky"}


def room_of_camera():
    """A room without windows, and where to look at it from."""
    scene = scene_of(room())
    scene.cameras, scene.content_hash = [Camera((0.0, 0.1, 1.5), (0.0, 0.0, -1.0))], "room"
    return scene


@pytest.fixture(scope="module", autouse=True)
def small_scene():
    """Whatever scene is asked for, it is that room."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(session, "load_scene", lambda *_, **__: room_of_camera())
        yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """One run of all of them, of one that is honest, and of one with large numbers."""
    out = tmp_path_factory.mktemp("returning") / "deep" / "down" / "run"
    kinds: list[type[Packer]] = [*WRONG, returning.Greedy, returning.KeepingOddly]
    with nothing_beside(out):
        assert not run(Settings(methods=(GRID, *(f"{FILE}:{kind.__name__}" for kind in kinds)), **SMALL), out).well
    return out


@pytest.fixture(scope="module")
def rows(folder) -> list[dict]:
    with Store(folder, must_exist=True) as store:
        return store.rows()


@pytest.fixture(scope="module")
def stage(device) -> Stage:
    opened = open_session(Settings(methods=(GRID,), **SMALL), device)
    works = [opened.source.work(index) for index in range(2)]
    return Stage(opened.scene, [work.frame for work in works], [work.novel for work in works], exact=False)


@pytest.mark.parametrize("packer", WRONG, ids=lambda packer: packer.name)
def test_a_mistake_is_one_sentence_in_its_own_rows(rows, packer):
    found = [row for row in rows if row["method"] == packer.name]
    assert len(found) == SMALL["frames"]
    if packer.name not in SELDOM:
        assert {row["status"] for row in found} <= {"invalid", "failed"}
        assert all(WRONG[packer] in row["reason"] and "\n" not in row["reason"] for row in found), found[0]["reason"]


def test_names_of_a_packers_own_things_are_told_in_letters(rows):
    (reason,) = {row["reason"] for row in rows if row["method"] == "keeping-oddly"}
    assert r"State is kept outside of packer and client, in KeepingOddly.\ud800\x1b" in reason


def test_the_others_go_on(rows):
    honest = [row for row in rows if row["method"] in ("grid", "greedy")]
    assert [row["status"] for row in honest] == ["ok"] * 4


def test_the_report_is_there_and_can_be_made_again(folder):
    before = (folder / "report.html").read_text(encoding="utf-8")
    write_report(folder)
    assert (folder / "report.html").read_text(encoding="utf-8") == before
    assert "1.798e+308" in before
    told = json.loads((folder / "pictures" / "pictures.json").read_text(encoding="utf-8"))
    assert len(told) == len(WRONG) + 3
    assert not [path for path in folder.rglob("*") if "outside" in path.name]


@pytest.mark.parametrize("packer", WRONG, ids=lambda packer: packer.name)
def test_the_conformance_kit_says_the_same(stage, packer):
    with stops_apart():
        found = try_method(stage, packer, again=0)
    assert found.status in ("invalid", "failed", "refused")
    assert WRONG[packer] in found.sentence or (found.status, WRONG[packer]) == ("refused", "ValueError")


def test_a_check_survives_what_ends_programs(device):
    def fail(kit: Kit):
        raise SystemExit(3)

    found = guarded_run("exit", fail, Kit(device, returning.Greedy()), 60)
    assert (found.status, found.sentence.split(" (")[0]) == ("failed", "SystemExit: 3")


@pytest.fixture
def usual_handler():
    """Python's own handler of Ctrl-C, which those who start tests in the background switch off."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_a_person_may_stop_where_a_packer_may_not(usual_handler):
    with stops_apart():
        assert not is_stop(KeyboardInterrupt())
        with pytest.raises(StopAsked):
            signal.raise_signal(signal.SIGTERM)
        with pytest.raises(StopAsked):
            verdict_on(StopAsked())
    assert is_stop(KeyboardInterrupt())


def test_what_is_none_of_a_device_is_not_looked_at(device):
    whole = device.zeros((4, 4), np.uint8)
    assert device.holds(whole, np.uint8, (4, 4))
    assert not device.holds(whole, np.int8, (4, 4))
    assert not device.holds(whole[1:], np.uint8, (3, 4))
    assert not device.holds(whole.T, np.uint8, (4, 4))
    assert not device.holds(returning.Unlucky(), np.uint8, (4, 4))
    whole.shape = (400, 400)
    assert not device.holds(whole, np.uint8, (400, 400))
