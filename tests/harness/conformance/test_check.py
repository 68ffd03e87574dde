"""The conformance kit fails where a packer has a planted fault, in a sentence that names it."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from shading_atlas_bench.harness.cli.main import app
from shading_atlas_bench.harness.conformance import check
from shading_atlas_bench.harness.conformance.check import CHECKS, Kit, guarded_run
from shading_atlas_bench.harness.conformance.fuzz import Soup
from shading_atlas_bench.harness.conformance.trial import TrialResult
from tests.fuzz.cases import nothing_beside
from tests.harness import faulty_packers as faulty
from tests.harness import returning_packers

FAULTY = Path(faulty.__file__)
RETURNING = Path(returning_packers.__file__)
SOUP = Soup([[[0.0, 0.0, 0.0]] * 3], [0], [0.0, 0.0, 1.0], 0.0, 0.0, 60.0, [64, 64], [[0]], {})
FEW = ("parameters", "picture", "empty set", "overflow")


@pytest.fixture(scope="module")
def stages() -> dict:
    return {}


@pytest.mark.parametrize(
    ("packer", "name", "status", "words"),
    [
        (faulty.WrongTexel, "picture", "invalid", "1 texels differ by up to 128 levels from what the shading function"),
        (faulty.UnwrittenTexel, "one triangle", "invalid", "touch 1 texels that were not written. First: triangles"),
        (
            faulty.Unsteady,
            "picture",
            "nondeterministic",
            "packed with work-groups of 16: other bytes in the blob noise",
        ),
        (faulty.NotANumber, "picture", "invalid", "the statistic 'waste' is nan, and no finite number"),
        (faulty.Elsewhere, "one triangle", "invalid", "First: triangles 0"),
        (faulty.Crashing, "empty set", "failed", "IndexError: there is no first triangle (faulty_packers.py, line"),
        (faulty.Silent, "overflow", "invalid", "have no place and are not listed"),
        (faulty.Hanging, "screen-filling", "timeout", "it took longer than 0.5 s."),
    ],
)
def test_a_fault_is_found_and_named(device, stages, packer, name, status, words):
    timeout = 0.5 if packer is faulty.Hanging else 60
    found = guarded_run(name, CHECKS[name].run, Kit(device, packer(), stages), timeout)
    assert found.status == status
    assert words in found.sentence


def test_the_command_says_what_is_wrong_and_shows_it(tmp_path, monkeypatch):
    monkeypatch.setattr(check, "CHECKS", {name: CHECKS[name] for name in FEW})
    monkeypatch.setattr(check, "EXAMPLES", 2)
    monkeypatch.setattr(check, "BENCHMARK", 0.05)
    result = CliRunner().invoke(app, ["check", f"{FAULTY}:Silent", "--out", str(tmp_path / "out")])
    text = " ".join(result.stdout.split())
    assert result.exit_code == 1
    assert "FAIL overflow: Frame 0:" in text
    assert "pass picture" in text
    assert "pass benchmark" in text
    assert {path.name for path in (tmp_path / "out").glob("*overflow*")} == {
        f"silent_overflow_{name}.png" for name in ("client", "reference", "atlas")
    }


@pytest.mark.parametrize("out", [None, "mine"])
def test_a_soup_that_fails_is_kept_where_the_user_says(out, tmp_path, monkeypatch):
    monkeypatch.setattr(check, "CHECKS", {})
    monkeypatch.setattr(check, "BENCHMARK", 0.05)
    monkeypatch.setattr(check, "find_failure", lambda *_: (SOUP, TrialResult("invalid", "It lies.")))
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, ["check", f"{FAULTY}:Silent", *(("--out", out) if out else ())])
    assert result.exit_code == 1
    kept = [str(path) for path in Path().rglob("*.json")]
    assert len(kept) == (out is not None) == len(list(Path().iterdir()))
    text = "".join(result.stdout.split())
    assert all(path in text for path in kept)
    assert ("--outDIR" in text) == (out is None)


def test_the_command_says_of_a_wrong_return_what_a_run_says(tmp_path, monkeypatch):
    monkeypatch.setattr(check, "CHECKS", {name: CHECKS[name] for name in FEW[:2]})
    monkeypatch.setattr(check, "EXAMPLES", 1)
    monkeypatch.setattr(check, "BENCHMARK", 0.05)
    out = tmp_path / "deep" / "out"
    with nothing_beside(out):
        result = CliRunner().invoke(app, ["check", f"{RETURNING}:PictureOutside", "--out", str(out)])
    assert result.exit_code == 1
    assert "'../../../../outside' cannot be the name of a picture" in " ".join(result.stdout.split())


@pytest.mark.parametrize("packer", ["nobody", "missing.py:Mine", "sas[no=1]"])
def test_packers_that_cannot_be_loaded_are_refused(packer):
    assert CliRunner().invoke(app, ["check", packer]).exit_code == 2
