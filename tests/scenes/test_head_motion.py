"""Head motion inside the view cell."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shading_atlas_bench.scenes.head_motion import HeadMotion
from shading_atlas_bench.scenes.paths import PathError
from shading_atlas_bench.scenes.quaternions import rotate

HEADER = "Time x y z alpha beta gamma\n"
FORWARD, RIGHT, UP = np.array([0.0, 0, -1]), np.array([1.0, 0, 0]), np.array([0.0, 1, 0])


def _recording(tmp_path: Path, rows: list[tuple]) -> HeadMotion:
    file = tmp_path / "head.txt"
    file.write_text(HEADER + "".join(",".join(map(str, row)) + "\n" for row in rows), encoding="utf-8")
    return HeadMotion.recorded(file)


@given(st.integers(0, 2**31), st.floats(0, 60_000))
@settings(max_examples=40, deadline=None)
def test_no_latency_no_motion(seed: int, t: float) -> None:
    shift, turn = HeadMotion.synthetic(seed).offset(t, 0)
    assert np.array_equal(shift, np.zeros(3))
    assert np.allclose(turn, [0, 0, 0, 1], atol=1e-12)


@given(st.integers(0, 2**31))
@settings(max_examples=15, deadline=None)
def test_synthetic_heads_move_like_heads(seed: int) -> None:
    """Below 1 m/s and 3 rad/s, never still for long, and smooth from frame to frame."""
    head = HeadMotion.synthetic(seed)
    offsets = [head.offset(t, 50) for t in np.arange(0, 5000, 1000 / 60)]
    shifts = np.array([s for s, _ in offsets])
    angles = 2 * np.arccos(np.minimum(1, np.abs([q[3] for _, q in offsets])))
    assert np.linalg.norm(shifts, axis=1).max() < 0.05
    assert angles.max() < 0.15
    assert np.linalg.norm(shifts, axis=1).mean() > 0.001
    assert angles.mean() > 0.005
    assert np.linalg.norm(np.diff(shifts, axis=0), axis=1).max() < 0.01


def test_same_seed_same_motion() -> None:
    first, again, other = (HeadMotion.synthetic(seed).offset(123.4, 50) for seed in (1, 1, 2))
    assert np.array_equal(first[0], again[0])
    assert np.array_equal(first[1], again[1])
    assert not np.array_equal(first[0], other[0])


def test_recorded_axes_come_out_right_handed(tmp_path: Path) -> None:
    """Forwards is -z, right +x, up +y for a head that looks along the recording's z axis."""
    head = _recording(tmp_path, [(0, 0, 0, 0, 0, 0, 0), (1, 0.1, 0.2, 0.3, 0, 0, 0), (2, 0.1, 0.2, 0.3, 0, 0, 0)])
    assert np.allclose(head.offset(0, 1000)[0], [0.1, 0.2, -0.3])


def test_recorded_motion_is_seen_from_the_head(tmp_path: Path) -> None:
    """A head that looks right (yaw 90) and moves along the recording's x moves forwards."""
    head = _recording(tmp_path, [(0, 0, 1.6, 0, 0, 90, 0), (1, 0.5, 1.6, 0, 0, 90, 0), (2, 0.5, 1.6, 0, 0, 90, 0)])
    assert np.allclose(head.offset(0, 1000)[0], 0.5 * FORWARD, atol=1e-12)


@pytest.mark.parametrize(
    ("angles", "axis", "lands"),
    [
        ((10, 0, 0), FORWARD, FORWARD * np.cos(np.radians(10)) - UP * np.sin(np.radians(10))),
        ((0, 10, 0), FORWARD, FORWARD * np.cos(np.radians(10)) + RIGHT * np.sin(np.radians(10))),
        ((0, 0, 10), RIGHT, RIGHT * np.cos(np.radians(10)) + UP * np.sin(np.radians(10))),
    ],
)
def test_recorded_rotations(tmp_path: Path, angles: tuple, axis: np.ndarray, lands: np.ndarray) -> None:
    """In the left-handed frame a positive pitch looks down, yaw looks right, roll lifts the right side."""
    head = _recording(tmp_path, [(0, 0, 0, 0, 0, 0, 0), (1, 0, 0, 0, *angles), (2, 0, 0, 0, *angles)])
    assert np.allclose(rotate(head.offset(0, 1000)[1], axis), lands, atol=1e-12)


def test_angles_may_pass_from_360_to_0(tmp_path: Path) -> None:
    head = _recording(tmp_path, [(0, 0, 0, 0, 0, 359, 0), (1, 0, 0, 0, 0, 1, 0), (2, 0, 0, 0, 0, 1, 0)])
    _, turn = head.offset(0, 500)
    assert np.degrees(2 * np.arccos(min(1, abs(turn[3])))) == pytest.approx(1, abs=1e-6)


def test_recordings_repeat_without_a_jump(tmp_path: Path) -> None:
    rows = [(0.1 * k, 0.01 * k, 1.6, 0, 0, 0, 0) for k in range(20)]
    head = _recording(tmp_path, rows)
    steps = [np.linalg.norm(head.offset(t, 50)[0]) for t in np.arange(0, 20_000, 17.3)]
    assert max(steps) == pytest.approx(0.005, abs=1e-9)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (HEADER + "0,0,0,0,0,0\n", 2),
        (HEADER + "0,0,0,0,0,0,0\n0,0,0,0,0,0,0\n", 3),
        (HEADER + "0,0,0,0,0,0,0\n1,x,0,0,0,0,0\n", 3),
        (HEADER + "0,0,0,0,0,0,0\n1e-320,1,0,0,0,0,0\n", 3),
        (HEADER + "0,1_0,0,0,0,0,0\n", 2),
    ],
)
def test_malformed_recordings_are_named(tmp_path: Path, text: str, line: int) -> None:
    file = tmp_path / "head.txt"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(PathError, match=rf"head\.txt, line {line}:"):
        HeadMotion.recorded(file)


def test_missing_recording_is_refused(tmp_path: Path) -> None:
    with pytest.raises(PathError, match="There is no file"):
        HeadMotion.recorded(tmp_path / "none.txt")
