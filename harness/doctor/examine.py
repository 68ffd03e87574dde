"""What `bench doctor` examines: everything the suite needs of the machine, each missing part with its remedy."""

from __future__ import annotations

import os
import platform
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, requires, version

import numpy as np

from shading_atlas_bench.scenes.model import SceneError
from shading_atlas_bench.scenes.repair import load_pymeshlab
from shading_atlas_bench.scenes.system_libraries import missing_library

DISTRIBUTION = "shading-atlas-bench"
LARGEST_VIDEO_ERROR = 4  # levels of 255, of flat colours at a rate factor of 5


@dataclass(frozen=True)
class Examined:
    """One thing examined: ok is False if the suite cannot run without a remedy, None if only a part of it suffers."""

    name: str
    ok: bool | None
    detail: str


def examine() -> list[Examined]:
    """Examine the machine; never raises: what goes wrong is a finding."""
    parts: list[tuple[str, Callable[[], Iterator[Examined]]]] = [
        ("Python", _python),
        ("packages", _packages),
        ("linker", _linker),
        ("OpenCL", _devices),
        ("kernel", _kernel),
        ("video", _video),
        ("pictures", _pictures),
        ("mesh repair", _mesh_repair),
        ("cache", _cache),
        ("calm", _calm),
    ]
    findings: list[Examined] = []
    for name, part in parts:
        try:
            findings += part()
        except Exception as error:
            findings.append(Examined(name, False, remedy(error)))
    return findings


def remedy(error: Exception) -> str:
    """A sentence about an error; for a missing shared library the Debian package that brings it."""
    text = " ".join(str(error).split()) or type(error).__name__
    missing = missing_library(error)
    return f"The system library {missing[0]} is missing: {missing[1]}." if missing else text


def _python() -> Iterator[Examined]:
    ok = sys.version_info >= (3, 11)
    yield Examined("Python", ok, platform.python_version() + ("" if ok else ": the suite needs 3.11 or newer."))


def _packages() -> Iterator[Examined]:
    from packaging.requirements import Requirement

    lines = map(Requirement, requires(DISTRIBUTION) or [])
    needed = {line.name for line in lines if line.marker is None or line.marker.evaluate({"extra": ""})}
    found, missing = [], []
    for name in sorted(needed, key=str.lower):
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            missing.append(name)
    if missing:
        yield Examined("packages", False, f"{', '.join(missing)} missing: run pip install -e . again.")
    yield Examined("packages", True, ", ".join([f"{DISTRIBUTION} {version(DISTRIBUTION)}", *found]))


def _linker() -> Iterator[Examined]:
    linker = shutil.which("ld")
    hint = "PoCL needs the linker ld: install binutils (Debian, Ubuntu: apt install binutils)."
    yield Examined("linker", True if linker else None, linker or hint)


def _devices() -> Iterator[Examined]:
    from shading_atlas_bench.harness.watch.watchdog import ended_steps
    from shading_atlas_bench.kernels.device import kernels_digest
    from shading_atlas_bench.kernels.runtime.opencl import find_devices, forget_death, noted_death
    from shading_atlas_bench.kernels.runtime.vendors import how_to_get_one

    devices = find_devices()
    if not devices:
        yield Examined("OpenCL", False, f"No OpenCL device was found: {how_to_get_one()}.")
    default = True
    for found in devices:
        text = f"{found.device.name.strip()}, {found.platform}, driver {found.device.driver_version.strip()}"
        if refused := found.refused():
            yield Examined("OpenCL", None, f"passed over: {text}. {refused}")
            continue
        death = noted_death(found.key, kernels_digest())
        if ended_steps(device=found.key):
            yield Examined("OpenCL", None, f"passed over: {text}. {death}")
            continue
        if death:
            forget_death(found.key, kernels_digest())
            yield Examined("OpenCL", None, f"tried again, here and in the next run: {text}. {death}")
        role = "default" if default else "also present"
        default = False
        yield Examined("OpenCL", True, f"{role}: {text}, built-ins: {found.builtins}")
    pocls = list(dict.fromkeys(found.platform for found in devices if found.is_pocl))
    if len(pocls) > 1:
        yield Examined(
            "OpenCL", True, f"{len(pocls)} PoCLs: the newest is used ({pocls[0]}), not {', '.join(pocls[1:])}."
        )


def _kernel() -> Iterator[Examined]:
    from shading_atlas_bench.arithmetic import draws
    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.kernels.doctor.smoke import DEGREE, ERROR_BOUND, smoke, smoke_twin

    device = Device.open()
    rng = draws.generator(0)
    x = rng.uniform(-1, 1, 4096).astype(np.float32)
    coefficients = rng.uniform(-1, 1, DEGREE + 1).astype(np.float32)
    values, hashes = smoke(device, x, coefficients)
    true_values, true_hashes = smoke_twin(x, coefficients)
    error = float(np.abs(values - true_values).max())
    ok = bool(error <= ERROR_BOUND and np.array_equal(hashes, true_hashes))
    text = f"{device.name}: a kernel differs from its float64 twin by {error:.1e} (bound {ERROR_BOUND:.0e})"
    advice = "" if ok else ": delete the kernel cache and try again, or choose another device with BENCH_DEVICE."
    yield Examined("kernel", ok, text + advice)


def _video() -> Iterator[Examined]:
    """Code and decode colours as a run does."""
    import av

    from shading_atlas_bench.harness.measure.codecs import VideoStream

    colours = np.array([[[128, 128, 128], [255, 0, 0]], [[0, 200, 50], [10, 20, 240]]], np.uint8)
    picture = colours.repeat(32, axis=0).repeat(32, axis=1)
    frame = VideoStream("h264", 5, 64, 64, decode=True).encode(picture)
    error = int(np.abs(frame.shown.astype(int) - picture).max())
    ok = error <= LARGEST_VIDEO_ERROR
    text = f"H.264 through PyAV {av.__version__}: {frame.bytes} bytes for 4 colours, {error} levels of 255 off"
    yield Examined("video", ok, text if ok else f"{text}: run pip install -e . again.")


def _pictures() -> Iterator[Examined]:
    import OpenImageIO

    yield Examined("pictures", True, f"OpenImageIO {OpenImageIO.VERSION_STRING}")


def _mesh_repair() -> Iterator[Examined]:
    try:
        pymeshlab = load_pymeshlab()
    except SceneError as error:
        yield Examined("mesh repair", None, str(error))
        return
    filters = len(pymeshlab.filter_list())
    yield Examined("mesh repair", True, f"pymeshlab {version('pymeshlab')} with {filters} filters")


def _cache() -> Iterator[Examined]:
    from shading_atlas_bench.kernels.cache import CacheError, cache_folder

    try:
        folder = cache_folder("doctor")
        with tempfile.NamedTemporaryFile(dir=folder):
            free = shutil.disk_usage(folder).free
    except CacheError as error:
        yield Examined("cache", False, str(error))
        return
    except OSError as error:
        hint = "XDG_CACHE_HOME moves the cache to a folder that can."
        yield Examined("cache", False, f"{error.filename or 'The cache folder'} cannot be written. {hint}")
        return
    enough = free > 1 << 30
    text = f"{folder.parent}, {free / (1 << 30):.0f} GiB free"
    yield Examined("cache", True if enough else None, text if enough else f"{text}: large scenes need more.")


def _calm() -> Iterator[Examined]:
    from shading_atlas_bench.harness.measure.machine import load
    from shading_atlas_bench.harness.measure.noise import noise_warnings

    warnings = noise_warnings()
    yield Examined(
        "calm", None if warnings else True, " ".join(warnings) or f"load {load():.1f} on {os.cpu_count()} cores"
    )
