"""What is said of the process and the machine, and that one folder is written by one process only."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from shading_atlas_bench.harness.errors import InputError
from shading_atlas_bench.harness.measure import machine
from shading_atlas_bench.harness.measure.machine import commit, load, peak_memory
from shading_atlas_bench.harness.run.folder import locked
from tests.harness.commands import ROOT

PEAK = "from shading_atlas_bench.harness.measure.machine import peak_memory; print(peak_memory())"
HOLD = """
import sys
from pathlib import Path
from shading_atlas_bench.harness.run.folder import locked
with locked(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""


def python(code: str, *arguments: str, **options: Any) -> subprocess.Popen:
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, **options)


def test_the_peak_of_memory_stays_and_is_this_process_own():
    before = peak_memory()
    assert bytearray(200_000_000).count(0) == 200_000_000
    assert peak_memory() >= 150_000_000
    assert before > 10_000_000
    said, _ = python(PEAK).communicate(timeout=60)
    assert 5_000_000 < int(said) < 150_000_000  # and not that of the process which started it


def test_the_load_is_a_number_of_processes():
    assert 0 <= load() < 10_000


def test_the_commit_is_named_and_whether_sources_were_changed_since(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def git(*arguments: str) -> str:
        return subprocess.run(["git", "-C", tmp_path, *arguments], check=True, capture_output=True, text=True).stdout

    monkeypatch.setattr(machine, "ROOT", tmp_path)
    assert commit() == ""  # no clone
    (tmp_path / "inside").mkdir()
    (tmp_path / "source.py").write_text("1", encoding="utf-8")
    git("init")
    git("add", ".")
    git("-c", "user.name=a", "-c", "user.email=a@b", "-c", "commit.gpgsign=false", "commit", "-m", "one")
    name = git("rev-parse", "HEAD")[:10]
    (tmp_path / "notes.md").write_text("no source", encoding="utf-8")
    assert commit() == name
    (tmp_path / "source.py").write_text("2", encoding="utf-8")
    assert commit() == f"{name} with changes"
    monkeypatch.setattr(machine, "ROOT", tmp_path / "inside")
    assert commit() == ""  # somebody else's repository
    monkeypatch.setenv("PATH", str(tmp_path / "inside"))
    assert commit() == ""  # no git


def test_a_folder_in_use_is_refused_until_its_process_ends_however_that_ends(tmp_path: Path):
    holder = python(HOLD, str(tmp_path), stdin=subprocess.PIPE)
    assert holder.stdout
    assert holder.stdout.readline() == "held\n"
    try:
        with pytest.raises(InputError, match="in use by another bench run"), locked(tmp_path):
            pytest.fail("two processes write one folder")
    finally:
        holder.kill()
        holder.communicate()
    with locked(tmp_path):
        assert [path.name for path in tmp_path.iterdir()] == [".lock"]
    with locked(tmp_path):  # given back at the end of the block
        pass


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path):
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(InputError, match="file cannot be written"), locked(tmp_path / "file"):
        pytest.fail("a file is no folder")
