"""What one process compiled is not compiled by a later one."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from shading_atlas_bench.kernels.cache import write_checked
from shading_atlas_bench.kernels.common.scan import exclusive_scan
from shading_atlas_bench.kernels.device import Device

PATH = "raster/clusters.cl"


@pytest.fixture
def make(device: Device, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Makes fresh devices, with a note of what they compile."""
    if not device.found.is_pocl:
        pytest.skip("Only PoCL's programs are kept: other runtimes keep their own.")
    monkeypatch.setattr("shading_atlas_bench.kernels.device.pocl_cache", lambda: tmp_path)

    def fresh(variant: str = "default") -> tuple[Device, list[str]]:
        compiled: list[str] = []
        made = Device(device.found, variant)
        made.announce = compiled.append
        return made, compiled

    return fresh


def scanned(device: Device) -> np.ndarray:
    values = device.upload(np.arange(1000, dtype=np.int32))
    return exclusive_scan(device, values, 1000, "test")[0].get()


def test_what_was_compiled_is_not_compiled_again(make) -> None:
    first, compiled = make()
    expected = scanned(first)
    assert compiled
    later, compiled = make()
    assert np.array_equal(scanned(later), expected)
    assert not compiled


def test_other_options_and_variants_are_other_programs(make) -> None:
    first, _ = make()
    for tile in (8, np.int64(16)):
        first.build(PATH, CLUSTER=64, TILE=tile)
    later, compiled = make()
    for tile in (8, 16, 32):
        later.build(PATH, CLUSTER=64, TILE=tile)
    assert compiled == ["raster/clusters"]
    contracted, compiled = make("contracted")
    contracted.build(PATH, CLUSTER=64, TILE=8)
    assert compiled == ["raster/clusters"]


def test_kept_programs_compute_what_their_options_say(make, tmp_path: Path) -> None:
    source = tmp_path / "value.cl"
    source.write_text("__kernel void write(__global int *out) { out[get_global_id(0)] = VALUE; }", encoding="utf-8")
    for _ in range(2):
        device, _ = make()
        for value in (3, 5):
            out = device.zeros(64, np.int32)
            device.launch("value", device.build(source, VALUE=value).write, 64, out)
            assert (out.get() == value).all()


@pytest.mark.parametrize("content", [b"", b"poclbin\0", b"\x7fELF" + bytes(100)])
def test_what_is_no_program_is_compiled_from_its_source(make, tmp_path: Path, content: bytes) -> None:
    first, _ = make()
    expected = scanned(first)
    for file in (tmp_path / "objects").iterdir():
        write_checked(file, content)
    later, compiled = make()
    assert np.array_equal(scanned(later), expected)
    assert compiled


def test_a_damaged_program_is_compiled_from_its_source(make, tmp_path: Path) -> None:
    first, _ = make()
    first.build(PATH, CLUSTER=64, TILE=8)
    (kept,) = (tmp_path / "objects").iterdir()
    kept.write_bytes(kept.read_bytes()[:-1])
    later, compiled = make()
    with pytest.warns(UserWarning, match="was damaged"):
        later.build(PATH, CLUSTER=64, TILE=8)
    assert compiled == ["raster/clusters"]


def test_threads_that_ask_for_one_program_get_one(make) -> None:
    one, compiled = make()
    with ThreadPoolExecutor(2) as pool:
        found = list(pool.map(lambda _: one.build(PATH, CLUSTER=64, TILE=8), range(4)))
    assert len(compiled) == 1
    assert all(kernels is found[0] for kernels in found)
