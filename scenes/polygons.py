"""Polygons of more than three corners as triangles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Array, Bools, Doubles, Longs
from shading_atlas_bench.arithmetic.matrices import dot
from shading_atlas_bench.scenes.model import Indices
from shading_atlas_bench.scenes.raw import RawScene

_MOST_CORNERS = 256  # clipping takes time with the square of them


def triangulated(positions: Array, corners: Indices, counts: Indices, raw: RawScene) -> tuple[Longs, Indices]:
    """Triangles of polygons in 3-D, in the polygons' order, also where these are concave.

    positions: float64 (V, 3). corners: int64 (C), the vertices of all polygons, one polygon after the other.
    counts: int64 (P), corners of each polygon, at least 3. Returns places in `corners`, int64 (T, 3), and the polygon
    of each triangle, int64 (T). Polygons that no triangles cover exactly are noted.
    """
    start, pieces = np.cumsum(counts) - counts, counts - 2
    first = np.cumsum(pieces) - pieces
    triangles = np.empty((pieces.sum(), 3), np.int64)
    for size in np.unique(counts):
        rows = np.flatnonzero(counts == size)
        places = start[rows, None] + np.arange(size)
        cut = np.array([[[0, 1, 2]]])
        if size > 3:
            points = positions[corners[places]]
            normals = np.cross(points[:, 1:-1] - points[:, :1], points[:, 2:] - points[:, :1]).sum(axis=1)  # Newell's
            cut, inside = _cut_quads(points, normals) if size == 4 else _cut(points, normals)
            sentence = "Polygons whose edges cross or that are too intricate, cut into fans: {}."
            raw.note(sentence, np.count_nonzero(~inside))
        triangles[first[rows, None] + np.arange(size - 2)] = start[rows, None, None] + cut
    return triangles, np.repeat(np.arange(len(counts)), pieces)


def _cut_quads(points: Array, normals: Array) -> tuple[Indices, Bools]:
    """As `_cut`, for four corners: along the first diagonal, or along the other where only that one lies inside."""
    fans = np.array([[(0, 1, 2), (0, 2, 3)], [(1, 2, 3), (1, 3, 0)]])
    first, other = (_inside(points, fan, normals) for fan in fans)
    return fans[(~first & other).astype(np.int64)], first | other


def _cut(points: Array, normals: Array) -> tuple[Indices, Bools]:
    """Corners (P, N - 2, 3) of triangles of polygons (P, N, 3) with normals (P, 3), and whether all of these lie inside
    (P); the fan of an ear clipper, where that is enough.
    """
    size = points.shape[1]
    fan = np.array([(size - 1, i, i + 1) for i in range(size - 2)])
    cut = np.repeat(fan[None], len(points), axis=0)
    inside: Bools = np.all(dot(_areas(points, fan), normals[:, None]) > 0, axis=1)
    for row in np.flatnonzero(~inside):
        cut[row] = triangulate(points[row])
        inside[row] = _inside(points[row][None], cut[row], normals[row][None])[0]
    return cut, inside


def _inside(points: Array, triangles: Indices, normals: Array) -> Bools:
    """Whether no triangle turns against its polygon by more than rounding, nor do all areas cancel: bool (P)."""
    areas = _areas(points, triangles)
    square = dot(normals, normals)
    turns: Bools = np.all(dot(areas, normals[:, None]) >= -1e-9 * square[:, None], axis=1)
    covers: Bools = square >= 1e-12 * dot(areas, areas).max(axis=1)
    return turns & covers


def _areas(points: Array, triangles: Indices) -> Array:
    """Normals, twice the areas long, of triangles (K, 3) of polygons (P, N, 3): (P, K, 3)."""
    a, b, c = (points[:, triangles[:, corner]] for corner in range(3))
    return np.cross(b - a, c - a)


def vertex_numbers(values: Array) -> Longs:
    """Numbers of vertices as a file has them, (C) of any numbers, as int64; raises ValueError where one is no whole
    number."""
    if values.dtype.kind == "f":
        broken = np.flatnonzero(~(np.isfinite(values) & (np.floor(values) == values)))
        if broken.size:
            raise ValueError(f"a face refers to vertex {values[broken[0]]:g}, which is no whole number")
        values = np.clip(values, -(2.0**62), 2.0**62)  # no vertices either way
    return values.astype(np.int64)


def usable_polygons(corners: Indices, counts: Indices, vertices: int, raw: RawScene) -> Bools:
    """Polygons, bool (P), of three corners or more that all refer to one of so many vertices; the others are noted.

    corners: int64 (C), the vertices of all polygons, one polygon after the other. counts: int64 (P), corners of each.
    """
    full = counts >= 3
    raw.note("Faces of fewer than three corners, dropped: {}.", np.count_nonzero(~full))
    missing = np.concatenate([[0], np.cumsum((corners < 0) | (corners >= vertices))])
    end = np.cumsum(counts)
    inside: Bools = missing[end] == missing[end - counts]
    raw.note("Faces that refer to missing vertices, dropped: {}.", np.count_nonzero(full & ~inside))
    return full & inside


def distinct(columns: Sequence[Indices]) -> tuple[Indices, Indices]:
    """Rows of several int64 columns (C), none negative, that occur first, and the number of such a row for each row."""
    key = columns[0]
    for column in columns[1:]:
        many = int(column.max()) + 1
        if int(key.max()) >= 2**62 // many:
            key = np.unique(key, return_inverse=True)[1]
        key = key * many + column
    _, first, number = np.unique(key, return_index=True, return_inverse=True)
    return first, number


def triangulate(points: Array) -> list[tuple[int, int, int]]:
    """Corners of N - 2 triangles that cover a simple, possibly concave polygon, float (N, 3), by clipping ears.

    The polygon's own turning sense is kept. Corners that no ear can be clipped from (crossing edges, no area) end in a
    fan, and so do polygons of more than 256 corners; every polygon gets its N - 2 triangles.
    """
    flat = _projected(np.asarray(points, np.float64))
    left = list(range(len(flat)))
    triangles = []
    place = tried = 0
    while len(left) > 3 and tried < len(left) and len(flat) <= _MOST_CORNERS:
        place %= len(left)
        if _is_ear(flat, left, place):
            triangles.append((left[place - 1], left[place], left[(place + 1) % len(left)]))
            del left[place]
            tried = 0
        else:
            place, tried = place + 1, tried + 1
    return triangles + [(left[0], left[i], left[i + 1]) for i in range(1, len(left) - 1)]


def _projected(points: Doubles) -> Doubles:
    """The polygon in its own plane (N, 2), turning counter-clockwise (Newell's normal)."""
    ahead = np.roll(points, -1, axis=0)
    normal = np.cross(points - points[0], ahead - points[0]).sum(axis=0)
    axis = int(np.argmax(np.abs(normal)))
    kept = points[:, [(axis + 1) % 3, (axis + 2) % 3]]
    return kept if normal[axis] >= 0 else kept[:, ::-1]


def _is_ear(flat: Doubles, left: list[int], i: int) -> bool:
    """Whether the corner turns left and no other corner lies in its triangle."""
    a, b, c = left[i - 1], left[i], left[(i + 1) % len(left)]
    if _turn(flat[a], flat[b], flat[c]) <= 0:
        return False
    others = flat[left]
    others = others[~(others[:, None] == flat[[a, b, c]]).all(axis=2).any(axis=1)]  # bridges to holes pass points twice
    sides = [_turn(flat[p], flat[q], others) >= 0 for p, q in ((a, b), (b, c), (c, a))]
    return not np.logical_and.reduce(sides).any()


def _turn(a: Doubles, b: Doubles, c: Doubles) -> Doubles:
    """Twice the signed area of a, b, c; c may be many points (N, 2)."""
    doubled: Doubles = (b[0] - a[0]) * (c[..., 1] - a[1]) - (b[1] - a[1]) * (c[..., 0] - a[0])
    return doubled
