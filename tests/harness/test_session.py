"""What follows from a path alone."""

from __future__ import annotations

import numpy as np

from harness.session import Session
from harness.settings import Settings
from scenes.paths import CameraPath


def test_the_pace_is_that_of_the_frames_that_are_run() -> None:
    times = np.array([0.0, 10.0, 40.0, 1000.0])
    path = CameraPath("file", times, np.zeros((4, 3)), np.tile([0.0, 0.0, 0.0, 1.0], (4, 1)))
    sessions = {n: Session(Settings(frames=n), None, None, path, None, None, None) for n in (1, 2, 3)}
    paces = {frames: session.frame_rate for frames, session in sessions.items()}
    assert paces == {1: None, 2: 100.0, 3: 50.0}
