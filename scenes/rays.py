"""A few rays against all triangles: for finding out about a place, not for drawing it."""

from __future__ import annotations

import numpy as np

from arithmetic.matrices import transform
from scenes.model import Scene

_SLACK = 1e-4  # of the distance: what float32 may lose before a bounding sphere is taken as missed


class Rays:
    """Casts single rays at a scene; about 10 ms per million triangles each."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        corners = [scene.positions[scene.indices[:, corner]] for corner in range(3)]
        centres = (np.minimum.reduce(corners) + np.maximum.reduce(corners)) / 2
        reach = np.maximum.reduce([np.linalg.norm(corner - centres, axis=1) for corner in corners])
        self._centres, self._radii = np.ascontiguousarray(centres.T), reach

    def distance(self, start: np.ndarray, direction: np.ndarray) -> float:
        """Distance in scene units to the first triangle from `start` (3) along the unit `direction` (3), or infinity.

        Either side of a triangle counts.
        """
        start, direction = np.asarray(start, np.float64), np.asarray(direction, np.float64)
        x, y, z = (self._centres[axis] - np.float32(start[axis]) for axis in range(3))
        along = x * np.float32(direction[0]) + y * np.float32(direction[1]) + z * np.float32(direction[2])
        squared = x * x + y * y + z * z
        near = squared - along * along <= self._radii * self._radii + _SLACK * squared
        candidates = np.flatnonzero(near & (along > -self._radii))
        corners = self._scene.positions[self._scene.indices[candidates]].astype(np.float64)
        return _nearest(transform(_frame(direction), corners - start))


def _nearest(corners: np.ndarray) -> float:
    """Smallest positive third coordinate where triangles (T, 3, 3) cross the third axis, or infinity."""
    x, y, z = corners.transpose(2, 1, 0)
    weights = np.stack([x[b] * y[c] - x[c] * y[b] for b, c in ((1, 2), (2, 0), (0, 1))])
    area = weights.sum(axis=0)
    inside = ((weights >= 0).all(axis=0) | (weights <= 0).all(axis=0)) & (area != 0)
    depth = (weights[:, inside] * z[:, inside]).sum(axis=0) / area[inside]
    return float(depth[depth > 0].min(initial=np.inf))


def _frame(direction: np.ndarray) -> np.ndarray:
    """Rows: two unit vectors across and the direction itself (3, 3)."""
    helper = np.eye(3)[np.argmin(np.abs(direction))]
    across = np.cross(helper, direction)
    across /= np.linalg.norm(across, axis=-1)
    return np.stack([across, np.cross(direction, across), direction])
