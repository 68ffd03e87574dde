"""Matrices of affine transforms, column vectors, many at once."""

from __future__ import annotations

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Array, Doubles
from shading_atlas_bench.arithmetic.matrices import cofactors, dot


def compose(translation: Array, rotation: Array, scale: Array) -> Doubles:
    """Matrices (N, 4, 4), float64, from translations (N, 3), quaternions (N, 4) x, y, z, w and scales (N, 3)."""
    rotation = rotation.astype(np.float64)
    length = np.linalg.norm(rotation, axis=1, keepdims=True)
    x, y, z, w = (rotation / np.where(length > 0, length, 1)).T
    matrices = np.zeros((len(rotation), 4, 4))
    matrices[:, 0, :3] = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)], axis=1)
    matrices[:, 1, :3] = np.stack([2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)], axis=1)
    matrices[:, 2, :3] = np.stack([2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)], axis=1)
    matrices[:, :3, :3] *= scale[:, None, :]
    matrices[:, :3, 3] = translation
    matrices[:, 3, 3] = 1
    return matrices


def normal_matrices(linear: Doubles) -> Doubles:
    """Matrices (N, 3, 3) that carry normals along with (N, 3, 3): the inverse transpose up to a positive factor."""
    found = cofactors(linear)
    sign = np.where(dot(linear[:, 0], found[:, 0]) < 0, -1.0, 1.0)
    return found * sign[:, None, None]
