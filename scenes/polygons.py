"""Polygons of more than three corners as triangles."""

from __future__ import annotations

import numpy as np

_MOST_CORNERS = 256  # clipping takes time with the square of them


def triangulate(points: np.ndarray) -> list[tuple[int, int, int]]:
    """Corners of N - 2 triangles that cover a simple, possibly concave polygon (N, 3), by clipping ears.

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


def _projected(points: np.ndarray) -> np.ndarray:
    """The polygon in its own plane (N, 2), turning counter-clockwise (Newell's normal)."""
    ahead = np.roll(points, -1, axis=0)
    normal = np.cross(points - points[0], ahead - points[0]).sum(axis=0)
    axis = int(np.argmax(np.abs(normal)))
    kept = points[:, [(axis + 1) % 3, (axis + 2) % 3]]
    return kept if normal[axis] >= 0 else kept[:, ::-1]


def _is_ear(flat: np.ndarray, left: list[int], i: int) -> bool:
    """Whether the corner turns left and no other corner lies in its triangle."""
    a, b, c = left[i - 1], left[i], left[(i + 1) % len(left)]
    if _turn(flat[a], flat[b], flat[c]) <= 0:
        return False
    others = flat[left]
    others = others[~(others[:, None] == flat[[a, b, c]]).all(axis=2).any(axis=1)]  # bridges to holes pass points twice
    sides = [_turn(flat[p], flat[q], others) >= 0 for p, q in ((a, b), (b, c), (c, a))]
    return not np.logical_and.reduce(sides).any()


def _turn(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Twice the signed area of a, b, c; c may be many points (N, 2)."""
    return (b[0] - a[0]) * (c[..., 1] - a[1]) - (b[1] - a[1]) * (c[..., 0] - a[0])
