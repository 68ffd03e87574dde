"""Fixtures shared by all tests."""

import os
from pathlib import Path

import pytest

from kernels.device import Device

# A folder of real scenes, used where it is present; tests that need it are skipped without it.
REAL_SCENES = Path(os.environ.get("BENCH_SCENES", Path(__file__).parents[2] / "shared" / "scenes"))


@pytest.fixture(scope="session")
def device() -> Device:
    """The default OpenCL device, opened once."""
    return Device.open()
