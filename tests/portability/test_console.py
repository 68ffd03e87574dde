"""Nothing that `bench` prints ends it: a console that lacks a letter gets an escape in its place."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.reports.synthetic import make_store

ROOT = Path(__file__).parents[2]
NAME = "Прогон 走る"


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run's results in a folder whose name has letters of three scripts."""
    folder = tmp_path_factory.mktemp("runs") / NAME
    folder.mkdir()
    make_store(folder)
    return folder


def bench(encoding: str, *arguments: str) -> subprocess.CompletedProcess:
    environment = os.environ | {"PYTHONIOENCODING": encoding, "PYTHONUTF8": "0"}
    command = [sys.executable, "-m", "shading_atlas_bench.harness.cli.main", *arguments]
    return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, check=False, timeout=120)


@pytest.mark.parametrize("encoding", ["ascii", "cp1252", "utf-8"])
def test_a_path_in_any_script_is_printed_on_any_console(encoding: str, results: Path):
    done = bench(encoding, "report", str(results))
    assert done.returncode == 0, done.stderr
    assert b"Traceback" not in done.stderr
    shown = NAME if encoding == "utf-8" else "".join(c if c == " " else f"\\u{ord(c):04x}" for c in NAME)
    assert f"{shown}/frames.csv" in done.stdout.decode(encoding)


@pytest.mark.parametrize("encoding", ["ascii", "cp1252", "utf-8"])
def test_an_error_about_such_a_path_is_one_sentence(encoding: str, results: Path):
    done = bench(encoding, "report", str(results / "nothing"))
    assert done.returncode == 2
    assert b"has no results.sqlite" in done.stderr
    assert b"Traceback" not in done.stderr


def test_tables_and_help_are_printed_in_ascii():
    for command in (["--help"], ["run", "--help"], ["list"], ["run", "--nonsense"]):
        done = bench("ascii", *command)
        assert done.returncode == (2 if "--nonsense" in command else 0), done.stderr
        assert (done.stdout + done.stderr).isascii()
        assert b"Traceback" not in done.stderr


@pytest.mark.skipif(sys.platform in ("win32", "darwin"), reason="names are bytes on other systems only")
def test_a_name_that_is_not_text_is_refused_in_a_sentence():
    done = bench("utf-8", "run", "--scene", os.fsdecode(b"caf\xe9.obj"))
    assert done.returncode == 2
    sentence = b"bench: caf\\udce9.obj is not a name in utf-8: rename it, or use a UTF-8 locale."
    assert done.stderr.splitlines() == [sentence]
