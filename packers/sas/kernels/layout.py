"""How 1-3 triangles fill a patch's unit square, and a block's place as a bit field: what packer and client agree on.

    one           two             three
    0,0 ─── 1,0   0,0 ─── 1,0     0,0 ── apex ── 1,0
     │ 0  ╱        │ 0  ╱  │       │ 4  ╱  ╲  3  │
     │  ╱          │  ╱  1 │       │  ╱   2   ╲  │
    0,1           0,1 ─── 1,1     0,1 ────────── 1,1

u runs to the right (columns), v downwards (rows). The numbers are roles; a triangle's role and rotation say where its
corners lie: corner (rotation + k) % 3 of the triangle is corner k of the role. Every role has the same orientation, so
neighbours unfold into the square without a flip.

A location word holds twice the column of the block's centre in its lower half and twice the row in its upper half:
blocks lie at multiples of their power-of-two sides, so the number of trailing zeros of a half is the logarithm of that
side, and the rest is the place. 0 is no place.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from shading_atlas_bench.arithmetic.arrays import Array, Bytes, Longs, Words
from shading_atlas_bench.arithmetic.matrices import inverse

SINGLE_OR_FIRST, SECOND, CENTRE, RIGHT, LEFT = range(5)

# The five points of the square that corners can lie on: u, v.
POINTS = np.array([(0, 0), (1, 0), (1, 1), (0, 1), (0.5, 0)], np.float64)
APEX = 4

# For each role the points of its three corners.
ROLE_POINTS = np.array([(0, 1, 3), (2, 3, 1), (APEX, 2, 3), (APEX, 1, 2), (APEX, 3, 0)])

# For each role and corner the weight of the corner at (u, v) as a, b, c in a + b u + c v.
ROLE_WEIGHTS = inverse(np.concatenate([np.ones((5, 3, 1)), POINTS[ROLE_POINTS]], axis=2)).transpose(0, 2, 1)

# A role's place in its patch's list of members.
ROLE_SLOT = np.array([0, 1, 0, 1, 2])


def pack_role(role: NDArray[np.integer[Any]], rotation: NDArray[np.integer[Any]]) -> Bytes:
    """One byte for a triangle's role and rotation, of any shape."""
    codes: Bytes = (3 * role + rotation).astype(np.uint8)
    return codes


def corner_points(codes: NDArray[np.integer[Any]]) -> Longs:
    """Index into POINTS of each triangle's corners 0, 1, 2: int64 (n, 3), for codes made by `pack_role`."""
    role, rotation = (codes // 3).astype(np.int64), (codes % 3).astype(np.int64)
    points: Longs = ROLE_POINTS[role[:, None], (np.arange(3) - rotation[:, None]) % 3]
    return points


def pack_location(x: Array | int, y: Array | int, w: Array | int, h: Array | int) -> Words:
    """The location words, uint32, of blocks at columns x and rows y with sides 2^w and 2^h, int of any shapes that
    broadcast."""
    centre_x, centre_y = 2 * np.asarray(x) + (1 << np.asarray(w)), 2 * np.asarray(y) + (1 << np.asarray(h))
    words: Words = (centre_x | centre_y << 16).astype(np.uint32)
    return words


def unpack_location(words: Words) -> tuple[Longs, Longs, Longs, Longs]:
    """x, y, w, h, int64, of location words of any shape; meaningless where a word is 0."""
    centre_x, centre_y = words.astype(np.int64) & 0xFFFF, words.astype(np.int64) >> 16
    side_x, side_y = np.maximum(centre_x & -centre_x, 1), np.maximum(centre_y & -centre_y, 1)
    w, h = (np.frexp(side)[1].astype(np.int64) - 1 for side in (side_x, side_y))
    return (centre_x - side_x) // 2, (centre_y - side_y) // 2, w, h
