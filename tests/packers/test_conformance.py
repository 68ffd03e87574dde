"""The conformance kit on every built-in packer and the documentation's example; `--packer NAME` runs it on another."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from shading_atlas_bench.harness.conformance.check import CHECKS, Kit, guarded_run
from shading_atlas_bench.harness.conformance.fuzz import find_failure, read_soup, save_soup, try_soup
from shading_atlas_bench.harness.conformance.trial import Stage, TrialResult
from shading_atlas_bench.harness.plugins import load_packer

REGRESSIONS = Path(__file__).with_name("regressions")
EXAMPLES = 100
# Of the stress tests, those that every run of the suite makes; `--packer` makes them all.
ALWAYS = {"stress world-offset 1e6", "stress slivers 1e-6", "stress wide-view 170", "stress near-plane 0"}


@pytest.fixture(scope="session")
def stages() -> dict[Any, Stage]:
    """What checks have staged so far, for all packers."""
    return {}


@pytest.fixture(scope="module")
def kit(device, stages, packer_spec) -> Kit:
    (packer,) = load_packer(packer_spec)
    return Kit(device, packer, stages)


@pytest.mark.parametrize("name", CHECKS)
def test_packers_pass_the_check(kit, name, request):
    elsewhere = name == "kernels" or (name.startswith("stress") and name not in ALWAYS)  # test_cases.py has all kernels
    if elsewhere and not request.config.getoption("--packer", default=None):
        pytest.skip("run with --packer, and by bench check")
    found = guarded_run(name, CHECKS[name].run, kit, 60 * CHECKS[name].patience)
    assert found.good, found.sentence


def test_no_soup_breaks_a_packer(kit):
    """What breaks is kept, and tried on every packer from then on."""
    smallest = find_failure(kit.device, kit.kind, EXAMPLES, kit.parameters)
    if smallest:
        path = save_soup(REGRESSIONS, kit.kind.name, *smallest)
        pytest.fail(f"{smallest[1].status}: {smallest[1].sentence} Kept as {path.name}.")
    assert smallest is None


@pytest.mark.parametrize("path", sorted(REGRESSIONS.glob("*.json")), ids=lambda path: path.stem)
def test_what_once_broke_a_packer_breaks_none(kit, path):
    name, soup = read_soup(path)
    found = try_soup(kit.device, kit.kind, soup if name == kit.kind.name else soup.plain())
    assert found.good, found.sentence


def test_a_failing_soup_is_shrunk_and_kept(device, tmp_path, monkeypatch):
    """Of a packer that cannot bear three triangles, three triangles are left."""

    def breaks(_device, _packer, soup) -> TrialResult:
        return TrialResult("failed", "too many") if len(soup.corners) > 2 else TrialResult("ok")

    monkeypatch.setattr("shading_atlas_bench.harness.conformance.fuzz.try_soup", breaks)
    (packer,) = load_packer("sas")
    failure = find_failure(device, type(packer), 20)
    assert failure
    soup, found = failure
    assert len(soup.corners) == 3
    assert len(soup.sets) == 1
    path = save_soup(tmp_path / "kept", "sas", soup, found)
    assert read_soup(path) == ("sas", soup)
