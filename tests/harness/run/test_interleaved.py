"""Two saved runs replayed in turn: in fresh processes, in changing order, and only what is not there yet."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from shading_atlas_bench.harness.errors import InputError
from shading_atlas_bench.harness.progress import Progress
from shading_atlas_bench.harness.run import interleaved
from shading_atlas_bench.harness.run.folder import COMPLETE
from shading_atlas_bench.harness.run.interleaved import replay_in_turn
from shading_atlas_bench.reports.store.results import Store
from tests.harness.commands import bench

SMALL = ("--method", "sas", "--size", "64x48", "--atlas", "256x256", "--frames", "2", "--codec", "none")


def test_the_order_changes_and_what_is_complete_is_not_run_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    began: list[str] = []

    def replay(file: Path, folder: Path) -> None:
        began.append(folder.name)
        assert file.name == "run.json"
        with Store(folder) as store:
            if folder.name != "b-02" or began.count("b-02") == 2:
                store.notes[COMPLETE] = "yes"

    monkeypatch.setattr(interleaved, "_replay", replay)
    for name in "ab":
        (tmp_path / name).mkdir()
        (tmp_path / name / "run.json").write_text("{}", encoding="utf-8")
    out = tmp_path / "out"
    folders = replay_in_turn(tmp_path / "a", tmp_path / "b" / "run.json", 3, out, Progress())
    assert began == ["a-01", "b-01", "b-02", "a-02", "a-03", "b-03"]
    assert [[folder.name for folder in each] for each in folders] == [
        ["a-01", "a-02", "a-03"], ["b-01", "b-02", "b-03"]
    ]  # fmt: skip
    replay_in_turn(tmp_path / "a", tmp_path / "b", 3, out, Progress())
    assert began[6:] == ["b-02"]


def test_what_cannot_be_replayed_is_said(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no run\.json"):
        replay_in_turn(tmp_path, tmp_path, 8, tmp_path / "out", Progress())
    broken = tmp_path / "broken.json"
    broken.write_text(json.dumps({"settings": {"scene": "nowhere"}}), encoding="utf-8")
    done = bench("compare", "--run", str(broken), str(broken), "--out", str(tmp_path / "out"))
    assert done.returncode == 2
    assert "Replaying" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_run_compared_with_itself_in_turn(tmp_path: Path) -> None:
    assert bench("run", *SMALL, "--out", str(tmp_path / "a")).returncode == 0
    compared = ("compare", "--run", str(tmp_path / "a"), str(tmp_path / "a"), "--out", str(tmp_path / "out"))
    done = bench(*compared)
    assert done.returncode == 0, done.stderr
    assert "B against A, of" in done.stdout
    assert "Times are medians of 10 processes each" in done.stdout
    assert len(list((tmp_path / "out").iterdir())) == 20
