"""What methods are handed is the same for all of them, whatever one of them does with it, and when it is done again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from shading_atlas_bench.arithmetic.arrays import fixed
from shading_atlas_bench.harness.conformance.catalogue import room, scene_of
from shading_atlas_bench.harness.conformance.trial import Stage, try_isolation
from shading_atlas_bench.harness.errors import InputError, StoppedError
from shading_atlas_bench.harness.measure.verification.shared_arrays import SharedArrays
from shading_atlas_bench.harness.run.run import run
from shading_atlas_bench.harness.workload import session
from shading_atlas_bench.harness.workload.session import Session, open_session
from shading_atlas_bench.harness.workload.settings import Settings
from shading_atlas_bench.packers.example.grid import Grid
from shading_atlas_bench.packers.interface import View
from shading_atlas_bench.reports.store.results import Store
from shading_atlas_bench.scenes.load import load_scene
from shading_atlas_bench.scenes.model import Camera
from tests.harness.meddling_packers import (
    Fickle,
    Late,
    Remembering,
    RememberingNothing,
    Rounding,
    RoundingLater,
    Sorting,
    Stopped,
)

GRID = "shading_atlas_bench.packers.example.grid:Grid"
SMALL: dict[str, Any] = {
    "scene": "hall", "frames": 4, "width": 80, "height": 45, "atlas_width": 128, "atlas_height": 128, "path": "orbit",
    "codec": "none", "metrics": ("psnr",),
}  # fmt: skip


@pytest.fixture(autouse=True)
def small_scene(monkeypatch):
    scene = scene_of(room())
    scene.cameras, scene.content_hash = [Camera((0.0, 0.1, 1.5), (0.0, 0.0, -1.0))], "room"
    monkeypatch.setattr(session, "load_scene", lambda *_, **__: fixed(scene))  # as load_scene itself does
    for kind in (Stopped, Fickle, Late):
        kind.interrupted = False


def methods(*kinds: type[Grid]) -> tuple[str, ...]:
    return tuple(GRID if kind is Grid else f"{kind.__module__}:{kind.__name__}" for kind in kinds)


def rows_of(folder: Path, method: str = "grid") -> list[dict[str, Any]]:
    with Store(folder, must_exist=True) as store:
        return [row for row in store.rows() if row["method"] == method]


def lasting(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [
        {name: value for name, value in row.items() if not name.endswith("_ms") and name != "peak_mb"} for row in rows
    ]


@pytest.fixture
def opened(device) -> Session:
    return open_session(Settings(methods=(GRID,), **SMALL), device)


def test_nothing_on_the_host_can_be_written_to(opened):
    work = opened.source.work(1)
    views = [work.frame.server, work.novel, *work.frame.predicted, *work.frame.frusta]
    arrays = [array for view in views for array in (view.view, view.projection)]
    arrays += [work.frame.pvs, opened.scene.triangles.host_positions, opened.scene.triangles.host_indices]
    for array in arrays:
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0


@pytest.mark.parametrize("cached", [False, True])
def test_a_loaded_scene_cannot_be_written_to(tmp_path, cached):
    """A cache that is filled from it would be wrong for good."""
    for _ in range(2):
        scene = load_scene("shells", detail=2000, cache=tmp_path if cached else None)
        for array in (scene.positions, scene.indices, scene.uvs, scene.origin):
            with pytest.raises(ValueError, match="read-only"):
                array[...] = 0


def test_a_view_has_arrays_of_its_own():
    matrix = np.eye(4)
    view = View(matrix, matrix, 8, 8)
    matrix[0, 3] = 1
    assert view.view[0, 3] == 0


def test_every_change_on_the_device_is_found(opened):
    shared, found = SharedArrays(opened.scene), []
    for name, array in shared._arrays.items():
        before = array.get()
        bytes_ = before.view(np.uint8).reshape(-1).copy()
        bytes_[-1] ^= 1
        array.set(bytes_.view(before.dtype).reshape(before.shape))
        found.append(name in shared.changed())
        array.set(before)
    assert all(found)
    assert len(found) > 12
    assert not shared.changed()


def test_what_is_in_another_order_is_another_array(device):
    array = device.upload(np.arange(100_000, dtype=np.float32))
    before = device.checksum(array)
    assert device.checksum(array) == before
    array.set(np.arange(100_000, dtype=np.float32)[::-1].copy())
    assert device.checksum(array) != before


@pytest.mark.parametrize(("kind", "kept"), [(Rounding, 0), (RoundingLater, 2)])
def test_a_method_that_writes_to_the_scene_ends_the_run_before_a_wrong_row(tmp_path, kind, kept):
    with pytest.raises(
        InputError, match=rf"{kind.name}.* wrote to scene\.triangles\.positions, which all methods read"
    ):
        run(Settings(methods=methods(Grid, kind), **SMALL), tmp_path / "run")
    run(Settings(methods=methods(Grid), **SMALL), tmp_path / "alone")
    found = rows_of(tmp_path / "run")
    assert [row["frame"] for row in found] == list(range(kept))
    assert lasting(found) == lasting(rows_of(tmp_path / "alone"))[:kept]


def test_the_conformance_kit_finds_it_too(opened):
    work = opened.source.work(0)
    stage = Stage(opened.scene, [work.frame], [work.novel], exact=False)
    assert try_isolation(stage, Grid).good
    found = try_isolation(stage, Rounding)
    assert (found.status, "It writes to scene.triangles.positions" in found.sentence) == ("invalid", True)


def test_lists_on_the_device_are_each_methods_own(tmp_path):
    run(Settings(methods=methods(Sorting, Grid), **SMALL), tmp_path / "run")
    run(Settings(methods=methods(Grid), **SMALL), tmp_path / "alone")
    assert lasting(rows_of(tmp_path / "run")) == lasting(rows_of(tmp_path / "alone"))


def test_pictures_are_read_before_another_method_draws(tmp_path):
    run(Settings(methods=methods(Remembering, RememberingNothing), **SMALL), tmp_path / "run")
    run(Settings(methods=methods(Remembering), **SMALL), tmp_path / "alone")
    columns = ("holes_px", "psnr")
    found, expected = (
        [[row[name] for name in columns] for row in rows_of(tmp_path / place, "remembering")]
        for place in ("run", "alone")
    )
    assert found == expected


def interrupted_then_resumed(kind: type[Stopped], folder: Path) -> list[dict[str, Any]]:
    settings = Settings(methods=methods(kind), **SMALL)
    with pytest.raises(StoppedError):
        run(settings, folder)
    assert [row["frame"] for row in rows_of(folder, kind.name)] == [0, 1]
    run(settings, folder)
    return rows_of(folder, kind.name)


def test_what_is_done_again_must_be_the_same(tmp_path):
    assert {row["status"] for row in interrupted_then_resumed(Stopped, tmp_path / "stopped")} == {"ok"}
    rows = interrupted_then_resumed(Fickle, tmp_path / "fickle")
    assert [row["status"] for row in rows] == ["ok", "ok", "invalid", "invalid"]
    assert "it is not the frame that it was before the run was interrupted" in rows[2]["reason"]
    assert "samples was" in rows[2]["reason"]


def test_the_rule_of_names_holds_across_an_interruption(tmp_path):
    rows = interrupted_then_resumed(Late, tmp_path / "late")
    assert [row["status"] for row in rows] == ["ok", "ok", "invalid", "invalid"]
    assert "other names than in the first frame" in rows[2]["reason"]
