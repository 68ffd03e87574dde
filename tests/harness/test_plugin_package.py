"""A packer in a package of its own, installed as anybody's is: tests/plugin, which docs/tutorial.md writes.

Its kernel builds, its digest changes with its sources, and its case is measured and held against its twin.
"""

from __future__ import annotations

import csv
import importlib
import inspect
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from shading_atlas_bench.arithmetic.arrays import Array, Floats, Ints
from shading_atlas_bench.harness.cases import against_twin, find_cases, own_cases
from shading_atlas_bench.harness.cli.main import app
from shading_atlas_bench.harness.conformance import check
from shading_atlas_bench.harness.conformance.check import CHECKS, Kit, guarded_run
from shading_atlas_bench.harness.kernel_timing.timing import TimingRequest, bench_kernels
from shading_atlas_bench.harness.plugins import load_packer, packer_names
from shading_atlas_bench.harness.run.digest import method_digest
from shading_atlas_bench.kernels.case import EXACT, INPUTS, Case, Result, Trial
from shading_atlas_bench.kernels.device import Device, source_with_includes
from shading_atlas_bench.packers.interface import Packer

PLUGIN = Path(__file__).parents[1] / "plugin"
TUTORIAL = Path(__file__).parents[2] / "docs" / "tutorial.md"
GRID = "packers/example/grid.py:Grid"
CASE = "shelves/samples"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder into which pip has installed the plugin, from a copy: building writes beside the sources."""
    pytest.importorskip("pip", reason="pip installs the plugin")
    folder = tmp_path_factory.mktemp("plugin")
    shutil.copytree(PLUGIN, folder / "source", ignore=shutil.ignore_patterns("__pycache__"))
    options = ("--quiet", "--no-deps", "--no-build-isolation", "--no-index", "--disable-pip-version-check")
    command = [sys.executable, "-m", "pip", "install", *options, "--target", f"{folder}/site", f"{folder}/source"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder / "site"


@pytest.fixture
def packer(site: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Packer]:
    """The installed packer, found by its name."""
    monkeypatch.syspath_prepend(site)
    (found,) = load_packer("shelves")
    yield found
    forget()


def forget() -> None:
    """Let the plugin be imported anew."""
    for name in [name for name in sys.modules if name.partition(".")[0] == "shelves"]:
        del sys.modules[name]


def test_its_name_is_found_and_its_files_are_installed(site: Path, packer: Packer):
    assert "shelves" in packer_names()
    sources = {path.relative_to(PLUGIN) for path in (PLUGIN / "shelves").rglob("*") if path.suffix in (".py", ".cl")}
    assert {path for path in sources if not (site / path).is_file()} == set()
    assert Path(inspect.getfile(type(packer))).is_relative_to(site)


@pytest.mark.usefixtures("packer")
def test_its_kernel_builds_with_the_headers_of_the_suite(device: Device, site: Path):
    file = site / "shelves" / "kernels" / "emit.cl"
    assert '#include "common/wide.cl"' in file.read_text(encoding="utf-8")
    assert "#define MIN" in source_with_includes(file)
    assert "emit_samples" in device.build(file).by_name


@pytest.mark.parametrize("name", ["kernels/emit.cl", "kernels/emit.py", "cells.py"])
def test_its_digest_changes_with_each_of_its_sources(packer: Packer, site: Path, name: str):
    before, file = method_digest(type(packer)), site / "shelves" / name
    content = file.read_bytes()
    file.write_bytes(content + b"\n")
    edited = method_digest(type(packer))
    file.write_bytes(content)
    assert edited != before
    assert method_digest(type(packer)) == before


@pytest.mark.usefixtures("packer")
def test_bench_kernels_measures_its_case(tmp_path: Path):
    assert CASE in {case.name for case in find_cases()}
    bench_kernels(TimingRequest(("shelves",), ("default",), repeat=1), tmp_path)
    with open(tmp_path / "kernels.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [(row["kernel"], row["input"]) for row in rows] == [("shelves/emit.emit_samples", kind) for kind in INPUTS]
    for row in rows:
        assert float(row["max_ulp"]) <= 1
        assert row["misassigned"] == "0"


def test_bench_check_runs_its_twins(device: Device, packer: Packer, monkeypatch: pytest.MonkeyPatch):
    cases = importlib.import_module("shelves.kernels.cases")
    compared: list[int] = []
    twin = cases.emit_samples_twin

    def counted(*given):
        compared.append(len(given[0]))
        return twin(*given)

    monkeypatch.setattr(cases, "emit_samples_twin", counted)
    found = guarded_run("kernels", CHECKS["kernels"].run, Kit(device, packer), 60)
    assert found.good, found.sentence
    assert compared == [cases.samples.checked] * 2 * len(INPUTS)  # each input twice


@pytest.mark.usefixtures("packer")
def test_bench_check_finds_a_wrong_twin(site: Path, monkeypatch: pytest.MonkeyPatch):
    """Planted in the installed file, as the tutorial says; what is printed stands there."""
    file = site / "shelves" / "kernels" / "emit.py"
    content, right = file.read_bytes(), b"<= side"
    assert content.count(right) == 1
    monkeypatch.setattr(check, "_results", lambda kit, *_: [("kernels", CHECKS["kernels"].run(kit))])
    file.write_bytes(content.replace(right, b"< side"))
    try:
        forget()
        result = CliRunner().invoke(app, ["check", "shelves"])
    finally:
        file.write_bytes(content)
    (said,) = (line for line in TUTORIAL.read_text(encoding="utf-8").splitlines() if line.startswith("FAIL kernels: "))
    assert result.exit_code == 1
    assert said in " ".join(result.stdout.split())
    assert f"{CASE}, on typical input" in said


def test_bench_check_finds_what_is_wrong_on_adversarial_input_only(
    device: Device, packer: Packer, monkeypatch: pytest.MonkeyPatch
):
    cases = importlib.import_module("shelves.kernels.cases")
    twin = cases.emit_samples_twin

    def wrong(ids: Ints, cells: Any, lengths: Floats, width: int) -> list[Array]:
        *others, texel = twin(ids, cells, lengths, width)
        return [*others, texel + int(np.median(cells.levels) == 0)]

    monkeypatch.setattr(cases, "emit_samples_twin", wrong)
    found = guarded_run("kernels", CHECKS["kernels"].run, Kit(device, packer), 60)
    assert found.status == "inaccurate"
    assert f"{CASE}, on adversarial input" in found.sentence


def test_a_packer_without_kernels_of_its_own_says_so(device: Device):
    (grid,) = load_packer(GRID)
    assert own_cases(type(grid)) == []
    found = CHECKS["kernels"].run(Kit(device, grid))
    assert found.good
    assert found.sentence.startswith("skipped: ")
    assert "is in no package with a module kernels.cases" in found.sentence


def test_the_suites_own_packers_have_cases():
    for found in load_packer("all"):
        names = {case.name.partition("/")[0] for case in own_cases(type(found))}
        assert names == {found.name}


def test_other_values_in_a_second_run_are_infinitely_far(device: Device):
    numbers = iter(range(100))

    def make(*_: object) -> Trial:
        return Trial({}, lambda: None, lambda: [Result(np.full(3, value := next(numbers)), np.full(3, float(value)))])

    apart = against_twin(device, Case("a/case", make, {}, 1, 1, dict.fromkeys(INPUTS, EXACT)), INPUTS[0])
    assert apart.over == np.inf
    assert apart.what == "a second run gives other values"
