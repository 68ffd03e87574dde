"""The doctor finds a healthy machine healthy, and names the remedy for each part that is missing."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shading_atlas_bench.harness.doctor import examine as doctor
from shading_atlas_bench.harness.measure import noise
from shading_atlas_bench.kernels.device import Device
from shading_atlas_bench.kernels.doctor.smoke import DEGREE, ERROR_BOUND, smoke, smoke_twin
from shading_atlas_bench.kernels.runtime.opencl import POCL, FoundDevice
from shading_atlas_bench.kernels.runtime.vendors import how_to_get_one
from shading_atlas_bench.scenes.model import SceneError


def findings(name: str) -> list[doctor.Examined]:
    return [finding for finding in doctor.examine() if finding.name == name]


@settings(max_examples=15, deadline=None)
@given(steps=st.integers(1, 300), seed=st.integers(0, 2**31))
def test_smoke_kernel_against_its_twin(device: Device, steps: int, seed: int):
    rng = np.random.default_rng(seed)
    x = rng.uniform(-1, 1, 8 * steps).astype(np.float32)
    x[: 3 * steps] = rng.choice(np.array([-1, -0.0, 1, 1e-38, 0.5], np.float32), 3 * steps)
    coefficients = rng.uniform(-1, 1, DEGREE + 1).astype(np.float32)
    values, hashes = smoke(device, x, coefficients)
    true_values, true_hashes = smoke_twin(x, coefficients)
    assert np.abs(values - true_values).max() <= ERROR_BOUND
    assert np.array_equal(hashes, true_hashes)


def test_a_healthy_machine_has_nothing_missing(device: Device):
    found = doctor.examine()
    assert [finding for finding in found if finding.ok is False] == []
    assert len({finding.name for finding in found}) == 10
    (packages,) = (finding for finding in found if finding.name == "packages")
    assert f"numpy {np.__version__}" in packages.detail
    assert any(device.description["name"] in finding.detail for finding in found if finding.name == "OpenCL")


def test_a_kernel_that_computes_wrongly(monkeypatch: pytest.MonkeyPatch):
    def wrong(*arguments: Any) -> Any:
        values, hashes = smoke_twin(*arguments)
        return values + 1e-3, hashes

    monkeypatch.setattr("shading_atlas_bench.kernels.doctor.smoke.smoke_twin", wrong)
    (kernel,) = findings("kernel")
    assert kernel.ok is False
    assert "bound 4e-06" in kernel.detail


def test_no_linker(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("shutil.which", lambda name: None)
    (linker,) = findings("linker")
    assert linker.ok is None
    assert "apt install binutils" in linker.detail
    (kernel,) = findings("kernel")
    if "PoCL" in kernel.detail:
        assert kernel.ok is False
        assert "apt install binutils" in kernel.detail


def test_no_device_at_all(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("shading_atlas_bench.kernels.runtime.opencl.find_devices", list)
    monkeypatch.setattr("shading_atlas_bench.kernels.device.find_devices", list)
    (opencl,), (kernel,) = findings("OpenCL"), findings("kernel")
    assert (opencl.ok, kernel.ok) == (False, False)
    assert opencl.detail == f"No OpenCL device was found: {how_to_get_one()}."


def test_of_two_pocls_the_newest_is_recorded(monkeypatch: pytest.MonkeyPatch):
    def fake(version: str) -> FoundDevice:
        platform = SimpleNamespace(name=POCL, version=version)
        device: Any = SimpleNamespace(
            name="cpu ", platform=platform, driver_version="x", extensions="cl_khr_fp64", compiler_available=True
        )
        return FoundDevice(device, version)

    two = [fake("OpenCL 3.0 PoCL 6.0"), fake("OpenCL 3.0 PoCL 3.0")]
    monkeypatch.setattr("shading_atlas_bench.kernels.runtime.opencl.find_devices", lambda: two)
    first, second, choice = doctor._devices()
    assert first.detail.startswith("default: cpu, OpenCL 3.0 PoCL 6.0")
    assert second.detail.startswith("also present")
    assert choice.detail == "2 PoCLs: the newest is used (OpenCL 3.0 PoCL 6.0), not OpenCL 3.0 PoCL 3.0."


@pytest.mark.parametrize(("library", "package"), [("libGL.so.1", "libgl1"), ("libOpenGL.so.0", "libopengl0")])
def test_a_missing_system_library_names_its_package(monkeypatch: pytest.MonkeyPatch, library: str, package: str):
    error = ImportError(f"{library}: cannot open shared object file: No such file or directory")
    assert f"{library} is missing: install {package} " in doctor.remedy(error)

    def fail() -> None:
        raise SceneError(f"--repair needs {library}")

    monkeypatch.setattr(doctor, "load_pymeshlab", fail)
    assert list(doctor._mesh_repair()) == [doctor.Examined("mesh repair", None, f"--repair needs {library}")]


def test_a_missing_package(monkeypatch: pytest.MonkeyPatch):
    needed = ["numpy>=1", "no-such-thing[x]>=2", "far>=1; sys_platform == 'plan9'", 'other; extra == "test"']
    monkeypatch.setattr(doctor, "requires", lambda name: needed)
    missing, present = doctor._packages()
    assert missing == doctor.Examined("packages", False, "no-such-thing missing: run pip install -e . again.")
    assert "numpy" in present.detail


def test_a_cache_that_cannot_be_written(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    file = tmp_path / "file"
    file.write_text("", encoding="utf-8")
    monkeypatch.setenv("XDG_CACHE_HOME", str(file))
    (cache,) = doctor._cache()
    assert cache.ok is False
    assert "XDG_CACHE_HOME" in cache.detail


def test_a_busy_machine_is_a_warning(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(noise, "noise_warnings", lambda: ["The machine was busy."])
    assert list(doctor._calm()) == [doctor.Examined("calm", None, "The machine was busy.")]


def test_an_unexpected_error_is_a_finding(monkeypatch: pytest.MonkeyPatch):
    def broken() -> Any:
        raise RuntimeError("first line\nsecond line")

    monkeypatch.setattr(doctor, "_pictures", broken)
    assert findings("pictures") == [doctor.Examined("pictures", False, "first line second line")]
