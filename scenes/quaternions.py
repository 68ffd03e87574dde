"""Unit quaternions x, y, z, w as arrays (..., 4): a rotation takes a vector from the rotated frame to the outer one."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from shading_atlas_bench.arithmetic.arrays import Doubles
from shading_atlas_bench.arithmetic.functions import arctan2, sin_cos
from shading_atlas_bench.arithmetic.matrices import dot


def multiply(a: ArrayLike, b: ArrayLike) -> Doubles:
    """Rotation b followed by rotation a, (..., 4)."""
    a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)
    vector: Doubles = a[..., 3:] * b[..., :3] + b[..., 3:] * a[..., :3] + np.cross(a[..., :3], b[..., :3])
    scalar: Doubles = a[..., 3] * b[..., 3] - np.sum(a[..., :3] * b[..., :3], axis=-1)
    return np.concatenate([vector, scalar[..., None]], axis=-1)


def conjugate(q: ArrayLike) -> Doubles:
    """The inverse rotation of unit quaternions (..., 4)."""
    inverse: Doubles = np.asarray(q, np.float64) * np.array([-1.0, -1.0, -1.0, 1.0])
    return inverse


def rotate(q: ArrayLike, v: Doubles) -> Doubles:
    """Vectors (..., 3) rotated by unit quaternions (..., 4)."""
    q = np.asarray(q, np.float64)
    twice = 2 * np.cross(q[..., :3], v)
    rotated: Doubles = v + q[..., 3:] * twice + np.cross(q[..., :3], twice)
    return rotated


def about(axis: int, radians: Doubles | float) -> Doubles:
    """Rotations (..., 4) by radians (...) about coordinate axis 0, 1 or 2, counter-clockwise as seen from its tip."""
    half = np.asarray(radians, np.float64) / 2
    out = np.zeros((*half.shape, 4))
    out[..., axis], out[..., 3] = sin_cos(half)
    return out


def looking(direction: ArrayLike, up: ArrayLike = (0.0, 1.0, 0.0)) -> Doubles:
    """Camera-to-world orientations (..., 4) that look along directions (..., 3) with `up` (..., 3) upwards."""
    direction = np.asarray(direction, np.float64)
    back = -direction / np.linalg.norm(direction, axis=-1, keepdims=True)
    right = np.cross(np.broadcast_to(np.asarray(up, np.float64), back.shape), back)
    flat = np.linalg.norm(right, axis=-1, keepdims=True) < 1e-9
    helper = np.eye(3)[np.argmin(np.abs(back), axis=-1)]
    right = np.where(flat, np.cross(helper, back), right)
    right /= np.linalg.norm(right, axis=-1, keepdims=True)
    return from_matrix(np.stack([right, np.cross(back, right), back], axis=-1))


def from_matrix(m: Doubles) -> Doubles:
    """Unit quaternions (..., 4) of rotation matrices (..., 3, 3); w is never negative."""
    diagonal = m[..., [0, 1, 2], [0, 1, 2]]
    trace = diagonal.sum(axis=-1, keepdims=True)
    squares = np.concatenate([1 + 2 * diagonal - trace, 1 + trace], axis=-1)  # four times the components' squares
    x, y, z = (m[..., 2, 1], m[..., 1, 2]), (m[..., 0, 2], m[..., 2, 0]), (m[..., 1, 0], m[..., 0, 1])
    products = np.empty((*m.shape[:-2], 4, 4))  # four times each product of two components
    products[..., [0, 1, 2, 3], [0, 1, 2, 3]] = squares
    for i, (plus, minus) in enumerate((x, y, z)):
        products[..., i, 3] = products[..., 3, i] = plus - minus
        j, k = (i + 1) % 3, (i + 2) % 3
        products[..., j, k] = products[..., k, j] = m[..., j, k] + m[..., k, j]
    best = np.take_along_axis(products, np.argmax(squares, axis=-1)[..., None, None], axis=-2)[..., 0, :]
    return upright(best / np.linalg.norm(best, axis=-1, keepdims=True))


def upright(q: Doubles) -> Doubles:
    """The same rotations (..., 4) with w >= 0."""
    return np.where(q[..., 3:] < 0, -q, q)


def slerp(a: Doubles, b: Doubles, t: ArrayLike) -> Doubles:
    """Rotations `t` (...) of the short way from a to b (..., 4); t outside 0..1 goes on turning at the same speed."""
    cosine = dot(a, b)[..., None]
    b, cosine = np.where(cosine < 0, -b, b), np.where(cosine < 0, -cosine, cosine)
    rest = b - cosine * a
    sine = np.linalg.norm(rest, axis=-1, keepdims=True)
    still = sine < 1e-12
    away, stay = sin_cos(arctan2(sine, cosine) * np.asarray(t, np.float64)[..., None])
    out = a * stay + rest * (away / np.where(still, 1, sine))
    length = np.where(still, 1, np.linalg.norm(out, axis=-1, keepdims=True))
    return np.where(still, a, out / length)
