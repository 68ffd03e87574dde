"""Where a person can walk in a scene that brings no route: free space around a viewpoint, and a way through it.

Space around the viewpoint is cut into cells of 10 cm. From the floor under the viewpoint the reachable floor spreads
over steps of up to 20 cm; a column is free where nothing stands between knee and head. The way leads along cells that
keep clear of everything, far away first where there is room, and back again where there is not.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Bools, Doubles, Floats
from shading_atlas_bench.arithmetic.functions import hypot
from shading_atlas_bench.arithmetic.matrices import dot, product
from shading_atlas_bench.scenes.lines import smoothed
from shading_atlas_bench.scenes.model import Indices, Scene
from shading_atlas_bench.scenes.work import Work

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

CELL = 0.1  # metres
REACH = 8.0  # metres around the viewpoint that are explored
MOST_POINTS = 12_000_000  # on surfaces in the space explored, and halves of triangles; real places have 2 million
BELOW, ABOVE = 4.5, 1.5  # metres below and above the eyes that are explored
STEP = 2  # cells up or down that a person takes in one stride
STEEPEST = 3  # cells up or down within half a metre: slopes and steps, but not onto a sofa
KNEE = 0.45  # metres above the floor: lower things are stepped over
HEADROOM = 0.3  # metres above the eyes
CLEARANCE = 0.35  # metres from the eyes to the nearest column that is not free
EYE_HEIGHT = 1.6  # metres, where the scene's camera does not say
LOWEST, TALLEST = 0.8, 3.0  # metres from eye to floor; a camera that is lower or higher flies instead of walking
SHORTEST_ROUTE = 1.0  # metres


@dataclass(frozen=True)
class Route:
    """A way for the eyes.

    eyes: origin-relative points in scene units, float64 (N, 3). direction: the first direction of view.
    on_floor: whether the eyes follow a floor, or stay level because there is none at a person's height below them.
    """

    eyes: Doubles
    direction: Doubles
    on_floor: bool


def surface_points(scene: Scene, low: Doubles, high: Doubles, spacing: float) -> tuple[Doubles, Indices]:
    """Points (N, 3) on the triangles inside the box low..high, at most `spacing` apart, and the triangles' ids (N).

    In scene units. Triangles are halved along their longest edge until they are at most 4 spacings long, and then
    covered by a lattice of points; halves outside the box are dropped on the way, so that the cost depends on the
    surface inside the box only. Raises WorkError where that takes more than MOST_POINTS.
    """
    work = Work(MOST_POINTS)
    middle = ((low + high) / 2).astype(np.float32)
    half = ((high - low) / 2).astype(np.float32)
    ids = _touching(scene, low, high)
    triangles = scene.positions[scene.indices[ids]] - middle
    points: list[Doubles] = [np.zeros((0, 3))]
    owners: list[Indices] = [np.zeros(0, np.int64)]
    while len(triangles):
        p, q, r = triangles.transpose(1, 0, 2)
        inside = ((np.minimum(np.minimum(p, q), r) <= half) & (np.maximum(np.maximum(p, q), r) >= -half)).all(axis=1)
        triangles, ids = triangles[inside], ids[inside]
        edges = triangles[:, [1, 2, 0]] - triangles
        edges = dot(edges, edges)
        longest = edges.max(axis=1, initial=0)
        done = longest <= 16 * spacing * spacing
        small = longest <= spacing * spacing
        for chosen, steps in ((small, 1), (done & ~small, 4)):
            work.take(int(chosen.sum()) * len(_LATTICES[steps]))
            points.append(product(_LATTICES[steps], triangles[chosen]).reshape(-1, 3))
            owners.append(np.repeat(ids[chosen], len(_LATTICES[steps])))
        work.take(2 * int((~done).sum()))
        triangles, ids = _halves(triangles[~done], edges[~done]), np.tile(ids[~done], 2)
    found, owner = np.concatenate(points), np.concatenate(owners)
    inside = (np.abs(found) < half).all(axis=1)
    return found[inside] + (low + high) / 2, owner[inside]


def _lattice(steps: int) -> Floats:
    """Barycentric coordinates float32 (N, 3) of a triangular lattice that cuts each edge into `steps`."""
    i, j = np.meshgrid(np.arange(steps + 1), np.arange(steps + 1))
    keep = i + j <= steps
    return (np.stack([i[keep], j[keep], (steps - i - j)[keep]], axis=1) / steps).astype(np.float32)


_LATTICES = {steps: _lattice(steps) for steps in (1, 4)}


def _touching(scene: Scene, low: Doubles, high: Doubles) -> Indices:
    """Ids of the triangles that do not lie on one side of a box."""
    code = np.zeros(len(scene.positions), np.uint8)
    for axis in range(3):
        code |= (scene.positions[:, axis] < low[axis]).astype(np.uint8) << (2 * axis)
        code |= (scene.positions[:, axis] > high[axis]).astype(np.uint8) << (2 * axis + 1)
    a, b, c = scene.indices.T
    return np.flatnonzero((code[a] & code[b] & code[c]) == 0)


def _halves(triangles: Floats, edges: Doubles) -> Floats:
    """Both halves (2 N, 3, 3) of triangles cut through the middle of their longest edge; edges: squared lengths."""
    rows, first = np.arange(len(triangles)), edges.argmax(axis=1)
    p, q, r = (triangles[rows, (first + k) % 3] for k in range(3))
    middle = (p + q) / 2
    return np.concatenate([np.stack([p, middle, r], axis=1), np.stack([middle, q, r], axis=1)])


def carries(scene: Scene, ids: Indices) -> Bools:
    """Whether triangles carry a person, bool (N) for ids int (N): not steep ones, and not leaves and grass, which are
    alpha-masked."""
    corners = scene.positions[scene.indices[ids]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    level = np.abs(normals[:, 1]) > 0.7 * np.linalg.norm(normals, axis=1)
    opaque = np.array([m.alpha_mode != "mask" for m in scene.materials] or [True])
    carrying: Bools = level & opaque[scene.material_ids[ids]]
    return carrying


def _on_floors(scene: Scene, owner: Indices) -> Bools:
    """Whether points (N), given by their triangles' ids, lie on triangles that carry a person."""
    ids, inverse = np.unique(owner, return_inverse=True)
    return carries(scene, ids)[inverse]


class Surroundings:
    """The free columns around an eye point and the height of their floors.

    All in metres relative to the eye. `free` bool and `floor` (height of the floor) have shape (N, N), x first.
    """

    def __init__(self, scene: Scene, eye: Doubles) -> None:
        self.size = int(2 * REACH / CELL)
        unit = scene.metres_per_unit
        low, high = np.array([-REACH, -BELOW, -REACH]), np.array([REACH, ABOVE, REACH])
        shape = np.round((high - low) / CELL).astype(int)
        self._base = low[1]
        points, owner = surface_points(scene, eye + low / unit, eye + high / unit, 0.9 * CELL / unit)
        index = np.minimum((((points - eye) * unit - low) / CELL).astype(np.int32), shape - 1)
        anything, floors = np.zeros((2, *shape[[0, 2, 1]]), bool)
        anything[tuple(index[:, [0, 2, 1]].T)] = True
        floors[tuple(index[_on_floors(scene, owner)][:, [0, 2, 1]].T)] = True
        ladder = np.where(floors, np.arange(shape[1], dtype=np.int16), np.int16(-1))
        self._below = np.maximum.accumulate(ladder, axis=2)  # the highest floor cell at or below each cell
        self._count = np.cumsum(anything, axis=2, dtype=np.int16)
        self._spread()

    def _spread(self) -> None:
        """Fill `free` and `floor` from the viewpoint's floor outwards."""
        from scipy.ndimage import maximum_filter, minimum_filter

        eye = round(-self._base / CELL)
        middle = self.size // 2
        under = self._below[middle - 1 : middle + 2, middle - 1 : middle + 2, eye - round(LOWEST / CELL)].max()
        height = (eye - under - 1) * CELL
        self.walks = bool(under >= 0 and height <= TALLEST)
        if not self.walks:
            self.floor = np.zeros((self.size, self.size))
            self.free = self._empty(np.full((self.size, self.size), eye - 4), np.full((self.size, self.size), eye + 3))
            return
        self.eye_height = height
        level = np.full((self.size, self.size), -1, np.int16)
        everywhere = np.indices((self.size, self.size)).reshape(2, -1)
        start, free = self._stand(everywhere, np.full(everywhere.shape[1], under))
        x, z = (everywhere - middle).astype(np.float64)
        away = hypot(x, z) + 1e6 * ~free
        first = int(np.argmin(away))
        if away[first] < 1.5 / CELL:
            level[tuple(everywhere[:, first])] = start[first]
            self._flood(level, everywhere[:, first : first + 1])
        known = level >= 0
        rise = maximum_filter(level, 5) - minimum_filter(np.where(known, level, np.int16(9999)), 5)
        self.free = known & (rise <= STEEPEST)
        self.floor = self._base + (level + 1) * CELL

    def _flood(self, level: Indices, front: Indices) -> None:
        """Spread `level` (floor cells, -1 unknown) from columns `front` (2, n) to all that can be walked to."""
        while front.shape[1]:
            columns = np.concatenate(
                [front + np.array([[dx], [dz]]) for dx, dz in ((1, 0), (-1, 0), (0, 1), (0, -1))], 1
            )
            levels = np.tile(level[tuple(front)], 4)
            inside = ((columns >= 0) & (columns < self.size)).all(axis=0)
            columns, levels = columns[:, inside], levels[inside]
            unseen = level[tuple(columns)] < 0
            columns, levels = columns[:, unseen], levels[unseen]
            columns, one = np.unique(columns, axis=1, return_index=True)
            found, free = self._stand(columns, levels[one])
            front = columns[:, free]
            level[tuple(front)] = found[free]

    def _stand(self, columns: Indices, level: Indices) -> tuple[Indices, Bools]:
        """The floor cell in columns (2, n) within one step of `level` (n), and whether a person can stand there."""
        found = self._below[columns[0], columns[1], np.minimum(level + STEP, self._below.shape[2] - 1)]
        stands = (found >= level - STEP) & (found >= 0)
        low = found + round(KNEE / CELL)
        high = found + round((self.eye_height + HEADROOM) / CELL) + 1
        return found, stands & (high < self._count.shape[2]) & self._empty(low, high, columns)

    def _empty(self, low: Indices, high: Indices, columns: Indices | None = None) -> Bools:
        """Whether the cells above `low` up to `high` of each column hold nothing."""
        x, z = np.indices((self.size, self.size)) if columns is None else columns
        top = self._count.shape[2] - 1
        empty: Bools = self._count[x, z, np.clip(high, 0, top)] == self._count[x, z, np.clip(low, 0, top)]
        return empty


def route_from(scene: Scene, eye: Doubles, direction: Doubles, length: float) -> Route | None:
    """A way of at least `length` metres from near `eye` (3), or None where there is no room to walk.

    eye: origin-relative, scene units. direction: of the view; a way that leads there is preferred. Raises WorkError
    where there is too much around to look for one.
    """
    from scipy.ndimage import distance_transform_edt

    around = Surroundings(scene, eye)
    clear = distance_transform_edt(around.free) * CELL
    cells = _legs(clear, np.asarray(direction, np.float64)[[0, 2]], length)
    if cells is None:
        return None
    for smoothing in (8.0, 5.0, 3.0, 1.5, 0.0):
        line = smoothed(cells, smoothing) if smoothing else cells
        if _lookup(clear, line).min() >= CLEARANCE - 0.1:
            break
    heights = smoothed(_lookup(around.floor, line), 4.0)
    offsets = np.stack([line[:, 0], heights, line[:, 1]], axis=1)
    offsets[:, [0, 2]] = (offsets[:, [0, 2]] + 0.5) * CELL - REACH
    if around.walks:
        offsets[:, 1] += around.eye_height
    return Route(eye + offsets / scene.metres_per_unit, np.asarray(direction, np.float64), around.walks)


def _lookup(grid: Doubles, cells: Doubles) -> Doubles:
    """Values of a grid at cell coordinates (N, 2)."""
    index = np.clip(np.round(cells).astype(int), 0, np.array(grid.shape) - 1)
    values: Doubles = grid[index[:, 0], index[:, 1]]
    return values


def _legs(clear: Doubles, direction: Doubles, length: float) -> Doubles | None:
    """Cell coordinates (N, 2) of a way of `length` metres: to the farthest place, then on to the next farthest."""
    usable = clear >= CLEARANCE
    cells = np.argwhere(usable)
    if not len(cells):
        return None
    graph = _graph(usable, clear)
    middle = (np.array(clear.shape) - 1) / 2
    here = int(np.argmin(np.linalg.norm(cells - middle, axis=1)))
    if np.linalg.norm(cells[here] - middle, axis=-1) * CELL > 1.5:
        return None
    forward = direction / max(np.linalg.norm(direction, axis=-1), 1e-9)
    way, walked = [cells[here : here + 1]], 0.0
    while walked < length:
        leg = _farthest(graph, cells, here, forward, length - walked)
        if len(leg) < 2 or (not walked and (len(leg) - 1) * CELL < SHORTEST_ROUTE):
            return None
        way.append(cells[leg[1:]])
        walked += float(np.linalg.norm(np.diff(cells[leg], axis=0), axis=1).sum()) * CELL
        here, forward = leg[-1], np.zeros(2)
    return np.concatenate(way).astype(np.float64)


def _graph(usable: Bools, clear: Doubles) -> csr_matrix:
    """The graph of usable cells and their eight neighbours; edges cost more where it is narrow."""
    from scipy.sparse import coo_matrix

    number = np.full(usable.shape, -1)
    number[usable] = np.arange(usable.sum())
    rows, columns, costs = [], [], []
    for dx, dz in ((1, 0), (0, 1), (1, 1), (1, -1)):
        a = number[: -dx or None, max(0, -dz) : (-dz if dz > 0 else None)]
        b = number[dx:, max(0, dz) : (dz if dz < 0 else None)]
        both = (a >= 0) & (b >= 0)
        narrow = clear[: -dx or None, max(0, -dz) : (-dz if dz > 0 else None)][both]
        rows.append(a[both])
        columns.append(b[both])
        costs.append(hypot(dx, dz) * CELL * (1 + 0.3 / narrow))
    count = int(usable.sum())
    entries = (np.concatenate(costs), (np.concatenate(rows), np.concatenate(columns)))
    return coo_matrix(entries, shape=(count, count)).tocsr()


def _farthest(graph: csr_matrix, cells: Indices, here: int, forward: Doubles, wanted: float) -> list[int]:
    """The cheapest way from cell `here` to the best goal: `wanted` metres away if possible, `forward` preferred."""
    from scipy.sparse.csgraph import dijkstra

    cost, before = dijkstra(graph, directed=False, indices=here, return_predecessors=True)
    offset = (cells - cells[here]) * CELL
    away = np.linalg.norm(offset, axis=1)
    ahead = dot(offset, forward) / np.maximum(away, 1e-9)
    score = np.where(
        np.isfinite(cost), np.minimum(cost, 1.2 * wanted + 1) + 3 * ahead * np.minimum(away, 3) / 3, -np.inf
    )
    goal = int(np.argmax(score))
    way = [goal]
    while way[-1] != here:
        way.append(int(before[way[-1]]))
    return way[::-1]
