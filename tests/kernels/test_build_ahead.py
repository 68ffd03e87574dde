"""What a run built is built before a later one of the same plan asks for it."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from shading_atlas_bench.kernels.device import Device

PATH = "raster/clusters.cl"


@pytest.fixture
def make(device: Device, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Makes fresh devices, with a note of what they compile."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))

    def fresh(variant: str = "default") -> tuple[Device, list[str]]:
        compiled: list[str] = []
        made = Device(device.found, variant)
        made.announce = compiled.append
        return made, compiled

    return fresh


def test_what_was_built_is_built_ahead(make) -> None:
    first, compiled = make()
    for tile in (8, np.int64(16)):
        first.build(PATH, CLUSTER=64, TILE=tile)
    first.remember_programs("plan")
    later, compiled = make()
    later.build_ahead("plan")
    assert compiled == ["raster/clusters"] * 2
    for tile in (8, 16):
        later.build(PATH, CLUSTER=64, TILE=tile)
    assert len(compiled) == 2, "it was asked for otherwise than it was built ahead"
    later.build(PATH, CLUSTER=64, TILE=32)
    assert len(compiled) == 3


def test_other_plans_and_variants_build_nothing_ahead(make) -> None:
    first, _ = make()
    first.build(PATH, CLUSTER=64, TILE=8)
    first.remember_programs("plan")
    for variant, plan in (("default", "another"), ("contracted", "plan")):
        other, compiled = make(variant)
        other.build_ahead(plan)
        assert not compiled


def test_a_damaged_note_builds_nothing_ahead(make, tmp_path: Path) -> None:
    first, _ = make()
    first.build(PATH, CLUSTER=64, TILE=8)
    first.remember_programs("plan")
    (note,) = tmp_path.rglob("programs/*")
    note.write_bytes(note.read_bytes()[:-1])
    later, compiled = make()
    with pytest.warns(UserWarning, match="was damaged"):
        later.build_ahead("plan")
    assert not compiled


def test_threads_that_ask_for_one_program_get_one(make) -> None:
    one, compiled = make()
    with ThreadPoolExecutor(2) as pool:
        found = list(pool.map(lambda _: one.build(PATH, CLUSTER=64, TILE=8), range(4)))
    assert len(compiled) == 1
    assert all(kernels is found[0] for kernels in found)
