"""Normals where a file has none, and tangents where a normal map needs them."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Array, Doubles, Longs
from shading_atlas_bench.arithmetic.functions import arctan2, cos
from shading_atlas_bench.arithmetic.matrices import dot
from shading_atlas_bench.scenes.model import Indices
from shading_atlas_bench.scenes.raw import Part

CREASE_DEGREES = 50.0  # faces that meet at more keep a sharp edge; a cylinder of 8 sides is still smooth
_CHUNK = 1 << 16  # triangles or corners at a time: temporaries stay in the processor's cache
_LARGEST_FAN = 64  # corners at a vertex beyond which pairs are not compared


def with_normals(part: Part) -> Part:
    """The part with smooth normals: angle-weighted over faces within the crease angle of each other.

    Vertices at the same position count as one, where they are of one material; vertices at creases are split, so their
    number may change.
    """
    first, welded = _welded(part)
    plain = part.uvs is None and part.colours is None and not part.further_uvs
    keys: list[Longs] = []
    corners: list[Indices] = []
    normals: list[Doubles] = []
    number, count = np.empty(part.indices.size, np.int32), 0
    for chunk, flat in crease_normals(part.positions, part.indices, welded):
        vertices = part.indices.ravel()[chunk]
        vertices = first[welded[vertices]] if plain else vertices
        steps = np.rint((flat + 1) * 511).astype(np.int64)  # 10 bits each: equal enough to share a vertex
        key = vertices.astype(np.int64) << 30 | steps[:, 0] << 20 | steps[:, 1] << 10 | steps[:, 2]
        new, place, inverse = np.unique(key, return_index=True, return_inverse=True)
        number[chunk] = count + inverse
        count += len(new)
        keys.append(new)
        corners.append(chunk[place])
        normals.append(flat[place])
    order = np.argsort(np.concatenate(keys))
    places = np.empty(count, np.int32)
    places[order] = np.arange(count)
    vertices = part.indices.ravel()[np.concatenate(corners)[order]]
    split = part.taking(first[welded[vertices]] if plain else vertices, places[number].reshape(-1, 3))
    split.normals = np.concatenate(normals)[order]
    return split


def _welded(part: Part) -> tuple[Indices, Indices]:
    """The first vertex at each position of each material, and the number in these of every vertex's own, int32."""
    columns = list(np.asarray(part.positions).T)
    if part.materials is not None:
        owners = np.zeros(len(part.positions), np.int64)
        owners[part.indices] = part.materials[:, None]
        columns.append(owners)
    order = np.lexsort(columns)  # which keeps equal ones in their order
    new = np.zeros(len(order), bool)
    new[:1] = True
    for column in columns:
        ordered = column[order]
        new[1:] |= ordered[1:] != ordered[:-1]
    number = np.empty(len(order), np.int32)
    number[order] = np.cumsum(new, dtype=np.int32) - 1
    return order[new].astype(np.int32), number


def crease_normals(positions: Array, indices: Indices, welded: Indices) -> Iterator[tuple[Indices, Doubles]]:
    """Unit normals of triangles' corners: numbers of some corners, int (n), and their normals, float64 (n, 3), so many
    at a time, all those of a position together and in their order. Corner c is one of triangle c // 3.

    positions: float (V, 3). indices: int (T, 3). welded: int (V), equal for vertices at the same position.
    """
    faces, weights = np.empty((len(indices), 3)), np.empty((len(indices), 3))
    for start in range(0, len(indices), _CHUNK):
        rows = slice(start, start + _CHUNK)
        faces[rows], weights[rows] = _faces(np.asarray(positions[indices[rows]], np.float64))
    owners = welded[indices.ravel()]
    order = np.argsort(owners, kind="stable").astype(np.int32)
    starts = np.flatnonzero(np.diff(owners[order], prepend=-1))
    del owners
    cuts = np.unique(np.searchsorted(starts, np.arange(0, len(order), _CHUNK)))
    for first, last in pairwise([*cuts.tolist(), len(starts)]):
        end = starts[last] if last < len(starts) else len(order)
        corners = order[starts[first] : end]
        yield corners, _smooth(faces[corners // 3], weights.ravel()[corners], starts[first:last] - starts[first])


def _smooth(faces: Doubles, weights: Doubles, starts: Indices) -> Doubles:
    """Unit normals (n, 3) of corners, one position after the other, each from a place in `starts` on.

    faces: the normals of the corners' triangles (n, 3). weights: what each counts (n).
    """
    count = np.diff(starts, append=len(faces))
    first, size = np.repeat(starts, count), np.repeat(count, count)
    cosine = cos(np.radians(CREASE_DEGREES))
    sums = np.zeros((len(faces), 3))
    active = np.flatnonzero(size <= _LARGEST_FAN)
    for step in range(int(min(count.max(initial=0), _LARGEST_FAN))):
        active = active[size[active] > step]
        other = first[active] + (active - first[active] + step) % size[active]
        near = dot(faces[active], faces[other]) > cosine
        share = weights[other] * near
        sums[active] += faces[other] * share[:, None]
    for start, length in zip(starts[count > _LARGEST_FAN], count[count > _LARGEST_FAN], strict=True):
        rows = slice(start, start + length)
        mean = (faces[rows] * weights[rows, None]).sum(axis=0)
        mean /= max(np.linalg.norm(mean, axis=-1), 1e-300)
        sums[rows] = np.where((dot(faces[rows], mean) > cosine)[:, None], mean, faces[rows])
    return _unit(sums, faces)


def tangents(positions: Array, normals: Array, uvs: Array, indices: Indices) -> Doubles:
    """Tangents (V, 4) along growing u, perpendicular to the normals; w is the sign of the bitangent.

    positions, normals: float (V, 3), normals of length 1. uvs: float (V, 2). indices: int (T, 3).

    The bitangent w * cross(normal, tangent) points up in the image, to falling v, as the glTF specification's tangents
    do (3.7.2.1 with 3.9.3: green is up and row 0 is v = 0).
    """
    points, coordinates = np.asarray(positions, np.float64)[indices], np.asarray(uvs, np.float64)[indices]
    e1, e2 = points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]
    (u1, v1), (u2, v2) = (coordinates[:, 1] - coordinates[:, 0]).T, (coordinates[:, 2] - coordinates[:, 0]).T
    turn = np.sign(u1 * v2 - u2 * v1)[:, None]
    along_u = (e1 * v2[:, None] - e2 * v1[:, None]) * turn
    along_v = (e2 * u1[:, None] - e1 * u2[:, None]) * turn
    sums = np.zeros((2, len(positions), 3))
    for corner in range(3):
        for axis in range(3):
            for row, value in enumerate((along_u, along_v)):
                sums[row, :, axis] += np.bincount(indices[:, corner], value[:, axis], len(positions))
    normals = np.asarray(normals, np.float64)
    tangent = sums[0] - normals * dot(normals, sums[0])[:, None]
    tangent = _unit(tangent, perpendicular(normals))
    side = dot(np.cross(normals, tangent), sums[1])
    return np.concatenate([tangent, np.where(side > 0, -1.0, 1.0)[:, None]], axis=1)


def perpendicular(normals: Array) -> Doubles:
    """float64 (V, 3): some unit vector perpendicular to each normal, float (V, 3)."""
    helper = np.where(np.abs(normals[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    return _unit(np.cross(normals, helper), helper)


def _faces(corners: Doubles) -> tuple[Doubles, Doubles]:
    """Unit face normals (T, 3), zero where a face has no area, and the corners' angles (T, 3)."""
    edges = corners[:, [1, 2, 0]] - corners
    normal = np.cross(edges[:, 0], edges[:, 1])
    back = -edges[:, [2, 0, 1]]
    sine = np.linalg.norm(normal, axis=1)[:, None]
    angle = arctan2(sine, dot(edges, back))
    return _unit(normal, np.zeros_like(normal)), angle


def _unit(vectors: Doubles, otherwise: Doubles) -> Doubles:
    """Vectors (N, 3) at length 1; `otherwise` where they have none."""
    largest = np.abs(vectors).max(axis=1, initial=0)[:, None]  # first, so that squares neither over- nor underflow
    usable = (largest > 0) & np.isfinite(largest)
    scaled = vectors / np.where(usable, largest, 1)
    length = np.linalg.norm(scaled, axis=1, keepdims=True)
    return np.where(usable, scaled / np.where(usable, length, 1), otherwise)
