"""Frames that others disturbed and stretches out of pace are named; a steady run and single slips are not."""

from __future__ import annotations

import os
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from shading_atlas_bench.harness.measure import noise
from shading_atlas_bench.harness.measure.noise import OthersWatch
from shading_atlas_bench.harness.run.disturbed import disturbed, note_disturbed, out_of_pace
from shading_atlas_bench.reports.store.results import Store
from tests.reports.synthetic import COMMON


def store_of(folder: Path, references: list[float], others: list[float]) -> Path:
    with Store(folder) as store:
        for frame, (reference, share) in enumerate(zip(references, others, strict=True)):
            row = COMMON | {"codec": "none", "status": "ok", "server_ms": 5.0}
            statistics = {"reference_ms": reference, "others_share": share}
            store.commit_frame("sas", "", frame, [row], [], statistics)
    return folder


def test_a_steady_run_is_not_warned_of(tmp_path: Path) -> None:
    noisy = [12.0, 10.5, 13.1, 11.9, 12.4, 9.8, 12.1, 14.9, 11.7, 12.2, 20.5, 12.0]
    with Store(store_of(tmp_path, noisy, [0.05, 0.1] * 6)) as store:
        assert disturbed(store) == {}


def test_what_was_noticed_of_a_run_is_said(tmp_path: Path) -> None:
    """Frames 9 to 11 were 1.7 to 2 times as fast as 4 to 8."""
    references = [12.0] * 9 + [6.5, 6.0, 7.0]
    others = [0.05] * 3 + [0.6, 0.45] + [0.02] * 7
    with Store(store_of(tmp_path, references, others)) as store:
        note_disturbed(store)
        note_disturbed(store)
        texts = list(store.notes.under("warning").values())
    assert texts == [
        "Other programs took up to 60% of the machine's cores in frames 3-4: compare ratios, not times, or run again "
        "on a quiet machine.",
        "The reference took 0.5 to 0.6 times as long as usual in frames 9-11: the machine changed its pace, and times "
        "there are of another one.",
    ]


@pytest.mark.parametrize(
    ("times", "frames"),
    [
        ([1, 1, 1, 1, 1, 1, 2, 2, 2], {6, 7, 8}),
        ([2, 2, 2, 2, 1, 1, 1, 1, 1], {0, 1, 2, 3}),
        ([1, 1, 3, 1, 1, 3, 1, 1, 3], set()),
        ([1, 1, 1, 1, 2, 2, 1, 1, 1], set()),
        ([1, 2, 2, 2, 9], set()),
    ],
)
def test_stretches_count_and_slips_do_not(times, frames) -> None:
    assert out_of_pace(dict(enumerate(times))) == frames


def test_others_are_what_this_process_did_not_do(monkeypatch: pytest.MonkeyPatch) -> None:
    class Spent(tuple):
        idle, iowait, guest = 0.0, 0.0, 0.0

    def at(clock: float, busy: float, idle: float, own: float) -> None:
        spent = Spent((busy, idle))
        spent.idle = idle
        monkeypatch.setattr(noise, "psutil", SimpleNamespace(cpu_times=lambda: spent))
        monkeypatch.setattr(time, "perf_counter", lambda: clock)
        monkeypatch.setattr(time, "process_time", lambda: own)
        monkeypatch.setattr(os, "cpu_count", lambda: 4)

    at(0, 100, 50, 10)
    watch = OthersWatch()
    at(10, 130, 60, 30)  # of 40 core seconds 30 were busy, 20 of them its own
    assert watch.look() == pytest.approx(0.25)
    at(20, 150, 80, 55)  # its clock may run ahead of the system's
    assert watch.look() == 0
    assert watch.look() == 0, "no time has passed"
