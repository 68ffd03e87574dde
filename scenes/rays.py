"""Rays against all triangles: for finding out about a place, not for drawing it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from shading_atlas_bench.arithmetic.arrays import Bools, Doubles, Floats, Ints
from shading_atlas_bench.arithmetic.matrices import transform
from shading_atlas_bench.scenes.model import Indices, Scene
from shading_atlas_bench.scenes.work import Work

_SLACK = 1e-4  # of the distance: what float32 may lose before a bounding sphere is taken as missed
_CHUNK = 1 << 15  # triangles at a time: temporaries stay in the processor's cache
_PAIRS = 1 << 15  # of a ray and a triangle at a time, likewise
TURNS = 48  # azimuths of a panorama
SLOPES = np.linspace(-0.3, 0.3, 7)  # sines of its elevations: what a picture of 16:9 and 60 degrees shows


@dataclass(frozen=True)
class Panorama:
    """What is seen all around from a point, all (TURNS, SLOPES).

    distances: float64, scene units, infinity where nothing is. triangles: int64, -1 where nothing is. fronts: bool,
    whether it is the triangle's front that is seen.
    """

    distances: Doubles
    triangles: Indices
    fronts: Bools

    @classmethod
    def empty(cls) -> Panorama:
        """A panorama in which no ray meets anything."""
        shape = TURNS, len(SLOPES)
        return cls(np.full(shape, np.inf), np.full(shape, -1), np.zeros(shape, bool))


class Rays:
    """Casts rays at a scene: single ones take about 10 ms per million triangles, a panorama fifteen times that.

    work: counts the pairs of a ray and a triangle that panoramas look at, about 0.3 us each.
    """

    def __init__(self, scene: Scene, work: Work | None = None) -> None:
        self._scene, self._work = scene, work
        corners = [scene.positions[scene.indices[:, corner]] for corner in range(3)]
        centres = (np.minimum.reduce(corners) + np.maximum.reduce(corners)) / 2
        reach = np.maximum.reduce([np.linalg.norm(corner - centres, axis=1) for corner in corners])
        self._centres, self._radii = np.ascontiguousarray(centres.T), reach

    def distance(self, start: ArrayLike, direction: ArrayLike) -> float:
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

    def panorama(self, start: Doubles) -> Panorama:
        """What is seen all around from `start` (3), in the directions of `panorama_directions`.

        Raises WorkError where that would be more work than there may be.
        """
        start = np.asarray(start, np.float64)
        parts = [part for number in range(0, len(self._radii), _CHUNK) for part in self._met(start, number)]
        triangle, turn, slope, distance, front = (np.concatenate(part) for part in zip(*parts, strict=True))
        # The nearest is written last, and a front after the backs that lie on it.
        order = np.lexsort((front, -distance.astype(np.float32)))
        seen, cells = Panorama.empty(), (turn[order], slope[order])
        seen.distances[cells], seen.triangles[cells], seen.fronts[cells] = (
            distance[order],
            triangle[order],
            front[order],
        )
        return seen

    def _met(self, start: Doubles, number: int) -> Iterator[tuple[Indices, Indices, Indices, Doubles, Bools]]:
        """What directions of a panorama meet of _CHUNK triangles from `number` on, some of these at a time: triangles,
        the directions' two numbers, distances, and whether fronts are met, all (N)."""
        candidates, first, counts = self._windows(start, number)
        directions = panorama_directions()
        if self._work:
            self._work.take(int((counts[0].astype(np.int64) * counts[1]).sum()))
        for some in window_groups(*counts):
            owner, turn, slope = lattice_pairs(*counts[:, some])
            owner += some.start
            triangle, turn, slope = candidates[owner], (first[0, owner] + turn) % TURNS, first[1, owner] + slope
            ways = directions[turn, slope].T
            near = self._near(triangle, start, ways)
            triangle, turn, slope = triangle[near], turn[near], slope[near]
            corners = self._scene.positions[self._scene.indices[triangle]].astype(np.float64) - start
            distance, front = _crossings(corners, ways[:, near])
            hit = np.isfinite(distance)
            yield triangle[hit], turn[hit], slope[hit], distance[hit], front[hit]

    def _near(self, triangles: Indices, start: Doubles, ways: Doubles) -> Bools:
        """Which of some triangles (N) have a bounding sphere that the direction beside it (3, N) may meet."""
        offset = [self._centres[axis, triangles] - start[axis] for axis in range(3)]
        along = sum(part * way for part, way in zip(offset, ways, strict=True))
        squared = sum(part * part for part in offset)
        radii = self._radii[triangles]
        near: Bools = (squared - along * along <= radii * radii + _SLACK * squared) & (along > -radii)
        return near

    def _windows(self, start: Doubles, number: int) -> tuple[Indices, Ints, Ints]:
        """Of _CHUNK triangles from `number` on those (N) that directions of a panorama may meet: their numbers, the
        first direction (2, N) of each along both axes, and how many (2, N) from there on."""
        rows = slice(number, number + _CHUNK)
        x, y, z = (self._centres[axis, rows] - np.float32(start[axis]) for axis in range(3))
        squared = x * x + z * z
        level, away = np.sqrt(squared), np.maximum(np.sqrt(squared + y * y), np.float32(1e-30))
        radii = self._radii[rows] * np.float32(1.0001) + np.float32(1e-5) * away
        # A sphere fills arcsin(radius / distance), which is at most pi / 2 of the quotient, either way.
        height = np.where(radii < away, np.float32(1.571) * radii / away, np.float32(2))
        middle = y / away
        seen = np.flatnonzero(np.abs(middle) - height <= np.float32(SLOPES[-1]))
        height, middle, level, radii = height[seen], middle[seen], level[seen], radii[seen]
        around = radii >= level
        width = np.where(around, np.float32(4), np.float32(1.571) * radii / np.where(around, np.float32(1), level))
        turn, pitch, step = _diamond(x[seen], z[seen]), np.float32(4 / TURNS), np.float32(SLOPES[1] - SLOPES[0])
        lowest = np.float32(SLOPES[0])
        low = np.stack([(turn - width) / pitch - np.float32(0.5), (middle - height - lowest) / step])
        high = np.stack([(turn + width) / pitch - np.float32(0.5), (middle + height - lowest) / step])
        first, last = np.ceil(low).astype(np.int32), np.floor(high).astype(np.int32)
        first[1], last[1] = np.maximum(first[1], 0), np.minimum(last[1], len(SLOPES) - 1)
        counts = np.minimum(last - first + 1, np.array([[TURNS], [len(SLOPES)]], np.int32))
        met = (counts > 0).all(axis=0)
        return number + seen[met], first[:, met], counts[:, met]


def panorama_directions() -> Doubles:
    """Unit directions, float64 (TURNS, SLOPES, 3): even in diamond angle from x towards z, and in height."""
    quarter, part = np.divmod((np.arange(TURNS) + 0.5) * 4 / TURNS, 1)
    x, z = 1 - part, part
    for _ in range(3):
        x, z = np.where(quarter > 0, -z, x), np.where(quarter > 0, x, z)
        quarter = quarter - 1
    length = np.sqrt(x * x + z * z)
    level = np.sqrt(1 - SLOPES * SLOPES)
    out = np.empty((TURNS, len(SLOPES), 3))
    out[..., 0], out[..., 2] = (x / length)[:, None] * level, (z / length)[:, None] * level
    out[..., 1] = SLOPES
    return out


def _diamond(x: Floats, z: Floats) -> Floats:
    """The angle of (x, z) in quarter turns, 0..4, as the taxi goes: monotone, never steeper than the true one."""
    length = np.abs(x) + np.abs(z)
    share = z / np.where(length > 0, length, 1)
    return np.where(x >= 0, np.where(z >= 0, share, 4 + share), 2 - share)


def lattice_pairs(rows: Indices, columns: Indices) -> tuple[Indices, Indices, Indices]:
    """All cells of windows of `rows` x `columns` (N): the window's number, the row and the column of each."""
    counts = rows.astype(np.int64) * columns
    owner = np.repeat(np.arange(len(counts)), counts)
    number = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
    return owner, *np.divmod(number, columns[owner])


def window_groups(rows: Indices, columns: Indices) -> Iterator[slice]:
    """Windows of `rows` x `columns` (N) cut into runs, one at least, of _PAIRS cells together, or little more."""
    ends = np.cumsum(rows.astype(np.int64) * columns)
    start = 0
    while True:
        before = int(ends[start - 1]) if start else 0
        stop = int(np.searchsorted(ends, before + _PAIRS)) + 1
        yield slice(start, stop)
        if stop >= len(ends):
            return
        start = stop


def _crossings(corners: Doubles, ways: Doubles) -> tuple[Doubles, Bools]:
    """Distances (N) from the origin along unit directions (3, N) to triangles (N, 3, 3), and whether fronts are met."""
    x, y, z = np.ascontiguousarray(corners.transpose(2, 1, 0))
    weights = np.empty(x.shape)
    for corner, (p, q) in enumerate(((1, 2), (2, 0), (0, 1))):
        weights[corner] = (
            (y[p] * z[q] - z[p] * y[q]) * ways[0]
            + (z[p] * x[q] - x[p] * z[q]) * ways[1]
            + (x[p] * y[q] - y[p] * x[q]) * ways[2]
        )
    area = weights.sum(axis=0)
    inside = ((weights >= 0).all(axis=0) | (weights <= 0).all(axis=0)) & (area != 0)
    weights, ways = weights[:, inside] / area[inside], ways[:, inside]
    depth = sum((weights * axis[:, inside]).sum(axis=0) * way for axis, way in zip((x, y, z), ways, strict=True))
    distance = np.full(len(corners), np.inf)
    distance[inside] = np.where(depth > 0, depth, np.inf)
    return distance, area < 0


def _nearest(corners: Doubles) -> float:
    """Smallest positive third coordinate where triangles (T, 3, 3) cross the third axis, or infinity."""
    x, y, z = corners.transpose(2, 1, 0)
    weights = np.stack([x[b] * y[c] - x[c] * y[b] for b, c in ((1, 2), (2, 0), (0, 1))])
    area = weights.sum(axis=0)
    inside = ((weights >= 0).all(axis=0) | (weights <= 0).all(axis=0)) & (area != 0)
    depth = (weights[:, inside] * z[:, inside]).sum(axis=0) / area[inside]
    return float(depth[depth > 0].min(initial=np.inf))


def _frame(direction: Doubles) -> Doubles:
    """Rows: two unit vectors across and the direction itself (3, 3)."""
    helper = np.eye(3)[np.argmin(np.abs(direction))]
    across = np.cross(helper, direction)
    across /= np.linalg.norm(across, axis=-1)
    return np.stack([across, np.cross(direction, across), direction])
