"""What `bench doctor` examines: everything the suite needs of the machine, each missing part with its remedy."""

from __future__ import annotations

import os
import platform
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, requires, version
from typing import Any

import numpy as np

DISTRIBUTION = "shading-atlas-bench"
LIBRARIES = {  # shared libraries that a fresh Debian or Ubuntu lacks, and the packages that bring them
    "libGL.so.1": "libgl1",
    "libOpenGL.so.0": "libopengl0",
    "libEGL.so.1": "libegl1",
    "libGLU.so.1": "libglu1-mesa",
    "libX11.so.6": "libx11-6",
    "libxcb.so.1": "libxcb1",
    "libgomp.so.1": "libgomp1",
}


@dataclass(frozen=True)
class Finding:
    """One thing examined: ok is False if the suite cannot run without a remedy, None if only a part of it suffers."""

    name: str
    ok: bool | None
    detail: str


def examine() -> list[Finding]:
    """Examine the machine; never raises: what goes wrong is a finding."""
    parts: list[tuple[str, Callable[[], Iterator[Finding]]]] = [
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
    findings = []
    for name, part in parts:
        try:
            findings += part()
        except Exception as error:
            findings.append(Finding(name, False, remedy(error)))
    return findings


def remedy(error: Exception) -> str:
    """A sentence about an error; for a missing shared library the Debian package that brings it."""
    text = " ".join(str(error).split()) or type(error).__name__
    missing = re.search(r"(lib[\w+-]+\.so[.\d]*)", text) if isinstance(error, ImportError | OSError) else None
    if missing is None:
        return text
    package = LIBRARIES.get(missing[1])
    install = f"install {package} (Debian, Ubuntu: apt install {package})" if package else "install what brings it"
    return f"The system library {missing[1]} is missing: {install}."


def _python() -> Iterator[Finding]:
    ok = sys.version_info >= (3, 11)
    yield Finding("Python", ok, platform.python_version() + ("" if ok else ": the suite needs 3.11 or newer."))


def _packages() -> Iterator[Finding]:
    needed = [re.match(r"[\w.-]+", line)[0] for line in requires(DISTRIBUTION) or [] if "extra ==" not in line]
    found, missing = [], []
    for name in sorted(needed, key=str.lower):
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            missing.append(name)
    if missing:
        yield Finding("packages", False, f"{', '.join(missing)} missing: run pip install -e . again.")
    yield Finding("packages", True, ", ".join([f"{DISTRIBUTION} {version(DISTRIBUTION)}", *found]))


def _linker() -> Iterator[Finding]:
    linker = shutil.which("ld")
    hint = "PoCL needs the linker ld: install binutils (Debian, Ubuntu: apt install binutils)."
    yield Finding("linker", True if linker else None, linker or hint)


def _devices() -> Iterator[Finding]:
    from kernels.device import list_devices

    devices = list_devices()
    if not devices:
        yield Finding("OpenCL", False, "No OpenCL device was found: pip install 'pyopencl[pocl]' brings one.")
    for place, device in enumerate(devices):
        role = "default" if place == 0 else "also present"
        text = f"{device.name.strip()}, {_platform(device)}, driver {device.driver_version.strip()}"
        yield Finding("OpenCL", True, f"{role}: {text}")
    names = [_platform(device) for device in devices]
    pocls = list(dict.fromkeys(name for name in names if "PoCL" in name))
    if len(pocls) > 1:
        yield Finding(
            "OpenCL", True, f"{len(pocls)} PoCLs: the newest is used ({pocls[0]}), not {', '.join(pocls[1:])}."
        )


def _platform(device: Any) -> str:
    """The platform's version without the list of how it was built."""
    return " ".join(device.platform.version.split(",")[0].split())


def _kernel() -> Iterator[Finding]:
    from arithmetic import draws
    from kernels.device import Device
    from kernels.doctor.smoke import DEGREE, ERROR_BOUND, smoke, smoke_twin

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
    yield Finding("kernel", ok, text + advice)


def _video() -> Iterator[Finding]:
    import av

    encoder = av.CodecContext.create("libx264", "w")
    encoder.width, encoder.height, encoder.pix_fmt = 64, 64, "yuv420p"
    encoder.framerate, encoder.options = 60, {"preset": "veryfast", "tune": "zerolatency"}
    decoder = av.CodecContext.create("h264", "r")
    grey = av.VideoFrame.from_ndarray(np.full((64, 64, 3), 128, np.uint8), format="rgb24")
    packets = [*encoder.encode(grey.reformat(format="yuv420p")), *encoder.encode(None)]
    frames = [frame for packet in [*packets, None] for frame in decoder.decode(packet)]
    ok = len(frames) == 1 and abs(int(frames[0].to_ndarray(format="rgb24").mean()) - 128) <= 2
    size = sum(packet.size for packet in packets)
    text = f"H.264 through PyAV {av.__version__}: {size} bytes for a grey frame" if ok else "H.264 does not round-trip."
    yield Finding("video", ok, text)


def _pictures() -> Iterator[Finding]:
    import OpenImageIO

    yield Finding("pictures", True, f"OpenImageIO {OpenImageIO.VERSION_STRING}")


def _mesh_repair() -> Iterator[Finding]:
    try:
        import pymeshlab
    except (ImportError, OSError) as error:
        yield Finding("mesh repair", None, f"--repair and --decimate do not work. {remedy(error)}")
        return
    filters = len(pymeshlab.filter_list())
    yield Finding("mesh repair", True, f"pymeshlab {version('pymeshlab')} with {filters} filters")


def _cache() -> Iterator[Finding]:
    from kernels.cache import CacheError, cache_folder

    try:
        folder = cache_folder("doctor")
        with tempfile.NamedTemporaryFile(dir=folder):
            free = shutil.disk_usage(folder).free
    except CacheError as error:
        yield Finding("cache", False, str(error))
        return
    except OSError as error:
        hint = "XDG_CACHE_HOME moves the cache to a folder that can."
        yield Finding("cache", False, f"{error.filename or 'The cache folder'} cannot be written. {hint}")
        return
    enough = free > 1 << 30
    text = f"{folder.parent}, {free / (1 << 30):.0f} GiB free"
    yield Finding("cache", True if enough else None, text if enough else f"{text}: large scenes need more.")


def _calm() -> Iterator[Finding]:
    from harness.noise import noise_warnings

    warnings = noise_warnings()
    load = f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"
    yield Finding("calm", None if warnings else True, " ".join(warnings) or load)
