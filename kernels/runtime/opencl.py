"""pyopencl, and the devices that can be used."""

from __future__ import annotations

import atexit
import hashlib
import json
import os
import re
import warnings
from collections import Counter
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from threading import RLock
from types import ModuleType
from typing import TYPE_CHECKING, Any

from shading_atlas_bench.errors import BenchError
from shading_atlas_bench.kernels.cache import CacheError, cache_folder, read_checked, write_checked
from shading_atlas_bench.kernels.runtime import kernel_cache
from shading_atlas_bench.kernels.runtime.vendors import Vendors, find_vendors

if TYPE_CHECKING:
    import pyopencl
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic import arrays

POCL = "Portable Computing Language"
# One thread at a time speaks to OpenCL: drivers that run a kernel in the thread that launches it lock themselves when
# two threads use one queue.
SPEAKING = RLock()


class DeviceError(BenchError, RuntimeError):
    """No usable OpenCL device, or a kernel that does not build; the message says what to do."""


@cache
def vendors() -> Vendors:
    """What the loader is shown beside the system's runtimes; found once per process."""
    return find_vendors()


@cache
def pocl_cache() -> Path:
    """The folder of PoCL's compiled kernels: the one that POCL_CACHE_DIR names, else the suite's own.

    PoCL does not tell by a kernel which library of built-ins it was linked with, so each has a folder of its own.
    Raises CacheError if it cannot be made.
    """
    named = os.environ.get("POCL_CACHE_DIR")
    folder = Path(named) if named else cache_folder("pocl") / (vendors().library or "own")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        hint = "set POCL_CACHE_DIR to another folder, or unset it" if named else "set XDG_CACHE_HOME to another one"
        raise CacheError(f"The kernel cache {folder} cannot be made ({error.strerror}): {hint}.") from error
    return folder


@cache
def opencl() -> ModuleType:
    """pyopencl, with the loader told what there is and the kernel cache healed.

    Raises DeviceError or CacheError.
    """
    folder = pocl_cache()
    os.environ["POCL_CACHE_DIR"] = str(folder)
    kernel_cache.heal(folder)
    os.environ.setdefault("PYOPENCL_NO_CACHE", "1")  # pyopencl's own, of calls in Python, does not survive damage
    try:
        import pyopencl as cl
        import pyopencl.array
    except ImportError as error:
        raise DeviceError(f"pyopencl cannot be imported ({error}): run pip install -e . again.") from error
    vendors().show()
    # A build that fails raises with its log; of one that succeeds nobody needs it.
    warnings.filterwarnings("ignore", category=cl.CompilerWarning)
    # Whoever compiles without linking is told that pyopencl then keeps nothing itself.
    warnings.filterwarnings("ignore", message="Pre-build attribute access defeats compiler caching")
    atexit.register(kernel_cache.seal, folder)
    return cl


@cache
def array_class() -> type[Array]:
    """pyopencl's arrays, copied to and from the device by one thread at a time.

    They keep no events: queues are in order, and an event keeps alive the array on the host that it was copied from or
    to.
    """
    opencl()  # before pyopencl itself is imported
    from pyopencl.array import Array

    class DeviceArray(Array):
        def add_event(self, evt: pyopencl.Event) -> None:
            pass

        def get(self, *args: Any, **kwargs: Any) -> arrays.Array:
            with SPEAKING:
                return super().get(*args, **kwargs)

        def set(self, *args: Any, **kwargs: Any) -> None:
            with SPEAKING:
                super().set(*args, **kwargs)

    return DeviceArray


@dataclass(frozen=True)
class FoundDevice:
    """A device of this machine. key: tells it from all others, in this process and in later ones."""

    device: pyopencl.Device
    key: str

    @property
    def name(self) -> str:
        """Its name and the version of its runtime."""
        return f"{self.device.name.strip()} ({self.platform})"

    @property
    def platform(self) -> str:
        """The platform's version without the list of how it was built."""
        return " ".join(self.device.platform.version.split(",")[0].split())

    @property
    def is_pocl(self) -> bool:
        """Whether it is a PoCL's."""
        return POCL in self.device.platform.name

    @property
    def builtins(self) -> str:
        """Which library of built-ins it links, as far as that is known."""
        known = vendors()
        if not self.is_pocl or known.library is None or self.device.driver_version != known.driver:
            return "as it chooses"
        return f"{known.library}, for its own does not suit its compiler" if known.mirrored else known.library

    def refused(self) -> str | None:
        """Why no kernel of the suite can run on it, in one sentence; None where they can."""
        if "cl_khr_fp64" not in self.device.extensions and not self.device.double_fp_config:
            return f"{self.name} has no double precision, which the kernels need."
        if not self.device.compiler_available:
            return f"{self.name} has no compiler."
        return None


def find_devices() -> list[FoundDevice]:
    """All OpenCL devices: GPUs first, then the newest PoCL, then the others. Raises DeviceError, CacheError."""
    cl = opencl()
    try:
        platforms = cl.get_platforms()
    except cl.Error:
        platforms = []
    devices: list[pyopencl.Device] = []
    for platform in platforms:
        try:
            devices += platform.get_devices()
        except cl.Error:  # a platform without devices raises DEVICE_NOT_FOUND
            continue
    seen: Counter[str] = Counter()
    found = []
    for device in sorted(devices, key=_rank):
        platform = device.platform
        facts = [platform.name, platform.version, device.name, device.driver_version, vendors().library or ""]
        digest = hashlib.sha256(json.dumps(facts).encode()).hexdigest()[:12]
        found.append(FoundDevice(device, f"{digest}-{seen[digest]}"))
        seen[digest] += 1
    return found


def _rank(device: pyopencl.Device) -> tuple[bool, bool, tuple[int, ...], str, str]:
    newest_first = tuple(-part for part in _version(device.platform.version))
    gpu = bool(device.type & opencl().device_type.GPU)
    return (not gpu, POCL not in device.platform.name, newest_first, device.platform.name, device.name)


def _version(text: str) -> tuple[int, ...]:
    """The PoCL version (else the OpenCL version) in a platform's version string, as a tuple that sorts."""
    found = re.search(r"PoCL\s+(\d+(?:\.\d+)*)", text) or re.search(r"OpenCL\s+(\d+(?:\.\d+)*)", text)
    return tuple(int(part) for part in found.group(1).split(".")) if found else (0,)


def _death_note(key: str, kernels: str) -> Path:
    return cache_folder("opencl") / f"died-{key}-{kernels}"


def note_death(key: str, kernels: str, sentence: str) -> None:
    """Remember that a device's compiler dies of this set of kernels, so that later runs pass the device over."""
    write_checked(_death_note(key, kernels), sentence.encode())


def forget_death(key: str, kernels: str) -> None:
    """The device is well again."""
    _death_note(key, kernels).unlink(missing_ok=True)


def noted_death(key: str, kernels: str) -> str | None:
    """What was noted when this device's compiler died of this set of kernels; None if it never did."""
    content = read_checked(_death_note(key, kernels))
    return content.decode() if content else None
