"""Fixtures shared by all tests."""

import os
import struct
import zlib
from pathlib import Path

import pytest

from shading_atlas_bench.kernels.device import Device
from shading_atlas_bench.scenes.model import SceneError
from shading_atlas_bench.scenes.repair import load_pymeshlab

# A folder of real scenes, used where it is present; tests that need it are skipped without it, or with BENCH_SCENES= .
REAL_SCENES = Path(os.environ.get("BENCH_SCENES", Path(__file__).parents[2] / "shared" / "scenes") or "no scenes")

# Files whose tests take a minute and more: begun first, so that no worker is left alone with one of them in the end.
LONG = {"test_same_results.py", "test_documentation.py", "test_supervisor.py", "test_sweep.py", "test_conformance.py"}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: item.path.name not in LONG)


@pytest.fixture(scope="session")
def device() -> Device:
    """The default OpenCL device, opened once."""
    return Device.open()


@pytest.fixture(scope="session")
def pymeshlab() -> None:
    """For tests of mesh repair: they are skipped where pymeshlab cannot be loaded, with the reason."""
    try:
        load_pymeshlab()
    except SceneError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="session")
def png() -> bytes:
    """A PNG of 2x1 texels: opaque red, and blue at half coverage."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", 2, 1, 8, 6, 0, 0, 0)
    rows = b"\0" + bytes([255, 0, 0, 255, 0, 0, 255, 128])
    parts = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + parts
