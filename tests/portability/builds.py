"""What OpenCL compilers are given: every kernel source with its options, noted while cases and runs are made."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any
from unittest import mock

from shading_atlas_bench.harness.cases import find_cases
from shading_atlas_bench.harness.run.run import run
from shading_atlas_bench.harness.workload.settings import Settings
from shading_atlas_bench.kernels.case import INPUTS
from shading_atlas_bench.kernels.device import Device
from tests.portability.small import small_trial

# Materials, lights and masks differ between these, and with them what the shading kernel is built with.
SCENES = ("hall", "village", "shells")
SMALL: dict[str, Any] = {
    "frames": 1, "width": 160, "height": 90, "atlas_width": 1024, "atlas_height": 1024, "crf": (25,),
}  # fmt: skip


@dataclass(frozen=True, order=True)
class Build:
    """A source as it reaches the compiler, with the options given; path: the stage, as folder/stage."""

    path: str
    options: tuple[str, ...]
    source: str

    @property
    def name(self) -> str:
        """The path, and the options that differ between builds of it."""
        return " ".join([self.path, *(option.removeprefix("-D") for option in self.options if option[:2] == "-D")])


@contextmanager
def noted() -> Iterator[set[Build]]:
    """Note what devices build inside the block."""
    builds: set[Build] = set()
    compiled = Device._compiled

    def noting(device: Device, stage: str, source: str, options: list[str], digest: str) -> Any:
        builds.add(Build(stage, tuple(options), source))
        return compiled(device, stage, source, options, digest)

    from_source = mock.patch.object(Device, "_kept", return_value=None)
    with from_source, mock.patch.object(Device, "_compiled", noting):
        yield builds


def builds_of_cases() -> list[Build]:
    """What the kernels' cases build, in order."""
    device = Device.open()  # a new one has built nothing yet
    with noted() as builds:
        for case in find_cases():
            for kind in INPUTS:
                small_trial(case, device, kind).run()
    return sorted(builds)


def builds_of_runs() -> list[Build]:
    """What small runs of all methods build, in order."""
    with noted() as builds, tempfile.TemporaryDirectory() as folder:
        for scene in SCENES:
            with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
                run(Settings(scene=scene, **SMALL), Path(folder) / scene)
    return sorted(builds)
