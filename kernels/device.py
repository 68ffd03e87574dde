"""The OpenCL device: finding it, building kernels for it, launching them and timing them by its own events."""

from __future__ import annotations

import contextlib
import hashlib
import math
import os
import re
import shutil
import zlib
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic import arrays
from shading_atlas_bench.kernels.cache import cache_folder, read_checked, write_checked
from shading_atlas_bench.kernels.journal import journal
from shading_atlas_bench.kernels.preprocessor import HIDDEN, hidden, logical_lines
from shading_atlas_bench.kernels.runtime import kernel_cache
from shading_atlas_bench.kernels.runtime.opencl import (
    SPEAKING,
    DeviceError,
    FoundDevice,
    array_class,
    find_devices,
    forget_death,
    noted_death,
    opencl,
    pocl_cache,
)
from shading_atlas_bench.kernels.runtime.vendors import how_to_get_one

if TYPE_CHECKING:
    import pyopencl
    from numpy.typing import DTypeLike
    from pyopencl.array import Array
    from pyopencl.tools import MemoryPool
    from pyopencl.typing import KernelArg

ROOT = Path(__file__).parent
METHOD_KERNELS = "kernels"  # the folder of a method where its kernels lie
CONTRACT = "#pragma OPENCL FP_CONTRACT"
BLANK = rf"(?:[^\S\n]|{HIDDEN})*"  # also comments
INCLUDE = re.compile(rf'^\s*{BLANK}#{BLANK}include{BLANK}"([^"\n]+)"{BLANK}\s*$', re.MULTILINE)
READS_A_FILE = re.compile(r"^\s*(?:#|%:)\s*(?:include|include_next|import|embed)\b.*", re.MULTILINE)
ATTRIBUTES = r"(?:__attribute__\s*\(\((?:[^()]|\([^()]*\))*\)\)\s*)*"
KERNEL = re.compile(rf"^\s*{ATTRIBUTES}(?:__)?kernel\s+{ATTRIBUTES}void\s+{ATTRIBUTES}(\w+)", re.MULTILINE)
DEFAULT_LOCAL_SIZE = 64
ROW_BYTES = 8192  # at a time of what is summed up
LARGE_GRID = 0xFFFF  # work-items: PoCL compiles a kernel in another form beyond
INSTALL_ANOTHER = (
    "Install another runtime: pip install -e '.[intel]', or the system's PoCL (apt install pocl-opencl-icd)."
)


@dataclass(frozen=True)
class Arithmetic:
    """How freely the compiler may round: its options, and whether it may fuse multiplications and additions."""

    options: tuple[str, ...]
    contract: str


# OpenCL lets divisions err by 2.5 units of the last place and roots by 3; with this they are as IEEE 754 has them.
EXACT = "-cl-fp32-correctly-rounded-divide-sqrt"
# What `bench kernels` compares; results always come from the default, whose every operation IEEE 754 defines.
VARIANTS = {
    "default": Arithmetic((EXACT,), "OFF"),
    "contracted": Arithmetic((EXACT,), "ON"),
    "relaxed": Arithmetic(("-cl-fast-relaxed-math",), "ON"),
}

# PoCL's library of built-ins is compiled for the first processor with its registers: Haswell, and Skylake's server for
# AVX-512. Where LLVM takes the processor for one that lacks any feature of that one's (AMD's; virtual machines without
# clwb), it inlines none of them: vload16, sqrt, min, clamp become calls that spill all registers. So kernels are
# compiled for the library's processor where they are not anyway. No result changes.
INLINED_BUILTINS = """#if defined(__x86_64__) && defined(__AVX512F__) && !defined(__CLWB__)
#pragma clang attribute push(__attribute__((target("clwb"))), apply_to = function)
#elif defined(__x86_64__) && !defined(__AVX512F__) && defined(__AVX2__)
#pragma clang attribute push(__attribute__((target("arch=haswell"))), apply_to = function)
#endif
{source}
#if defined(__x86_64__) && (defined(__AVX512F__) ? !defined(__CLWB__) : defined(__AVX2__))
#pragma clang attribute pop
#endif
"""


def source_with_includes(file: Path, seen: set[Path] | None = None) -> str:
    """A kernel file's text with every `#include "..."` put in its place, once each: a file beside it, or one of those
    that methods share, by its path below `kernels/`.

    Done here and not by the driver, because drivers that cache by source miss changes in included files, and look for
    them in the working folder. Raises DeviceError for a file that is missing, and for a line that the driver would take
    for another include: of `<...>`, of a macro, or continued within a word.
    """
    seen = set() if seen is None else seen
    if file in seen:
        return ""
    seen.add(file)
    if not file.is_file():
        raise DeviceError(f"The kernel file {file} is missing: reinstall the package that it belongs to.")
    text = file.read_text(encoding="utf-8")
    found = list(INCLUDE.finditer(hidden(text)))
    starts, ends = [0, *(match.end() for match in found)], [*(match.start() for match in found), len(text)]
    own = [text[start:end] for start, end in zip(starts, ends, strict=True)]
    if left := READS_A_FILE.search(logical_lines("\n".join(own))):
        raise DeviceError(
            f'{file} has the line {left.group().strip()!r}: write #include "FILE", a file beside it or below kernels/.'
        )
    beside = (file.parent / match.group(1) for match in found)
    taken = (one if one.is_file() else ROOT / match.group(1) for one, match in zip(beside, found, strict=True))
    included = [source_with_includes(one, seen) for one in taken]
    return "".join(part for pair in zip(own, [*included, ""], strict=True) for part in pair)


def stage_name(file: Path) -> str:
    """What a stage is called by its file: `folder/stage`, where the folder of a method's kernels is the method's."""
    folder = file.parent.parent if file.parent.name == METHOD_KERNELS else file.parent
    return f"{folder.name}/{file.stem}"


def kernel_files() -> list[Path]:
    """The OpenCL files of the suite: those that methods share, and its own methods'."""
    return sorted([*ROOT.rglob("*.cl"), *(ROOT.parent / "packers").rglob("*.cl")], key=stage_name)


def kernel_names() -> list[str]:
    """Every kernel of the suite as folder/stage.function, as in `Record.kernels`."""
    return [
        f"{stage_name(file)}.{name}"
        for file in kernel_files()
        for name in KERNEL.findall(file.read_text(encoding="utf-8"))
    ]


@cache
def kernels_digest() -> str:
    """A hash of every kernel file of the suite: results and cached results say which kernels they came from."""
    digest = hashlib.sha256()
    for file in kernel_files():
        digest.update(stage_name(file).encode() + file.read_bytes())
    return digest.hexdigest()[:16]


@dataclass(eq=False)  # nested records may hold the same launches, and are two all the same
class Record:
    """Device time and launches by stage name, and time by kernel, filled when its `with` block ends.

    kernels: milliseconds by the kernel's name, folder/file.function.
    """

    milliseconds: dict[str, float] = field(default_factory=dict)
    launches: dict[str, int] = field(default_factory=dict)
    kernels: dict[str, float] = field(default_factory=dict)
    _events: list[tuple[str, str | None, pyopencl.Event]] = field(default_factory=list)

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

    def __init__(self, found: FoundDevice, variant: str = "default", passed_over: Sequence[str] = ()) -> None:
        cl, device = opencl(), found.device
        if variant not in VARIANTS:
            raise DeviceError(f"There is no build variant {variant!r}: give one of {', '.join(VARIANTS)}.")
        if refused := found.refused():
            raise DeviceError(refused)
        if found.is_pocl and not shutil.which("ld"):
            raise DeviceError("PoCL needs the linker ld: install binutils (Debian, Ubuntu: apt install binutils).")
        self.found, self.device, self.variant, self.passed_over = found, device, variant, tuple(passed_over)
        self.context: pyopencl.Context = cl.Context([device])
        profiling = cl.command_queue_properties.PROFILING_ENABLE
        self.queue: pyopencl.CommandQueue = cl.CommandQueue(self.context, properties=profiling)
        self.name = found.name
        self.is_cpu = bool(device.type & cl.device_type.CPU)
        self.local_size = _local_size(device.max_work_group_size)
        # Chunked kernels cut their input into this many runs: enough for the scheduler to balance, few enough for
        # small tables. A constant, never the number of cores, so that nothing can depend on the machine.
        self.chunks = 64
        self.announce: Callable[[str], None] = lambda building: None
        self._building = Lock()  # not SPEAKING: a compiler needs no queue, others go on meanwhile
        self._programs: dict[tuple[Path | str, ...], Kernels] = {}
        self._names: dict[pyopencl.Kernel, str] = {}
        self._launched: set[tuple[pyopencl.Kernel, int, bool]] = set()
        self._records: list[Record] = []

    @classmethod
    def open(cls, name: str | None = None, variant: str = "default") -> Device:
        """The device whose platform and name contain `name` (any case); without one, the default device.

        The default is the first of `find_devices` whose compiler has not died of these kernels before; why others were
        passed over is in `passed_over`. Raises DeviceError, listing what there is, if none matches or none can be used,
        and for an empty name.
        """
        if name == "":
            raise DeviceError("--device is empty: give part of a device's name, or leave it out.")
        asked, by = (name, "--device") if name else (os.environ.get("BENCH_DEVICE", ""), "BENCH_DEVICE")
        found = find_devices()
        if not found:
            raise DeviceError(f"No OpenCL device was found: {how_to_get_one()}.")
        if asked:
            matching = [
                one for one in found if asked.lower() in f"{one.device.platform.name} {one.device.name}".lower()
            ]
            for one in sorted(matching, key=lambda one: one.refused() is not None):
                return cls(one, variant)._noted(asked)
            known = "; ".join(f"{one.device.name.strip()} on {one.device.platform.name}" for one in found)
            raise DeviceError(f"No OpenCL device matches {asked!r}, which {by} asks for. There are: {known}.")
        reasons: list[str] = []
        for one in found:
            reason = one.refused() or noted_death(one.key, kernels_digest())
            if reason is None:
                return cls(one, variant, reasons)._noted(asked)
            reasons.append(reason)
        raise DeviceError(" ".join([*reasons, INSTALL_ANOTHER]))

    def _noted(self, asked: str) -> Device:
        facts = {"key": self.found.key, "name": self.name, "kernels": kernels_digest(), "asked": bool(asked)}
        journal().note(device=facts)
        return self

    @cached_property
    def _is_exact(self) -> bool:
        """Whether its divisions and roots can be exact; else results may differ from other devices' in last places."""
        return bool(self.device.single_fp_config & opencl().device_fp_config.CORRECTLY_ROUNDED_DIVIDE_SQRT)

    @property
    def is_new(self) -> bool:
        """Whether these kernels were never built for this device: the first run compiles all of them."""
        return not self._built_note.exists()

    def remember_built(self) -> None:
        """Remember that this device builds and runs these kernels, and seal what was compiled."""
        kernel_cache.seal(pocl_cache())
        forget_death(self.found.key, kernels_digest())
        with contextlib.suppress(OSError):
            self._built_note.touch()

    def _object(self, digest: str) -> Path:
        """The file of a program that is compiled and not linked, thrown away with all else that PoCL compiled.

        Of a linked one PoCL would compile each kernel once more, for work-groups of any size, before it gives it away:
        25 s in the first run of all, for half a second less in each later one.
        """
        return pocl_cache() / "objects" / f"{self.found.key}-{digest}"

    @property
    def _built_note(self) -> Path:
        return cache_folder("opencl") / f"built-{self.found.key}-{kernels_digest()}"

    @cached_property
    def description(self) -> dict[str, str]:
        """What a result must say about the device it came from."""
        device = self.device
        return {
            "name": device.name.strip(),
            "platform": device.platform.name.strip(),
            "version": device.platform.version.strip(),
            "driver": device.driver_version.strip(),
            "builtins": self.found.builtins,
            "compute_units": str(device.max_compute_units),
        }

    def build(self, source: str | Path, options: Sequence[str] = (), /, **defines: int) -> Kernels:
        """Build an OpenCL file with preprocessor `defines`; built once per (source, options, defines).

        source: a file, as `Path(__file__).parent / "stage.cl"`, or one of those that methods share, by its path below
        `kernels/`. Multiplications and additions are not fused, so that integers and shared vertices come out the same
        everywhere. Raises DeviceError for a missing file, or what the compiler says.
        """
        arithmetic, file = VARIANTS[self.variant], ROOT / source
        given = [option for option in arithmetic.options if option != EXACT or self._is_exact]
        flags = [*given, *options, *(f"-D{key}={value}" for key, value in sorted(defines.items()))]
        key: tuple[Path | str, ...] = (file, *flags)
        with self._building:
            if key not in self._programs:
                self._programs[key] = self._built(file, flags, arithmetic.contract)
            return self._programs[key]

    def _built(self, file: Path, flags: Sequence[str], contract: str) -> Kernels:
        """A program's kernels, whose names are known to records from then on."""
        files: set[Path] = set()
        source = f"{CONTRACT} {contract}\n{source_with_includes(file, files)}"
        source = INLINED_BUILTINS.replace("{source}", source)
        stage, options = stage_name(file), ["-cl-std=CL1.2", "-w", *flags]
        digest = hashlib.sha256("\n".join([*flags, source]).encode()).hexdigest()[:16]
        with journal().building(stage):
            program = self._kept(digest) or self._compiled(stage, source, options, digest)
        kernels = Kernels({kernel.function_name: kernel for kernel in program.all_kernels()}, digest)
        self._names |= {
            kernels.by_name[name]: f"{stage_name(one)}.{name}"
            for one in files
            for name in KERNEL.findall(one.read_text(encoding="utf-8"))
            if name in kernels.by_name  # included files may leave some out
        }
        return kernels

    def _kept(self, digest: str) -> pyopencl.Program | None:
        """The program as it was compiled before, None if it was not: PoCL would preprocess its source to find that, for
        40 ms. To link it takes 5, and a third of a second the first time, in which PoCL reads its built-ins."""
        cl = opencl()
        compiled = read_checked(self._object(digest)) if self.found.is_pocl else None
        if compiled is None:
            return None
        try:
            return self._linked(cl.Program(self.context, [self.device], [compiled]))
        except cl.Error:  # of another build of the runtime that calls itself the same
            return None

    def _linked(self, compiled: pyopencl.Program) -> pyopencl.Program:
        program: pyopencl.Program = opencl().link_program(self.context, [compiled])
        return program

    def _compiled(self, stage: str, source: str, options: list[str], digest: str) -> pyopencl.Program:
        cl = opencl()
        self.announce(stage)
        new = cl.Program(self.context, source)
        try:
            if not self.found.is_pocl:  # others keep what they compile themselves
                program: pyopencl.Program = new.build(options, cache_dir=False)
                return program
            new.compile(options)
            (compiled,) = new.get_info(cl.program_info.BINARIES)
            write_checked(self._object(digest), compiled)
            return self._linked(new)
        except cl.RuntimeError as error:
            raise DeviceError(f"{stage}.cl does not build on {self.name}: ", log=str(error)) from error

    def launch(
        self, stage: str, kernel: pyopencl.Kernel, items: int, *args: KernelArg, local: int | None = None
    ) -> None:
        """Run `kernel` over at least `items` work-items and time it under `stage`.

        The global size is padded to the work-group size, so a kernel must return when its id is >= its item count.
        Python ints go as int32 and floats as float32; arrays as their buffers. `local=1` suits one item per chunk or
        tile; the default suits one item per element. Nothing runs for `items` = 0. Any thread may launch.
        """
        if items <= 0:
            return
        local = local or self.local_size
        padded = -(-items // local) * local
        # PoCL compiles at the first launch with each work-group size, and once more for large grids.
        form = (kernel, local, padded > LARGE_GRID)
        with SPEAKING:
            kernel.set_args(*(_argument(value) for value in args))
            if form in self._launched or not (self.found.is_pocl and kernel in self._names):
                event = opencl().enqueue_nd_range_kernel(self.queue, kernel, (padded,), (local,))
            else:
                with journal().building(self._names[kernel], kernel.function_name):
                    event = opencl().enqueue_nd_range_kernel(self.queue, kernel, (padded,), (local,))
                    event.wait()
                self._launched.add(form)
            for record in self._records:
                record._events.append((stage, self._names.get(kernel), event))

    def upload(self, values: arrays.Array) -> Array:
        """A device copy of a NumPy array, of any shape and numbers (never empty: one without elements gets one)."""
        values = np.ascontiguousarray(values)
        if values.size == 0:
            return self.zeros((1,), values.dtype)
        array = self.empty(values.shape, values.dtype)
        array.set(values)
        return array

    def lent(self, values: arrays.Array) -> Array:
        """A NumPy array, of any shape and numbers, for kernels to read: where it lies, if the device reads the host's
        memory, else a copy. One without elements gets one, as in `upload`.

        It must be kept until these kernels have run, and nobody may write to the array meanwhile. It begins at any
        address: kernels must not read it by vectors that are to be aligned.
        """
        values = np.require(values, requirements=("C", "A"))
        if values.size == 0:
            return self.zeros((1,), values.dtype)
        cl = opencl()
        with SPEAKING:
            place = cl.Buffer(self.context, cl.mem_flags.READ_ONLY | cl.mem_flags.USE_HOST_PTR, hostbuf=values)
            return array_class()(self.queue, values.shape, values.dtype, data=place)

    @contextmanager
    def written(self, array: Array) -> Iterator[arrays.Array]:
        """`array` as the host sees it, of any shape and numbers, for a block that writes all of it: without a copy
        where the memory of the device is that of the host."""
        cl = opencl()
        with SPEAKING:
            place = (array.base_data, cl.map_flags.WRITE_INVALIDATE_REGION, array.offset, array.shape, array.dtype)
            shown, _ = cl.enqueue_map_buffer(self.queue, *place)
            try:
                yield shown
            finally:
                shown.base.release(self.queue)

    def download(self, array: Array) -> bytes:
        """The bytes of `array`, of any shape and numbers, copied once, from where the device shows them to the host."""
        cl = opencl()
        with SPEAKING:
            place = (array.base_data, cl.map_flags.READ, array.offset, array.shape, array.dtype)
            shown, _ = cl.enqueue_map_buffer(self.queue, *place)
            try:
                content: bytes = shown.tobytes()
            finally:
                shown.base.release(self.queue)
        return content

    def checksum(self, array: Array) -> int:
        """A number that changes when something in `array` does, of any shape and numbers: at the speed of memory."""
        cl = opencl()
        with SPEAKING:
            shown, _ = cl.enqueue_map_buffer(
                self.queue, array.base_data, cl.map_flags.READ, array.offset, (array.nbytes,), np.uint8
            )
            try:
                words = shown[: array.nbytes // ROW_BYTES * ROW_BYTES].view(np.uint64).reshape(-1, ROW_BYTES // 8)
                found = zlib.crc32(np.bitwise_xor.reduce(words, axis=0))
                return zlib.crc32(shown[words.nbytes :], found)
            finally:
                shown.base.release(self.queue)

    def empty(self, shape: int | tuple[int, ...], dtype: DTypeLike) -> Array:
        """An uninitialised device array of this shape and dtype; one without elements has one, because OpenCL has no
        empty buffer."""
        with SPEAKING:
            return array_class()(self.queue, _some(shape), np.dtype(dtype))

    @cached_property
    def _pool(self) -> MemoryPool:
        from pyopencl.tools import ImmediateAllocator, MemoryPool

        return MemoryPool(ImmediateAllocator(self.queue))

    def recycled(self, shape: int | tuple[int, ...], dtype: DTypeLike) -> Array:
        """Like `empty`, but from memory that is kept and handed out again once the array is gone.

        For the pictures and lists of every frame: the first writes to fresh memory cost more than what is written.
        """
        with SPEAKING:
            return array_class()(self.queue, _some(shape), np.dtype(dtype), allocator=self._pool)

    def zeros(self, shape: int | tuple[int, ...], dtype: DTypeLike) -> Array:
        """A device array of zeros, of this shape and dtype."""
        array = self.empty(shape, dtype)
        self.fill(array, 0)
        return array

    def fill(self, array: Array, value: float, stage: str | None = None) -> None:
        """Set every element of `array`, of any shape and numbers; timed under `stage` if one is given."""
        pattern = array.dtype.type(value)
        with SPEAKING:
            event = opencl().enqueue_fill_buffer(self.queue, array.base_data, pattern, array.offset, array.nbytes)
        if stage:
            for record in self._records:
                record._events.append((stage, None, event))

    def holds(self, value: object, dtype: DTypeLike, shape: tuple[int, ...]) -> bool:
        """Whether `value` is a whole array of this device, of this dtype and shape, and all of it is there to be read.

        Of other things nothing is run.
        """
        if type(value) is not array_class():
            return False
        form = (value.dtype, value.shape, value.offset, value.flags.c_contiguous)
        if form != (np.dtype(dtype), shape, 0, True) or value.base_data is None:
            return False
        with SPEAKING:
            there = value.base_data.size or 0
            return bool(value.queue == self.queue) and there >= np.dtype(dtype).itemsize * math.prod(shape)

    def finish(self) -> None:
        """Wait until everything launched has run."""
        with SPEAKING:
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

    by_name: dict[str, pyopencl.Kernel]
    digest: str

    def __getattr__(self, name: str) -> pyopencl.Kernel:
        try:
            return self.by_name[name]
        except KeyError:
            raise AttributeError(f"no kernel {name!r}; there are {', '.join(sorted(self.by_name))}") from None


def _local_size(most: int) -> int:
    text = os.environ.get("BENCH_LOCAL_SIZE", str(DEFAULT_LOCAL_SIZE))
    if not text.isdigit() or not 1 <= int(text) <= most:
        raise DeviceError(f"BENCH_LOCAL_SIZE is {text!r}: give a whole number from 1 to {most}.")
    return int(text)


def _some(shape: int | tuple[int, ...]) -> tuple[int, ...]:
    """The shape as a tuple, of one element where it has none."""
    shape = (int(shape),) if isinstance(shape, (int, np.integer)) else tuple(shape)
    return shape if np.prod(shape) else (1,)


def _argument(value: KernelArg) -> KernelArg:
    if isinstance(value, (bool, int)):
        return np.int32(value)
    if isinstance(value, float):
        return np.float32(value)
    buffer: KernelArg = getattr(value, "base_data", value)
    return buffer
