"""What follows from a path alone, and what cannot be opened."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from shading_atlas_bench.harness.errors import InputError
from shading_atlas_bench.harness.workload.methods import find_methods
from shading_atlas_bench.harness.workload.session import Session, open_session
from shading_atlas_bench.harness.workload.settings import Settings
from shading_atlas_bench.kernels.runtime.opencl import DeviceError
from shading_atlas_bench.scenes.model import SceneError
from shading_atlas_bench.scenes.paths import CameraPath


def test_the_pace_is_that_of_the_frames_that_are_run() -> None:
    times = np.array([0.0, 10.0, 40.0, 1000.0])
    path = CameraPath("file", times, np.zeros((4, 3)), np.tile([0.0, 0.0, 0.0, 1.0], (4, 1)))
    unused: Any = None
    sessions = {n: Session(Settings(frames=n), unused, unused, path, unused, unused, unused) for n in (1, 2, 3)}
    paces = {frames: session.frame_rate for frames, session in sessions.items()}
    assert paces == {1: None, 2: 100.0, 3: 50.0}


def test_what_cannot_be_opened_says_so() -> None:
    with pytest.raises(DeviceError, match="nowhere"):
        open_session(Settings(methods=("sas",), scene="hall", detail=40_000, device="nowhere"))
    with pytest.raises(SceneError, match="nowhere"):
        open_session(Settings(methods=("sas",), scene="nowhere"))


def test_two_packers_of_one_name_are_refused(tmp_path: Path) -> None:
    text = "from shading_atlas_bench.packers.example.grid import Grid as Known\n\nclass Grid(Known):\n    pass\n"
    files = [tmp_path / folder / "mine.py" for folder in ("a", "b")]
    for file in files:
        file.parent.mkdir()
        file.write_text(text, encoding="utf-8")
    twice = tuple(f"{file}:Grid" for file in files)
    assert len(find_methods(Settings(methods=(twice[0], twice[0])))) == 1
    with pytest.raises(InputError, match=r"Two packers are called 'grid': .*a.mine\.py:Grid and .*b.mine\.py:Grid"):
        find_methods(Settings(methods=twice))
