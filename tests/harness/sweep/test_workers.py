"""Workers of a sweep: one that is stopped, hangs or dies gives its cell to another one, and all end when told to."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from shading_atlas_bench.harness.errors import InputError
from shading_atlas_bench.harness.progress import Task
from shading_atlas_bench.harness.sweep import workers
from shading_atlas_bench.harness.sweep.workers import _Crew, _stir

STOPPED, DYING = 1, 2  # cells

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="processes cannot be stopped here")


def work(wanted: Any, folder: Path, count: int, pipe: Any, beat: Any, journal: Path, known: Path) -> None:
    """A worker that writes down what it is given, is stopped in the first such cell, and dies in every other one."""
    beat.value = time.monotonic()
    while (number := pipe.recv()) is not None:
        with open(folder / str(number), "a", encoding="utf-8") as file:
            file.write(f"{os.getpid()}\n")
        if number == STOPPED and not (folder / "stopped").exists():
            (folder / "stopped").touch()
            os.kill(os.getpid(), signal.SIGSTOP)
        if number == DYING:
            os._exit(3)
        beat.value = time.monotonic()
        pipe.send(number)


def crew_of(folder: Path, cells: list[int], monkeypatch: pytest.MonkeyPatch) -> _Crew:
    monkeypatch.setattr(workers, "_work", work)
    grid: Any = SimpleNamespace(cells=[SimpleNamespace(contender="sas", varied=f"fit={n}") for n in range(5)])
    wanted: Any = None
    (folder / "place").mkdir()
    return _Crew(wanted, grid, folder, 2, folder / "place", cells, Task())


def all_of(crew: _Crew) -> None:
    """Look after the workers until they have done everything."""
    while crew.goes_on():
        pass


def test_the_cell_of_a_stopped_worker_goes_to_another(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(workers, "SILENT", 3.0)
    crew = crew_of(tmp_path, [0, STOPPED, 3, 4], monkeypatch)
    try:
        all_of(crew)
    finally:
        crew.end()
    by = {number: (tmp_path / str(number)).read_text(encoding="utf-8").split() for number in (0, STOPPED, 3, 4)}
    assert {number: len(pids) for number, pids in by.items()} == {0: 1, STOPPED: 2, 3: 1, 4: 1}
    assert len(set(by[STOPPED])) == 2
    assert not any(Path(f"/proc/{pid}").exists() for pids in by.values() for pid in pids)


def test_a_cell_in_which_every_worker_dies_ends_the_sweep(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    crew = crew_of(tmp_path, [0, DYING], monkeypatch)
    try:
        with pytest.raises(InputError, match="3 workers ended in the cell sas fit=2: run without --workers"):
            all_of(crew)
    finally:
        crew.end()
    assert len((tmp_path / str(DYING)).read_text(encoding="utf-8").split()) == 3


def test_all_end_within_seconds_also_one_that_is_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    crew = crew_of(tmp_path, [STOPPED], monkeypatch)
    until = time.monotonic() + 120
    while not (tmp_path / "stopped").exists() and time.monotonic() < until:
        crew.goes_on()
    start = time.monotonic()
    crew.end()
    assert time.monotonic() - start < 3
    assert not any(worker.process.is_alive() for worker in crew.workers)


def test_a_worker_that_has_begun_shows_that_it_runs(monkeypatch: pytest.MonkeyPatch):
    beats: list[float] = []
    parent = SimpleNamespace(is_alive=lambda: len(beats) < 3, join=lambda _: beats.append(beat.value))
    beat: Any = SimpleNamespace(value=0.0)
    monkeypatch.setattr("multiprocessing.parent_process", lambda: parent)
    monkeypatch.setattr(os, "_exit", beats.append)
    _stir(beat)
    assert 0 < beats[0] <= beats[1] <= beats[2]
    assert beats[3:] == [1]
