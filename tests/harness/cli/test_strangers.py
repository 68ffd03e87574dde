"""Folders, files and names of strangers on the command line: data, never code; one sentence where they are wrong."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from shading_atlas_bench.harness.cli.main import app
from shading_atlas_bench.harness.errors import InputError
from shading_atlas_bench.harness.experiments.claims import ClaimsRequest, needs
from shading_atlas_bench.harness.plugins import refuse_code
from shading_atlas_bench.harness.watch.memory import LEAST
from shading_atlas_bench.harness.workload.settings import Settings
from shading_atlas_bench.reports.store.results import Store
from tests.harness.commands import ROOT
from tests.reports.synthetic import COMMON, make_store
from tests.reports.test_claims import CLAIM, HEAD

CODE = "from pathlib import Path\nPath(__file__).with_name('ran').touch()\n"
LETTERS_ARE_BYTES = sys.platform not in ("win32", "darwin")


def told(*arguments: str) -> tuple[int, str]:
    """Exit code and output of a command that ends without a traceback."""
    done = CliRunner().invoke(app, arguments)
    assert done.exception is None or isinstance(done.exception, SystemExit), done.output
    return done.exit_code, " ".join(done.output.split())


def stranger(folder: Path, spec: str) -> Path:
    (folder / "p.py").write_text(CODE, encoding="utf-8")
    settings = Settings(methods=("sas", spec.format(folder=folder))).to_json()
    (folder / "run.json").write_text(json.dumps({"settings": settings}), encoding="utf-8")
    return folder / "run.json"


@pytest.mark.parametrize("spec", ["{folder}/p.py:X", "p:X", "{folder}/p.py:X@published[a=1]", " p : X "])
def test_code_that_a_config_names_does_not_run(spec: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config = stranger(tmp_path, spec)
    monkeypatch.chdir(tmp_path)
    for arguments in (["--dry-run"], []):
        code, output = told("run", "--config", str(config), *arguments)
        assert (code, "run.json names the code" in output, "name it yourself with --method" in output) == (
            2,
            True,
            True,
        )
    assert not (tmp_path / "ran").exists()


def test_code_runs_where_the_command_line_names_it(tmp_path: Path) -> None:
    config = stranger(tmp_path, "{folder}/p.py:X")
    code, output = told("run", "--config", str(config), "--method", f"{tmp_path}/p.py:X", "--dry-run")
    assert (code, "has no packer class 'X'" in output) == (2, True)
    assert (tmp_path / "ran").exists()


def test_code_that_a_file_of_claims_names_does_not_run(tmp_path: Path) -> None:
    stranger(tmp_path, "")
    text = (HEAD + CLAIM).replace('"grid", "sas"', f'"{tmp_path}/p.py:X", "sas"')
    (tmp_path / "claims.toml").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"names the code .* install it as a package"):
        needs(ClaimsRequest(file=tmp_path / "claims.toml"))
    assert not (tmp_path / "ran").exists()


def test_installed_methods_are_no_code_of_a_file() -> None:
    named = ["all", "sas", "sas@published", "tss[strategy=a:b]", "odd[", ""]
    refuse_code(named, "run.json", "")
    with pytest.raises(InputError, match="mine:X"):
        refuse_code([*named, "mine:X"], "run.json", "")


@pytest.mark.parametrize("name", ["9" * 5000, "a/" * 5000])
def test_a_name_that_no_file_can_have_is_one_sentence(name: str) -> None:
    for arguments in (["report", name], ["compare", name, name], ["run", "--config", name], ["run", "--out", name]):
        code, output = told(*arguments)
        assert (code, "Traceback" in output) == (2, False)
        assert "cannot be" in output


def test_a_report_of_a_stranger_s_folder_runs_nothing(tmp_path: Path) -> None:
    make_store(tmp_path, 2)
    stranger(tmp_path, "{folder}/p.py:X")
    code, output = told("report", str(tmp_path))
    assert code == 0, output
    assert not (tmp_path / "ran").exists()


def test_markup_and_control_sequences_of_a_store_are_shown(tmp_path: Path) -> None:
    folder = tmp_path / "a[/]x"
    with Store(folder) as store:
        row = COMMON | {"scene": "s\x1b[2J", "codec": "none", "status": "failed", "reason": "[red]no\x1b]0;t\x07[/"}
        store.commit_frame("sas", "[/]\x1b[31m", 0, [row])
        store.notes["label/sas[[/]\x1b[31m]"] = "sas[/][\x1b[31m]"
        store.notes["warning/x"] = "bell \x07 half \ud800 and \u202e"
    code, output = told("report", str(folder))
    assert code == 0, output
    assert "a[/]x/frames.csv" in output
    code, output = told("compare", "-v", str(folder), str(folder))
    assert code == 0, output
    assert "\x1b" not in output
    assert "sas[/][\\x1b[31m]" in output


def bench(*arguments: str, folder: Path = ROOT, before: str = "") -> subprocess.CompletedProcess[bytes]:
    """Run `bench` in a shell, with shell commands before it."""
    command = [os.fsencode(word) for word in (sys.executable, "-m", "shading_atlas_bench", *arguments)]
    environment = os.environ | {"PYTHONPATH": str(ROOT), "COLUMNS": "80"}
    return subprocess.run(
        ["bash", "-c", f'{before} exec "$@"', "bash", *command], cwd=folder, env=environment, capture_output=True
    )


@pytest.mark.skipif(not LETTERS_ARE_BYTES, reason="names are bytes on other systems only")
def test_results_in_a_folder_whose_name_is_no_text(tmp_path: Path) -> None:
    folder = tmp_path / os.fsdecode(b"caf\xe9")
    folder.mkdir()
    make_store(folder, 2)
    done = bench("report", ".", folder=folder)
    assert (done.returncode, b"Traceback" in done.stderr) == (0, False), done.stderr
    assert (folder / "report.html").is_file()


@pytest.mark.skipif(not LETTERS_ARE_BYTES, reason="a command line holds no such letters on other systems")
def test_control_characters_of_an_argument_do_not_reach_the_terminal() -> None:
    done = bench("report", "a\x1b[2Jb")
    assert done.stderr.splitlines() == [b"bench: a\\x1b[2Jb has a control character: rename it."]
    assert (done.returncode, done.stdout) == (2, b"")


@pytest.mark.skipif(not LETTERS_ARE_BYTES, reason="other systems have no ulimit")
@pytest.mark.skipif(shutil.which("bash") is None, reason="it takes a shell")
def test_too_little_memory_is_one_sentence() -> None:
    done = bench("run", before=f"ulimit -v {LEAST // 2 // 1000};")
    assert done.stderr.splitlines() == [b"bench: The limit of memory (ulimit -v) is 1 GB: give 2 GB or more."]
    assert (done.returncode, done.stdout) == (2, b"")
