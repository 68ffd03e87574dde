"""The pose predictor: exact for constant velocity, calm at rest, and never looking ahead."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from shading_atlas_bench.harness.workload.frames import FrameSource
from shading_atlas_bench.harness.workload.prediction import predict
from shading_atlas_bench.harness.workload.settings import Settings
from shading_atlas_bench.harness.workload.views import (
    Pose,
    from_rotation_vector,
    rotation_vector,
)
from shading_atlas_bench.scenes.quaternions import conjugate, multiply

TIMES = np.arange(40) * 1000 / 60


def moving(velocity, spin):
    """Poses of constant velocity (per second) and turn rate (radians per second)."""
    seconds = TIMES / 1000
    return [Pose(np.array(velocity) * t, from_rotation_vector(np.array(spin) * t)) for t in seconds]


def test_constant_velocity_is_predicted_to_a_millimetre_and_a_thousandth_of_a_radian():
    velocity, spin = (1.0, 0.2, -0.5), (0.0, 0.8, 0.0)
    (predicted,) = predict(TIMES, moving(velocity, spin), [50.0], 1.0)
    expected_time = TIMES[-1] / 1000 + 0.05
    assert predicted.position == pytest.approx(np.array(velocity) * expected_time, abs=1e-3)
    truth = from_rotation_vector(np.array(spin) * expected_time)
    assert np.linalg.norm(rotation_vector(multiply(conjugate(truth), predicted.orientation))) < 1e-3


def test_a_still_head_is_predicted_to_stay():
    still = [Pose(np.array([5.0, 1.0, 2.0]), np.array([0, 0, 0, 1.0]))] * 40
    for pose in predict(TIMES, still, [10.0, 100.0], 1.0):
        assert pose.position == pytest.approx([5, 1, 2], abs=1e-9)


def test_one_pose_is_enough():
    (pose,) = predict(TIMES[:1], moving((1, 0, 0), (0, 0, 0))[:1], [50.0], 1.0)
    assert pose.position == pytest.approx([0, 0, 0])


def test_units_do_not_change_the_prediction():
    metres = predict(TIMES, moving((1, 0, 0), (0, 0, 0)), [50.0], 1.0)[0].position
    poses = [Pose(p.position * 100, p.orientation) for p in moving((1, 0, 0), (0, 0, 0))]
    centimetres = predict(TIMES, poses, [50.0], 0.01)[0].position
    assert centimetres == pytest.approx(metres * 100)


def test_a_packer_hears_of_three_views_ahead_the_last_one_when_the_client_draws():
    moved = moving((1.2, 0.0, 0.0), (0.0, 0.0, 0.0))
    path: Any = SimpleNamespace(
        times_ms=TIMES, positions=[pose.position for pose in moved], orientations=[pose.orientation for pose in moved]
    )
    host = SimpleNamespace(bounds=np.array([[0.0] * 3, [10.0] * 3]), metres_per_unit=1.0)
    scene: Any = SimpleNamespace(host=host)
    motion: Any = None  # predictions need none
    source = FrameSource(scene, path, motion, Settings(latency=60.0))
    seen = [view.eye[0] for view in source._predicted(39)]
    assert seen == pytest.approx([1.2 * (TIMES[39] + ahead) / 1000 for ahead in (20, 40, 60)], abs=1e-3)
