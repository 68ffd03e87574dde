"""The OpenCL device: finding it, building kernels for it, launching them and timing them by its own events."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any

import numpy as np

from kernels.cache import cache_folder

if TYPE_CHECKING:
    import pyopencl as cl
    from pyopencl.array import Array

ROOT = Path(__file__).parent
CONTRACT = "#pragma OPENCL FP_CONTRACT"
INCLUDE = re.compile(r'^\s*#include\s+"([^"]+)"\s*$', re.MULTILINE)
KERNEL = re.compile(r"^\s*(?:__)?kernel\s+void\s+(\w+)", re.MULTILINE)
DEFAULT_LOCAL_SIZE = 64


@dataclass(frozen=True)
class Arithmetic:
    """How freely the compiler may round: its options, and fused multiply-add where files do not say and where they
    allow it."""

    options: tuple[str, ...]
    contract: str
    contract_where_allowed: str


# What `bench kernels` compares; results always come from the default.
VARIANTS = {
    "precise": Arithmetic(("-cl-fp32-correctly-rounded-divide-sqrt",), "OFF", "OFF"),
    "default": Arithmetic((), "OFF", "ON"),
    "relaxed": Arithmetic(("-cl-fast-relaxed-math",), "ON", "ON"),
}

# PoCL compiles its AVX-512 library of built-ins for a processor with clwb. Where LLVM finds one without it (as in
# virtual machines), no built-in is inlined: vload16, sqrt, min, clamp become calls that spill all registers. No kernel
# uses clwb; saying that it may makes kernels of many wide loads 2 to 5 times as fast, with the same results.
INLINED_BUILTINS = """#if defined(__x86_64__) && defined(__AVX512F__) && !defined(__CLWB__)
#pragma clang attribute push(__attribute__((target("clwb"))), apply_to = function)
#endif
{source}
#if defined(__x86_64__) && defined(__AVX512F__) && !defined(__CLWB__)
#pragma clang attribute pop
#endif
"""


class DeviceError(RuntimeError):
    """No usable OpenCL device, or a kernel that does not build; the message says what to do."""


@cache
def _opencl() -> Any:
    """Import pyopencl with the kernel caches in the suite's own folder."""
    os.environ.setdefault("POCL_CACHE_DIR", str(cache_folder("pocl")))
    Path(os.environ["POCL_CACHE_DIR"]).mkdir(parents=True, exist_ok=True)
    try:
        import pyopencl as cl
        import pyopencl.array
    except ImportError as error:
        raise DeviceError(f"pyopencl cannot be imported ({error}): run pip install -e . again.") from error
    return cl


def _version(text: str) -> tuple[int, ...]:
    """The PoCL version (else the OpenCL version) in a platform's version string, as a tuple that sorts."""
    found = re.search(r"PoCL\s+(\d+(?:\.\d+)*)", text) or re.search(r"OpenCL\s+(\d+(?:\.\d+)*)", text)
    return tuple(int(part) for part in found.group(1).split(".")) if found else (0,)


def list_devices() -> list[cl.Device]:
    """All OpenCL devices: GPUs first, then the newest PoCL, then the others; the first is the default."""
    cl = _opencl()
    try:
        platforms = cl.get_platforms()
    except cl.LogicError:
        platforms = []
    devices = []
    for platform in platforms:
        try:
            devices += platform.get_devices()
        except cl.LogicError:  # a platform without devices raises DEVICE_NOT_FOUND
            continue

    def rank(device: cl.Device) -> tuple:
        pocl = "Portable Computing Language" in device.platform.name
        newest_first = tuple(-part for part in _version(device.platform.version))
        return (not device.type & cl.device_type.GPU, not pocl, newest_first, device.platform.name, device.name)

    return sorted(devices, key=rank)


def source_with_includes(path: str, seen: set[str] | None = None) -> str:
    """A kernel file's text (path below `kernels/`) with every `#include "..."` put in its place, once each.

    Done here and not by the driver, because drivers that cache by source miss changes in included files.
    """
    seen = set() if seen is None else seen
    if path in seen:
        return ""
    seen.add(path)
    file = ROOT / path
    if not file.is_file():
        raise DeviceError(f"The kernel file kernels/{path} is missing: reinstall the package.")
    return INCLUDE.sub(lambda match: source_with_includes(match.group(1), seen), file.read_text())


def kernel_names() -> list[str]:
    """Every kernel of the suite as folder/file.function, as in `Record.kernels`."""
    files = sorted(ROOT.rglob("*.cl"))
    return [
        f"{file.relative_to(ROOT).with_suffix('')}.{name}"
        for file in files
        for name in KERNEL.findall(file.read_text())
    ]


def kernels_digest() -> str:
    """A hash of every kernel file of the suite: results and cached results say which kernels they came from."""
    digest = hashlib.sha256()
    for file in sorted(ROOT.rglob("*.cl")):
        digest.update(str(file.relative_to(ROOT)).encode() + file.read_bytes())
    return digest.hexdigest()[:16]


@dataclass(eq=False)  # nested records may hold the same launches, and are two all the same
class Record:
    """Device time and launches by stage name, and time by kernel, filled when its `with` block ends.

    kernels: milliseconds by the kernel's name, folder/file.function.
    """

    milliseconds: dict[str, float] = field(default_factory=dict)
    launches: dict[str, int] = field(default_factory=dict)
    kernels: dict[str, float] = field(default_factory=dict)
    _events: list[tuple[str, str | None, Any]] = field(default_factory=list)

    def total(self, prefix: str) -> float:
        """Milliseconds of all stages named `prefix` or `prefix/...`."""
        return sum(ms for name, ms in self.milliseconds.items() if name == prefix or name.startswith(prefix + "/"))

    def _close(self) -> None:
        spent: dict[str, float] = defaultdict(float)
        count: dict[str, int] = defaultdict(int)
        by_kernel: dict[str, float] = defaultdict(float)
        for stage, kernel, event in self._events:
            milliseconds = (event.profile.end - event.profile.start) * 1e-6
            spent[stage] += milliseconds
            count[stage] += 1
            if kernel:
                by_kernel[kernel] += milliseconds
        self.milliseconds, self.launches, self.kernels, self._events = dict(spent), dict(count), dict(by_kernel), []


class Device:
    """One OpenCL device with a profiling, in-order queue.

    `local_size` is the work-group size of one-item-per-element kernels; `BENCH_LOCAL_SIZE` overrides it and
    changes no result. `variant`, one of VARIANTS, is how freely its kernels round.
    """

    def __init__(self, device: cl.Device, variant: str = "default") -> None:
        cl = _opencl()
        if variant not in VARIANTS:
            raise DeviceError(f"There is no build variant {variant!r}: give one of {', '.join(VARIANTS)}.")
        if "Portable Computing Language" in device.platform.name and not shutil.which("ld"):
            raise DeviceError("PoCL needs the linker ld: install binutils (Debian, Ubuntu: apt install binutils).")
        self.device, self.variant = device, variant
        self.context = cl.Context([device])
        self.queue = cl.CommandQueue(self.context, properties=cl.command_queue_properties.PROFILING_ENABLE)
        self.name = f"{device.name.strip()} ({device.platform.version.strip().split(',')[0]})"
        self.is_cpu = bool(device.type & cl.device_type.CPU)
        self.local_size = _local_size(device.max_work_group_size)
        # Chunked kernels cut their input into this many runs: enough for the scheduler to balance, few enough for
        # small tables. A constant, never the number of cores, so that nothing can depend on the machine.
        self.chunks = 64
        self._programs: dict[tuple, Any] = {}
        self._names: dict[cl.Kernel, str] = {}
        self._records: list[Record] = []
        self._launching = Lock()  # a kernel keeps its arguments until it is enqueued, and threads share kernels

    @classmethod
    def open(cls, name: str | None = None, variant: str = "default") -> Device:
        """The device whose platform and name contain `name` (any case); without one, the default device.

        Raises DeviceError, listing what there is, if none matches or the variant is unknown.
        """
        devices = list_devices()
        if not devices:
            raise DeviceError("No OpenCL device was found: pip install 'pyopencl[pocl]' brings one for any CPU.")
        wanted = (name or os.environ.get("BENCH_DEVICE", "")).lower()
        for device in devices:
            if wanted in f"{device.platform.name} {device.name}".lower():
                return cls(device, variant)
        known = "; ".join(f"{device.name.strip()} on {device.platform.name}" for device in devices)
        raise DeviceError(f"No OpenCL device matches {name!r}. There are: {known}.")

    @cached_property
    def description(self) -> dict[str, str]:
        """What a result must say about the device it came from."""
        device = self.device
        return {
            "name": device.name.strip(),
            "platform": device.platform.name.strip(),
            "version": device.platform.version.strip(),
            "driver": device.driver_version.strip(),
            "compute_units": str(device.max_compute_units),
        }

    def build(self, path: str, options: Sequence[str] = (), **defines: Any) -> Kernels:
        """Build `kernels/<path>` with preprocessor `defines`; built once per (path, options, defines).

        Fused multiply-add contraction is off unless the file turns it on, so that integers and shared vertices
        come out the same everywhere.
        """
        cl = _opencl()
        arithmetic = VARIANTS[self.variant]
        flags = [*arithmetic.options, *options, *(f"-D{key}={value}" for key, value in sorted(defines.items()))]
        key = (path, *flags)
        if key not in self._programs:
            files: set[str] = set()
            source = source_with_includes(path, files)
            source = source.replace(f"{CONTRACT} ON", f"{CONTRACT} {arithmetic.contract_where_allowed}")
            source = f"{CONTRACT} {arithmetic.contract}\n{source}"
            source = INLINED_BUILTINS.replace("{source}", source)
            try:
                program = cl.Program(self.context, source).build(["-cl-std=CL1.2", *flags], cache_dir=False)
            except cl.RuntimeError as error:
                raise DeviceError(f"kernels/{path} does not build on {self.name}: {error}") from error
            digest = hashlib.sha256("\n".join([*flags, source]).encode()).hexdigest()[:16]
            kernels = Kernels({k.function_name: k for k in program.all_kernels()}, digest)
            self._programs[key] = kernels
            self._names |= {
                kernels.by_name[name]: f"{file.removesuffix('.cl')}.{name}"
                for file in files
                for name in KERNEL.findall((ROOT / file).read_text())
                if name in kernels.by_name  # included files may leave some out
            }
        return self._programs[key]

    def launch(self, stage: str, kernel: cl.Kernel, items: int, *args: Any, local: int | None = None) -> None:
        """Run `kernel` over at least `items` work-items and time it under `stage`.

        The global size is padded to the work-group size, so a kernel must return when its id is >= its item count.
        Python ints go as int32 and floats as float32; arrays as their buffers. `local=1` suits one item per chunk or
        tile; the default suits one item per element. Nothing runs for `items` = 0. Any thread may launch.
        """
        if items <= 0:
            return
        cl = _opencl()
        local = local or self.local_size
        padded = -(-items // local) * local
        with self._launching:
            kernel.set_args(*(_argument(value) for value in args))
            event = cl.enqueue_nd_range_kernel(self.queue, kernel, (padded,), (local,))
        for record in self._records:
            record._events.append((stage, self._names.get(kernel), event))

    def upload(self, values: np.ndarray) -> Array:
        """A device copy of a NumPy array (never empty: zero-sized arrays become one unused element)."""
        cl = _opencl()
        values = np.ascontiguousarray(values)
        if values.size == 0:
            return self.zeros((1,), values.dtype)
        return cl.array.to_device(self.queue, values)

    def empty(self, shape: int | tuple[int, ...], dtype: Any) -> Array:
        """An uninitialised device array; a shape without elements gets one, because OpenCL has no empty buffer."""
        cl = _opencl()
        shape = (shape,) if isinstance(shape, (int, np.integer)) else tuple(shape)
        return cl.array.empty(self.queue, shape if np.prod(shape) else (1,), np.dtype(dtype))

    @cached_property
    def _pool(self) -> Any:
        import pyopencl.tools as tools

        return tools.MemoryPool(tools.ImmediateAllocator(self.queue))

    def recycled(self, shape: int | tuple[int, ...], dtype: Any) -> Array:
        """Like `empty`, but from memory that is kept and handed out again once the array is gone.

        For the pictures and lists of every frame: the first writes to fresh memory cost more than what is written.
        """
        cl = _opencl()
        shape = (shape,) if isinstance(shape, (int, np.integer)) else tuple(shape)
        shape = shape if np.prod(shape) else (1,)
        return cl.array.empty(self.queue, shape, np.dtype(dtype), allocator=self._pool)

    def zeros(self, shape: int | tuple[int, ...], dtype: Any) -> Array:
        """A device array of zeros."""
        array = self.empty(shape, dtype)
        self.fill(array, 0)
        return array

    def fill(self, array: Array, value: float, stage: str | None = None) -> None:
        """Set every element of `array`; timed under `stage` if one is given."""
        cl = _opencl()
        event = cl.enqueue_fill_buffer(self.queue, array.base_data, array.dtype.type(value), array.offset, array.nbytes)
        if stage:
            for record in self._records:
                record._events.append((stage, None, event))

    def finish(self) -> None:
        """Wait until everything launched has run."""
        self.queue.finish()

    @contextmanager
    def record(self) -> Iterator[Record]:
        """Collect the device time of every launch inside the block; nested records all see their launches.

        Those of other threads too: nothing else may use the device while it is timed.
        """
        record = Record()
        self._records.append(record)
        try:
            yield record
        finally:
            self._records.remove(record)
            self.finish()
            record._close()


@dataclass(frozen=True)
class Kernels:
    """The kernels of one built file, as attributes by name, and a hash of what they were built from."""

    by_name: dict[str, Any]
    digest: str

    def __getattr__(self, name: str) -> Any:
        try:
            return self.by_name[name]
        except KeyError:
            raise AttributeError(f"no kernel {name!r}; there are {', '.join(sorted(self.by_name))}") from None


def _local_size(most: int) -> int:
    text = os.environ.get("BENCH_LOCAL_SIZE", str(DEFAULT_LOCAL_SIZE))
    if not text.isdigit() or not 1 <= int(text) <= most:
        raise DeviceError(f"BENCH_LOCAL_SIZE is {text!r}: give a whole number from 1 to {most}.")
    return int(text)


def _argument(value: Any) -> Any:
    if isinstance(value, (bool, int)):
        return np.int32(value)
    if isinstance(value, float):
        return np.float32(value)
    return getattr(value, "base_data", value)
