"""Predicting the client's pose: a constant-velocity Kalman filter over the past poses, the same for every packer."""

from __future__ import annotations

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Doubles
from shading_atlas_bench.arithmetic.matrices import product
from shading_atlas_bench.harness.workload.views import (
    Pose,
    from_rotation_vector,
    rotation_vector,
)
from shading_atlas_bench.scenes.quaternions import conjugate, multiply

# Spread of a person's acceleration (m/s^2, rad/s^2) and of a tracker's measurements (m, rad).
ACCELERATION = (3.0, 10.0)
TRACKING = (0.0005, 0.001)


def _filter(times: Doubles, values: Doubles, acceleration: float, tracking: float) -> tuple[Doubles, Doubles]:
    """The filtered last value and its velocity per second: `times` in seconds (n), `values` (n, k)."""
    state = np.stack([values[0], np.zeros_like(values[0])])
    covariance = np.diag([tracking * tracking, 4.0])
    for step, value in zip(np.diff(times), values[1:], strict=True):
        move = np.array([[1, step], [0, 1]])
        square = step * step
        noise = np.array([[square * square / 4, square * step / 2], [square * step / 2, square]])
        noise *= acceleration * acceleration
        covariance = product(move, covariance, move.T) + noise
        state = product(move, state)
        gain = covariance[:, 0] / (covariance[0, 0] + tracking * tracking)
        state = state + gain[:, None] * (value - state[0])
        covariance = covariance - gain[:, None] * covariance[0]
    return state[0], state[1]


def predict(times_ms: Doubles, poses: list[Pose], ahead_ms: list[float], metres_per_unit: float) -> list[Pose]:
    """Poses expected `ahead_ms` milliseconds after the last of `poses`, at times_ms (n), from the last 30 of them.

    Rotations are filtered as rotation vectors relative to the last pose, so they stay small.
    """
    times = np.asarray(times_ms[-30:], np.float64) / 1000
    recent = poses[-30:]
    positions = np.array([pose.position for pose in recent])
    last = recent[-1].orientation
    turns = np.array([rotation_vector(multiply(conjugate(last), pose.orientation)) for pose in recent])
    place, velocity = _filter(times, positions, ACCELERATION[0] / metres_per_unit, TRACKING[0] / metres_per_unit)
    turn, spin = _filter(times, turns, ACCELERATION[1], TRACKING[1])
    return [
        Pose(place + velocity * ms / 1000, multiply(last, from_rotation_vector(turn + spin * ms / 1000)))
        for ms in ahead_ms
    ]
