"""Fixtures shared by all tests."""

import os
from pathlib import Path

import pytest

from shading_atlas_bench.kernels.device import Device
from shading_atlas_bench.scenes.model import SceneError
from shading_atlas_bench.scenes.repair import load_pymeshlab

# A folder of real scenes, used where it is present; tests that need it are skipped without it.
REAL_SCENES = Path(os.environ.get("BENCH_SCENES", Path(__file__).parents[2] / "shared" / "scenes"))


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
