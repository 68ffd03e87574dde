"""Which folder a run gets: its own unfinished one, else a new one, whatever else lies below runs/."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from shading_atlas_bench.harness.errors import InputError
from shading_atlas_bench.harness.progress import Progress
from shading_atlas_bench.harness.run.folder import COMPLETE, RUNS, check_results, folder_for, locked
from shading_atlas_bench.reports.store.csv_files import write_all
from shading_atlas_bench.reports.store.results import FILE, Store
from tests.reports.synthetic import PLAN, make_store

OWN = RUNS / "20300101-000000-hall"


class Said(Progress):
    """Keeps what is said."""

    def __init__(self) -> None:
        self.sentences: list[str] = []

    def say(self, sentence: str) -> None:
        self.sentences.append(sentence)


@pytest.fixture(autouse=True)
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to work in, and an unfinished run of PLAN in it."""
    monkeypatch.chdir(tmp_path)
    make_store(OWN, frames=2)
    return tmp_path


def test_an_unfinished_run_is_resumed_also_after_a_report_of_it():
    write_all(OWN)
    (OWN / "report.html").write_bytes(b"made by bench report")
    assert folder_for(PLAN, "hall", Progress()) == OWN
    assert folder_for(PLAN | {"device": "another"}, "hall", Progress()) != OWN


def test_a_run_that_ended_is_not():
    with Store(OWN) as store:
        store.notes[COMPLETE] = "yes"
    found = folder_for(PLAN, "hall", Progress())
    assert found != OWN
    assert found.name.endswith("-hall")
    assert list(found.iterdir()) == []


def test_a_run_that_is_on_its_way_is_left_alone():
    with locked(OWN):
        assert folder_for(PLAN, "hall", Progress()) != OWN


@pytest.mark.parametrize("damage", ["other bytes", "a value", "another version"])
def test_what_cannot_be_read_is_left_as_it_is_and_named(damage: str):
    data = bytearray((OWN / FILE).read_bytes())
    if damage == "other bytes":
        data[:200] = bytes(200)
    elif damage == "a value":
        data = data.replace(b"31 triangles", b"13 triangles").replace(b"cpu-skylake", b"cpu-skylark")
    else:
        data[60:64] = (5).to_bytes(4, "big")
    (OWN / FILE).write_bytes(data)
    said = Said()
    found = folder_for(PLAN, "hall", said)
    assert found != OWN
    (sentence,) = said.sentences
    assert sentence.startswith(f"Not resumed: {OWN / FILE} ")
    assert (OWN / FILE).read_bytes() == data
    if damage != "a value":  # it may well have ended, which it cannot say itself
        (OWN / "report.html").write_bytes(b"")
        said.sentences.clear()
        folder_for(PLAN, "hall", said)
        assert said.sentences == []


@pytest.mark.parametrize("target", ["nowhere/runs", "runs", "file"])
def test_runs_that_is_no_folder_is_one_sentence(target: str):
    RUNS.rename("other")
    Path("file").write_bytes(b"")
    RUNS.symlink_to(target)
    with pytest.raises(InputError, match=r"runs cannot be made .*: give --out"):
        folder_for(PLAN, "hall", Progress())


def test_a_second_run_within_a_second_has_a_folder_of_its_own():
    found = {folder_for(PLAN | {"device": str(number)}, "hall", Progress()) for number in range(5)}
    assert len(found) == 5


def test_what_fails_in_a_locked_folder_is_not_blamed_on_it():
    with pytest.raises(OSError, match="of something else"), locked(OWN):
        raise OSError("of something else")
    with locked(OWN), pytest.raises(InputError, match="in use"), locked(OWN):
        pass


@pytest.mark.skipif(os.name == "nt", reason="makes links")
def test_a_lock_that_is_a_link_is_named(tmp_path: Path):
    (tmp_path / ".lock").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InputError, match=r"\.lock is no file: delete it"), locked(tmp_path):
        pass


def test_results_that_are_no_file_are_called_so(tmp_path: Path):
    with pytest.raises(InputError, match=r"has no results\.sqlite: give a folder"):
        check_results(tmp_path)
    (tmp_path / "results.sqlite").mkdir()
    with pytest.raises(InputError, match=r"results\.sqlite is no file: give a folder"):
        check_results(tmp_path)
