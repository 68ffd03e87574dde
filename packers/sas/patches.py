"""Patches of one to three triangles, found once per scene.

SAS groups the triangles of a mesh offline into patches of one to three, each mapped to a rectangle of the atlas; how it
chooses them is not published. Here a greedy matching on the dual graph first joins pairs, then lets single triangles
join a pair as a third. A patch's score is the atlas area it saves: the rectangles its parts would need alone, over the
rectangle it needs, times the cosine of the fold between them. That one number holds the three things that matter:
coplanarity (the cosine), squareness (a sheared patch needs a rectangle larger than its surface) and aspect (opposite
sides of different length need the longer one). Patches form where it is above 1.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray

from shading_atlas_bench.kernels.cache import cache_root, read_checked, write_checked
from shading_atlas_bench.kernels.source_digest import source_digest
from shading_atlas_bench.packers.sas.kernels.layout import (
    CENTRE,
    LEFT,
    RIGHT,
    ROLE_POINTS,
    ROLE_SLOT,
    SECOND,
    pack_role,
)
from shading_atlas_bench.packers.sas.kernels.tables import Patches

if TYPE_CHECKING:
    from shading_atlas_bench.arithmetic.arrays import Bytes, Doubles, Floats, Ints, Longs
    from shading_atlas_bench.scenes.model import Scene

CHUNK = 1 << 18  # rows per step of the score computations, so that a large scene needs little memory


# What packers hold at the moment, so that those of one scene share it.
_held: WeakValueDictionary[Path, Patches] = WeakValueDictionary()


def cached_patches(scene: Scene) -> Patches:
    """The scene's patches, from the cache if they were found before; a scene without a hash is not cached."""
    if not scene.content_hash:
        return find_patches(scene.positions, scene.indices)
    path = cache_root() / "patches" / f"{scene.content_hash}-{_sources()}"
    patches = _held.get(path) or _from_cache(path, scene)
    _held[path] = patches
    return patches


@cache
def _sources() -> str:
    """A hash of this method's sources and the shared arithmetic: other ones find other patches."""
    here = Path(__file__).parent
    root = here.parents[1]
    return source_digest(root, [*here.rglob("*.py"), *(root / "arithmetic").rglob("*.py")])


def _from_cache(path: Path, scene: Scene) -> Patches:
    content = read_checked(path)
    if content is not None:
        return _unpacked(np.frombuffer(content, np.int32), scene.triangle_count)
    found = find_patches(scene.positions, scene.indices)
    packed = found.of_triangle << 4 | found.codes
    write_checked(path, b"".join(part.tobytes() for part in (packed, found.members, found.points)))
    return found


def _unpacked(words: Ints, triangles: int) -> Patches:
    """Patches from int32 words: of each triangle its patch << 4 | code, then the members and points of all patches."""
    packed, tables = words[:triangles], words[triangles:]
    members, points = np.split(tables, [3 * len(tables) // 8])
    return Patches(packed >> 4, (packed & 15).astype(np.uint8), members.reshape(-1, 3), points.reshape(-1, 5))


def find_patches(positions: Floats, indices: Ints) -> Patches:
    """Group triangles into patches.

    positions: float32 (V, 3). indices: int32 (T, 3). Deterministic; no triangle is left out: what fits nowhere
    (degenerate triangles among them) is a patch of its own. Vertices with the same position count as one.
    """
    shape = Shapes(positions, indices)
    twin = _twin_half_edges(_weld(positions), indices)
    count = len(indices)
    partner_edge = np.full(count, -1, np.int64)  # half-edge across which a triangle is paired
    edges = np.flatnonzero(twin > np.arange(3 * count))
    gains = _in_chunks(shape.pair_gain, edges, twin[edges])
    edges = edges[gains > 1]
    chosen = edges[_match(edges // 3, twin[edges] // 3, gains[gains > 1], count)]
    partner_edge[chosen // 3] = chosen
    partner_edge[twin[chosen] // 3] = twin[chosen]

    codes = pack_role(np.zeros(count, np.int64), shape.longest_opposite)
    leader = np.arange(count)
    _place_pairs(codes, leader, chosen, twin)
    _place_thirds(shape, codes, leader, partner_edge, twin)
    lowest = np.full(count, count)
    np.minimum.at(lowest, leader, np.arange(count))
    of_triangle = np.unique(lowest[leader], return_inverse=True)[1].reshape(-1).astype(np.int32)
    return _with_members(indices, of_triangle, codes)


def _place_pairs(codes: Bytes, leader: Longs, chosen: Longs, twin: Longs) -> None:
    """Give the two triangles at each chosen half-edge the roles of a pair: right angles opposite to the diagonal."""
    other = twin[chosen]
    codes[chosen // 3] = pack_role(np.zeros(len(chosen), np.int64), (chosen % 3 + 2) % 3)
    codes[other // 3] = pack_role(np.full(len(other), SECOND), (other % 3 + 2) % 3)
    leader[other // 3] = chosen // 3


def _place_thirds(shape: Shapes, codes: Bytes, leader: Longs, partner_edge: Longs, twin: Longs) -> None:
    """Let single triangles join a neighbouring pair: its triangle between the two becomes the centre of a fan."""
    paired = partner_edge >= 0
    edges = np.flatnonzero(np.repeat(paired, 3) & (twin >= 0))
    edges = edges[~paired[twin[edges] // 3]]
    centre, single = edges // 3, twin[edges] // 3
    # The two shared half-edges leave one corner in common, the apex: the one from it belongs to the right triangle.
    inner = partner_edge[centre]
    single_is_right = edges % 3 == (inner % 3 + 1) % 3
    right, left = np.where(single_is_right, edges, inner), np.where(single_is_right, inner, edges)
    gains = _in_chunks(lambda a, b, s: shape.fan_gain(a, b, s, twin), right, left, single)
    better = gains > 1
    chosen = np.flatnonzero(better)
    pair = leader[centre]
    chosen = chosen[_match(pair[chosen], single[chosen], gains[chosen], len(codes))]
    right, left, centre, single = right[chosen], left[chosen], centre[chosen], single[chosen]
    codes[centre] = pack_role(np.full(len(centre), CENTRE), right % 3)
    codes[twin[right] // 3] = pack_role(np.full(len(centre), RIGHT), (twin[right] + 1) % 3)
    codes[twin[left] // 3] = pack_role(np.full(len(centre), LEFT), twin[left] % 3)
    leader[single] = leader[centre]


def _match(first: Longs, second: Longs, gains: Doubles, nodes: int) -> Longs:
    """Greedy matching: edges first[k] - second[k] in falling order of gain, each node in at most one; their indices.

    Each round takes every edge that is the best one at both of its ends, which gives the same result as going through
    the edges one by one. Gains are rounded and ties broken by a hash, because a regular mesh, or one whose gains rise
    steadily, would otherwise need a round for every edge along it.
    """
    coarse = np.minimum(gains * 64, 2**20).astype(np.uint64)
    key = ~((coarse << np.uint64(32)) | _hash32(np.arange(len(gains), dtype=np.uint64)))
    alive = np.argsort(key, kind="stable")
    best = np.empty(nodes, np.int64)
    taken = np.zeros(nodes, bool)
    matched = []
    while len(alive):
        a, b = first[alive], second[alive]
        order = np.arange(len(alive))
        ends = np.stack([a, b], axis=1).reshape(-1)
        best[ends[::-1]] = np.repeat(order, 2)[::-1]  # of repeated indices the last, here the best, stays
        mutual = (best[a] == order) & (best[b] == order)
        matched.append(alive[mutual])
        taken[a[mutual]] = taken[b[mutual]] = True
        alive = alive[~(taken[a] | taken[b])]
    return np.concatenate(matched) if matched else np.empty(0, np.int64)


def _hash32(values: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """A mix of 64-bit integers to 32 bits, as uint64 (multiply and shift, modulo 2^64)."""
    values = (values + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
    return ((values ^ (values >> np.uint64(29))) * np.uint64(0xBF58476D1CE4E5B9)) >> np.uint64(32)


def _weld(positions: Floats) -> Longs:
    """For each vertex the number of its position: equal for equal positions, bit for bit, and only then."""
    bits = np.ascontiguousarray(positions + np.float32(0), np.float32).view(np.uint32).astype(np.uint64)  # no -0
    mixed = _hash32(bits[:, 0] | bits[:, 1] << np.uint64(32)) << np.uint64(32)
    mixed |= _hash32(bits[:, 2] ^ mixed)
    order = np.argsort(mixed, kind="stable")
    ordered = bits[order]
    # Where two positions share a hash they lie mixed in the sequence and may stay apart, which costs a patch at worst.
    new = np.ones(len(order), bool)
    new[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    numbers = np.empty(len(order), np.int64)
    numbers[order] = np.cumsum(new) - 1
    return numbers


def _twin_half_edges(welded: Longs, indices: Ints) -> Longs:
    """For each half-edge 3 * t + k, from corner k to k + 1, the opposite half-edge of another triangle, or -1.

    Where more than two triangles meet in an edge, those next to each other in triangle order are joined.
    """
    start = welded[indices].reshape(-1)
    end = welded[np.roll(indices, -1, axis=1)].reshape(-1)
    key = (np.minimum(start, end).astype(np.uint64) << np.uint64(32)) | np.maximum(start, end).astype(np.uint64)
    order = np.argsort(key, kind="stable")
    key = key[order]
    pairs = np.flatnonzero(key[1:] == key[:-1])
    one, other = order[pairs], order[pairs + 1]
    opposite = (start[one] == end[other]) & (start[one] != end[one]) & (one // 3 != other // 3)
    pairs, one, other = pairs[opposite], one[opposite], other[opposite]
    # Where pairs overlap every other one counts, so that no half-edge has two twins.
    new_run = np.diff(pairs, prepend=-2) > 1
    position = np.arange(len(pairs))
    single = (position - np.maximum.accumulate(np.where(new_run, position, 0))) % 2 == 0
    twin = np.full(len(start), -1, np.int64)
    twin[one[single]] = other[single]
    twin[other[single]] = one[single]
    return twin


def _in_chunks(compute: Callable[..., Doubles], *columns: Longs) -> Doubles:
    """compute(*columns), a chunk of rows at a time."""
    parts = [compute(*(c[k : k + CHUNK] for c in columns)) for k in range(0, len(columns[0]), CHUNK)]
    return np.concatenate(parts) if parts else np.empty(0)


class Shapes:
    """Lengths and normals of triangles, and what joining some of them would gain.

    positions: float32 (V, 3). indices: int32 (T, 3). A half-edge is 3 * triangle + the corner that it begins at.
    """

    def __init__(self, positions: Floats, indices: Ints) -> None:
        self.positions = positions
        self.indices = indices
        count = len(indices)
        self.normal = np.zeros((count, 3), np.float32)
        self.lengths = np.zeros((count, 3), np.float32)
        self.rectangle = np.zeros(count, np.float32)
        self.longest_opposite = np.zeros(count, np.int8)
        for k in range(0, count, CHUNK):
            self._measure(slice(k, k + CHUNK))

    def _measure(self, rows: slice) -> None:
        p = self.positions[self.indices[rows]].astype(np.float64)
        sides = np.roll(p, -1, axis=1) - p  # side k from corner k to k + 1
        lengths = np.linalg.norm(sides, axis=2)
        longest = lengths.argmax(axis=1)
        normal = np.cross(sides[:, 0], sides[:, 1])
        size = np.linalg.norm(normal, axis=1, keepdims=True)
        self.normal[rows] = np.divide(normal, size, out=np.zeros_like(normal), where=size > 0)
        self.lengths[rows] = lengths
        self.longest_opposite[rows] = (longest + 2) % 3
        row = np.arange(len(p))
        self.rectangle[rows] = lengths[row, (longest + 1) % 3] * lengths[row, (longest + 2) % 3]

    def corner(self, half_edge: Longs, step: int) -> Doubles:
        """Positions, float64 (n, 3), of the corners `step` after the first ones of half-edges, int64 (n)."""
        return self.positions[self.indices[half_edge // 3, (half_edge % 3 + step) % 3]].astype(np.float64)

    def pair_gain(self, edge: Longs, twin: Longs) -> Doubles:
        """Atlas area that joining the triangles at `edge` saves: alone over together, times the fold's cosine.

        edge, twin: int64 (n), half-edges of the one and the other triangle. Returns float64 (n).
        """
        a, b = edge // 3, twin // 3
        alone = self.rectangle[a] + self.rectangle[b]
        return _ratio(alone, self._pair_area(edge, twin)) * self._fold(a, b)

    def fan_gain(self, right: Longs, left: Longs, single: Longs, twin: Longs) -> Doubles:
        """The same for a single triangle that joins a pair.

        right, left: int64 (n), half-edges of the centre. single: int64 (n), triangles. twin: int64 (3 T), of each
        half-edge the one of its neighbour, -1 for none.
        """
        apex, x, y = self.corner(right, 0), self.corner(right, 1), self.corner(right, 2)
        right_outer, left_outer = self.corner(twin[right], 2), self.corner(twin[left], 2)
        width = np.maximum(_length(x, y), _length(apex, right_outer) + _length(apex, left_outer))
        height = np.maximum(_length(right_outer, x), _length(left_outer, y))
        height = np.maximum(height, _length(apex, (x + y) / 2))
        centre, right_triangle, left_triangle = right // 3, twin[right] // 3, twin[left] // 3
        single_is_right = right_triangle == single
        inner = np.where(single_is_right, left, right)
        alone = self._pair_area(inner, twin[inner]) + self.rectangle[single]
        fold = np.minimum(self._fold(centre, right_triangle), self._fold(centre, left_triangle))
        return _ratio(alone, width * height) * fold

    def _pair_area(self, edge: Longs, twin: Longs) -> Floats:
        """Area of the rectangle of two triangles: the longer ones of the sides opposite to each other."""
        a, b, k, m = edge // 3, twin // 3, edge % 3, twin % 3
        width = np.maximum(self.lengths[a, (k + 2) % 3], self.lengths[b, (m + 2) % 3])
        height = np.maximum(self.lengths[a, (k + 1) % 3], self.lengths[b, (m + 1) % 3])
        return width * height

    def _fold(self, a: Longs, b: Longs) -> Floats:
        cosines: Floats = (self.normal[a] * self.normal[b]).sum(axis=1)
        return cosines


def _length(a: Doubles, b: Doubles) -> Doubles:
    lengths: Doubles = np.linalg.norm(a - b, axis=1)
    return lengths


def _ratio(a: NDArray[np.floating[Any]], b: NDArray[np.floating[Any]]) -> Doubles:
    """a / b, 0 where b is 0."""
    ratios: Doubles = np.divide(a, b, out=np.zeros(len(a)), where=b > 0)
    return ratios


def _with_members(indices: Ints, of_triangle: Ints, codes: Bytes) -> Patches:
    """The tables by patch that follow from each triangle's patch, role and rotation."""
    count = int(of_triangle.max()) + 1 if len(of_triangle) else 0
    members = np.full((count, 3), -1, np.int32)
    points = np.full((count, 5), -1, np.int32)
    role, rotation = (codes // 3).astype(np.int64), (codes % 3).astype(np.int64)
    triangles = np.arange(len(indices))
    members[of_triangle, ROLE_SLOT[role]] = triangles
    for corner in range(3):
        points[of_triangle, ROLE_POINTS[role, corner]] = indices[triangles, (rotation + corner) % 3]
    return Patches(of_triangle, codes, members, points)
