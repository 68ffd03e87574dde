"""A packer that does not return ends every command in a sentence, wherever it is asked for something."""

import os
from pathlib import Path

import pytest
from typer.testing import CliRunner

from shading_atlas_bench.harness.cli.main import app
from shading_atlas_bench.harness.workload import methods
from tests.harness.commands import bench

HANGING = Path(__file__).parents[1] / "hanging_packers.py"
SMALL = ["--frames", "2", "--size", "96x64", "--atlas", "64x64", "--codec", "none", "--detail", "40000"]
COMMANDS = {
    "run": ["run", *SMALL, "--method"],
    "dry run": ["run", *SMALL, "--dry-run", "--method"],
    "sweep": ["sweep", *SMALL, "--method"],
    "dry sweep": ["sweep", *SMALL, "--dry-run", "--method"],
    "check": ["check"],
    "stress": ["stress", "--quick", "--method"],
}


def printed(command: list[str]) -> tuple[int, str]:
    """Exit code and everything that a command prints, in one line."""
    result = CliRunner().invoke(app, command)
    return result.exit_code, " ".join(result.output.split())


@pytest.fixture
def looping(tmp_path: Path) -> Path:
    """A file that never ends to be imported."""
    file = tmp_path / "endless.py"
    file.write_text("while True:\n    pass\n", encoding="utf-8")
    return file


@pytest.mark.parametrize("command", COMMANDS)
def test_importing_and_making_has_its_time(command, looping, tmp_path, monkeypatch):
    monkeypatch.setattr(methods, "LEAST", 0.5)
    monkeypatch.chdir(tmp_path)
    for spec in (f"{looping}:Any", f"{HANGING}:InInit"):
        code, text = printed([*COMMANDS[command], spec, "--timeout", "1"])
        assert code == 2, text
        assert f"bench: {spec} cannot be used: importing and making it took longer than 1 s." in text


def test_so_has_making_the_cells_of_a_sweep(monkeypatch):
    monkeypatch.setattr(methods, "LEAST", 0.5)
    spec = f"{HANGING}:InInitLater"
    code, text = printed(["sweep", *SMALL, "--dry-run", "--vary", "fit=0.5,0.75", "--method", spec, "--timeout", "1"])
    assert code == 2, text
    assert "bench: in-init-later cannot be used: making it took longer than 1 s." in text


@pytest.mark.parametrize("command", ["run", "sweep"])
def test_a_dry_run_says_who_cannot_say_what_it_has_to_do(command):
    methods = [word for name in ("InSkip", "Unable") for word in ("--method", f"{HANGING}:{name}")]
    code, text = printed([command, *SMALL, "--dry-run", *methods, "--method", "sas", "--timeout", "1"])
    assert code == 1, text
    assert "timeout" in text
    assert "it took longer than" in text
    assert "--timeout 1 allows." in text
    assert "RuntimeError: oops" in text
    assert "skipped: RuntimeError" not in text
    if command == "sweep":  # once, not once in each cell
        assert "timeout in-skip: it took longer than --timeout 1 allows." in text
        assert "failed unable: RuntimeError: oops (hanging_packers.py, line" in text
        assert text.count("in-skip:") == 1


def test_a_run_has_it_as_rows(tmp_path):
    method = f"{HANGING}:InSkip"
    code, text = printed(["run", *SMALL, "--method", method, "--timeout", "1", "--out", str(tmp_path / "out")])
    assert code == 1, text
    assert "timeout 2 rows: in-skip: preparing: it took longer than --timeout 1 allows." in text


def test_explaining_skips_has_its_time_as_well(tmp_path):
    command = ["run", *SMALL, "--method", f"{HANGING}:InSkip", "--timeout", "0.1", "--explain"]
    code, text = printed([*command, "--out", str(tmp_path / "out")])
    assert code == 1, text
    assert "skips" in text


@pytest.mark.skipif(os.name == "nt", reason="needs a C library's sleep")
def test_a_dry_run_is_watched_from_outside():
    done = bench("run", *SMALL, "--dry-run", "--method", f"{HANGING}:InSkipHolding", "--timeout", "1")
    assert done.returncode == 1
    assert done.stderr == "bench: in-skip-holding: skip(): it took longer than --timeout 1 allows.\n"
    done = bench("run", *SMALL, "--dry-run", "--method", f"{HANGING}:LeavingInSkip")
    assert done.returncode == 1
    assert done.stderr == "bench: leaving-in-skip: skip(): the process was ended with exit code 0.\n"
