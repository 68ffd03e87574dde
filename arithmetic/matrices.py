"""Products, inverses and eigenvectors of small float64 matrices, summed in a fixed order.

For matrices of a few rows and any number of them at once; stacks broadcast over leading axes as in NumPy.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from shading_atlas_bench.arithmetic.arrays import Doubles


def dot(a: ArrayLike, b: ArrayLike) -> Doubles:
    """Sums of a * b over the last axis, from its first element to its last: float64 (...)."""
    a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)
    total: Doubles = a[..., 0] * b[..., 0]
    for k in range(1, max(a.shape[-1], b.shape[-1])):
        total = total + a[..., k] * b[..., k]
    return total


def product(*matrices: ArrayLike) -> Doubles:
    """Product of matrices (..., M, K), (..., K, N) and so on, from left to right: float64 (..., M, N) with the rows of
    the first and the columns of the last; ValueError where they do not fit."""
    total = np.asarray(matrices[0], np.float64)
    for matrix in matrices[1:]:
        matrix = np.asarray(matrix, np.float64)
        if total.shape[-1] != matrix.shape[-2]:
            raise ValueError(f"Matrices of shapes {total.shape} and {matrix.shape} have no product.")
        left, total = total, np.zeros(())
        for k in range(matrix.shape[-2]):
            total = total + left[..., :, k, None] * matrix[..., None, k, :]
    return total


def transform(matrix: ArrayLike, points: ArrayLike) -> Doubles:
    """Points (..., N, K) under matrices (..., M, K): float64 (..., N, M). K + 1 columns add the last one, a shift."""
    matrix, points = np.asarray(matrix, np.float64), np.asarray(points, np.float64)
    size = points.shape[-1]
    stack = np.broadcast_shapes(matrix.shape[:-2], points.shape[:-2])
    out = np.empty((*stack, points.shape[-2], matrix.shape[-2]))
    for row in range(matrix.shape[-2]):
        total = points[..., 0] * matrix[..., row, 0, None]
        for k in range(1, size):
            total = total + points[..., k] * matrix[..., row, k, None]
        out[..., row] = total + matrix[..., row, size, None] if matrix.shape[-1] > size else total
    return out


def matvec(matrix: ArrayLike, vector: ArrayLike) -> Doubles:
    """Vectors (..., K) under matrices (..., M, K): float64 (..., M)."""
    return dot(matrix, np.asarray(vector, np.float64)[..., None, :])


def determinant(matrix: ArrayLike) -> Doubles:
    """Determinants of matrices (..., 3, 3): float64 (...)."""
    matrix = np.asarray(matrix, np.float64)
    return dot(matrix[..., 0, :], np.cross(matrix[..., 1, :], matrix[..., 2, :]))


def cofactors(matrix: ArrayLike) -> Doubles:
    """Cofactors of matrices (..., 3, 3), float64 (..., 3, 3): the inverse's transpose times the determinant."""
    matrix = np.asarray(matrix, np.float64)
    next_, last = matrix[..., [1, 2, 0], :], matrix[..., [2, 0, 1], :]
    found: Doubles = next_[..., [1, 2, 0]] * last[..., [2, 0, 1]] - next_[..., [2, 0, 1]] * last[..., [1, 2, 0]]
    return found


def inverse(matrix: ArrayLike) -> Doubles:
    """Inverses of matrices (..., N, N) by elimination with the largest pivot; ValueError for a singular one."""
    matrix = np.asarray(matrix, np.float64)
    size = matrix.shape[-1]
    work = np.concatenate([matrix, np.broadcast_to(np.eye(size), matrix.shape)], axis=-1).reshape(-1, size, 2 * size)
    each = np.arange(len(work))
    for k in range(size):
        pivot = k + np.argmax(np.abs(work[:, k:, k]), axis=1)
        work[each, k], work[each, pivot] = work[each, pivot], work[each, k].copy()
        if not work[:, k, k].all():
            raise ValueError("A matrix has no inverse.")
        work[:, k] /= work[:, k, k, None]
        others = np.arange(size) != k
        work[:, others] -= work[:, others, k, None] * work[:, k, None]
    return work[..., size:].reshape(matrix.shape)


def eigenvectors(matrix: ArrayLike) -> tuple[Doubles, Doubles]:
    """Eigenvalues (N), rising, and unit eigenvectors, the columns of (N, N), of a symmetric matrix, by Jacobi's turns.

    An eigenvector's component of largest magnitude, the first of equals, is positive. ValueError for a matrix that is
    not finite, on which the turns would never end.
    """
    a = np.array(matrix, np.float64)
    if not np.isfinite(a).all():
        raise ValueError("A matrix that is not finite has no eigenvectors.")
    size = len(a)
    vectors = np.eye(size)
    while _turn_all(a, vectors):
        pass
    order = np.argsort(np.diag(a), kind="stable")
    vectors = vectors[:, order]
    largest = vectors[np.argmax(np.abs(vectors), axis=0), np.arange(size)]
    return np.diag(a)[order], vectors * np.where(largest < 0, -1.0, 1.0)


def _turn_all(a: Doubles, vectors: Doubles) -> bool:
    """One sweep over all pairs of rows, in place; whether any entry off the diagonal was not yet negligible."""
    changed = False
    for p in range(len(a) - 1):
        for q in range(p + 1, len(a)):
            if abs(a[p, q]) <= 1e-17 * math.sqrt(abs(a[p, p] * a[q, q])) or abs(a[p, q]) < 1e-300:
                continue
            changed = True
            slope = (a[q, q] - a[p, p]) / (2 * a[p, q])
            tangent = math.copysign(1.0, slope) / (abs(slope) + math.sqrt(slope * slope + 1))
            cosine = 1 / math.sqrt(tangent * tangent + 1)
            _turn(a, p, q, cosine, tangent * cosine)
            _turn(a.T, p, q, cosine, tangent * cosine)
            _turn(vectors.T, p, q, cosine, tangent * cosine)
            a[p, q] = a[q, p] = 0.0
    return changed


def _turn(rows: Doubles, p: int, q: int, cosine: float, sine: float) -> None:
    """Rows p and q turned into each other, in place."""
    first, second = rows[p].copy(), rows[q].copy()
    rows[p], rows[q] = cosine * first - sine * second, sine * first + cosine * second
