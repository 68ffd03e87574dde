"""Head motion inside the view cell: how the client's head moves while the server's answer is on its way.

Synthetic, from a seed, or recorded. A recording is a text table: one header line, then `time_s, x, y, z, alpha, beta,
gamma` per line, metres and degrees, in a left-handed frame with y up and z forwards: alpha is pitch about x, beta yaw
about y, gamma roll about z, R = Ry(beta) Rx(alpha) Rz(gamma). Mirroring z makes it right-handed and the head look
along -z; a mirrored rotation about x or y changes its sign, one about z does not.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from shading_atlas_bench.arithmetic import draws
from shading_atlas_bench.arithmetic.arrays import Doubles
from shading_atlas_bench.arithmetic.functions import exp, log, sin
from shading_atlas_bench.scenes.paths import CameraPath, Poses, read_numbers
from shading_atlas_bench.scenes.quaternions import about, conjugate, multiply, rotate

# A standing person's head: root mean square speed along x, y, z (m/s) and about x, y, z (rad/s); its band in hertz.
SPEEDS = (0.10, 0.04, 0.08)
SPINS = (0.25, 0.45, 0.08)
BAND = (0.15, 1.6)
WAVES = 12
_CLOSEST_S = 1e-4  # between poses of a recording: no tracker has ten thousand a second


@dataclass(frozen=True)
class _Waves:
    """Band-limited noise for the six degrees of freedom: sums of sines of random frequency and phase.

    amplitudes, frequencies (radians per second) and phases: float64 (6, WAVES).
    """

    amplitudes: Doubles
    frequencies: Doubles
    phases: Doubles

    def pose_at(self, t_ms: float) -> tuple[Doubles, Doubles]:
        """Position (3) in metres and orientation (4) of the head about its place of rest."""
        values = (self.amplitudes * sin(self.frequencies * (t_ms / 1000) + self.phases)).sum(axis=1)
        pitch, yaw, roll = values[3:]
        return values[:3], multiply(multiply(about(1, yaw), about(0, pitch)), about(2, roll))


@dataclass(frozen=True)
class _Recording:
    """Recorded poses; the recording starts again where it ends."""

    poses: CameraPath

    def pose_at(self, t_ms: float) -> tuple[Doubles, Doubles]:
        return self.poses.pose_at(self.poses.times_ms[0] + t_ms)

    @property
    def length_ms(self) -> float:
        return float(self.poses.times_ms[-1] - self.poses.times_ms[0])


@dataclass(frozen=True)
class HeadMotion:
    """How far a head moves within a latency, at any time of a run."""

    source: _Waves | _Recording

    @classmethod
    def synthetic(cls, seed: int = 0) -> HeadMotion:
        """Smooth motion of a standing person: about 0.1 m/s and 30 degrees per second, slower than 1.6 Hz."""
        rng = draws.generator([seed, 72])
        low, high = log(np.array(BAND))
        frequencies = 2 * np.pi * exp(rng.uniform(low, high, (6, WAVES)))
        speeds = np.array([*SPEEDS, *SPINS])[:, None]
        amplitudes = speeds * np.sqrt(2 / WAVES) / frequencies
        return cls(_Waves(amplitudes, frequencies, rng.uniform(0, 2 * np.pi, (6, WAVES))))

    @classmethod
    def recorded(cls, file: str | Path) -> HeadMotion:
        """Motion from a recording (see above); PathError names the file and line where it is malformed."""
        rows = read_numbers(Path(file), 7, "time_s, x, y, z, alpha, beta, gamma", _CLOSEST_S, header=True)
        table = np.array([values for _, values in rows])
        pitch, yaw, roll = np.radians(table[:, 4:]).T
        orientations = multiply(multiply(about(1, -yaw), about(0, -pitch)), about(2, roll))
        poses = Poses(table[:, 0] * 1000, table[:, 1:4] * np.array([1.0, 1.0, -1.0]), orientations)
        return cls(_Recording(CameraPath("head", poses.times_ms, poses.positions, poses.orientations)))

    def offset(self, t_ms: float, latency_ms: float) -> tuple[Doubles, Doubles]:
        """What the head does from t_ms to t_ms + latency_ms, seen from where it was.

        Returns the translation, float64 (3) in metres, and the rotation, a unit quaternion x, y, z, w, both in the
        frame of the head at t_ms; nothing for no latency. A recording starts at t_ms = 0 and repeats.
        """
        if isinstance(self.source, _Recording):
            t_ms = t_ms % max(self.source.length_ms - latency_ms, 1.0)
        here, facing = self.source.pose_at(t_ms)
        there, turned = self.source.pose_at(t_ms + latency_ms)
        return rotate(conjugate(facing), there - here), multiply(conjugate(facing), turned)
