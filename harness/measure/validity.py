"""Does an atlas hold what a client looks up? Computed from the owners that a packer states, never by the packer.

A *lookup* is the bilinear interpolation at the position where the client looks up a surface point (`Client.locate`).
It touches those of the four texels around that position whose weight is above `WEIGHT`.

Rules:

placed        Every potentially visible triangle has a place (the client locates its corners) or is listed as unplaced
              with a reason; never both.
barycentrics  Samples name an existing triangle, and their barycentrics are finite. Weight i is at least
              -(1 + MARGIN / h_i), where h_i is the height of the triangle over edge i in the atlas, in texels and at
              least 1: no further outside than one height (the other half of a block) and MARGIN texels; or the sample
              is within 1 + MARGIN texels of where it, and a corner, the centre or a near point of its triangle, are
              looked up; or of a sample inside its triangle, it continues its neighbours, and its weights are at least
              -2 (1 + MARGIN), as low as two weights of a part of height 1 (a triangle in parts has no one height).
inside        Samples and lookups stay inside the atlas.
single owner  No texel is listed twice.
alpha         Alpha is 255 where a texel is listed and 0 elsewhere: nothing else was written.
finite        No NaN and no infinity in a plane.
once          Samples lie where their triangle is looked up. A triangle with more than STRAYS of its samples over
              DISTANCE texels away is placed a second time. Copies along a cut are none of these: they are looked up
              from the cut's other side, or continue samples that lie where they are looked up, from either side, to
              EXACT texels.
written       Every texel that a lookup inside the triangle touches is written.
surface       A lookup finds its own surface. Where all texels touched are the triangle's own, their interpolated
              barycentrics differ from the point looked up by at most LOCATION texels: of the affine map through the
              triangle's corners in the atlas or, where the map is another one (in perspective, in parts), by the
              differences from texel to texel. Where a texel has another owner, that owner's surface point is within
              REACH times the sum of both triangles' texel sizes.
gaps          A packer that declares it (`Packer.leaves_unwritten`) need not write all of them: texels with their centre
              over NEAR from the point looked up may be missing or another triangle's, and are counted (`Gaps`), or
              belong to another part of the same triangle, which shows by the four not being on one plane. All else
              holds for it too.

Of a method without an atlas only `placed` is checked here: see harness/measure/verification/lists.py.

Lookups are made at the corners and the centre of every placed triangle, at a grid over its area and twice as densely on
its edges, spaced by a texel (but for triangles over 64 texels long, by 1/64 of their longest edge), and at the points
that the novel view sees. A budget bounds each of these, and the samples of `once`, per frame: triangles and points take
turns by frame index, so that every one is examined within a few frames.

Kernels (kernels/validity/) go over all samples, texels and lookups, and mark what could break a rule. What they mark,
in a valid frame next to nothing, is judged here, in float64 and by NumPy alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from shading_atlas_bench.arithmetic.arrays import Bools, Doubles, Floats, Ints, Longs
from shading_atlas_bench.arithmetic.functions import log2
from shading_atlas_bench.kernels.validity.lookups import BORDER, Limits, Lookups, LookupScreen, TriangleTable
from shading_atlas_bench.kernels.validity.samples import (
    NO_SAMPLE,
    SampleList,
    place_samples,
    sample_plane_twin,
)
from shading_atlas_bench.kernels.validity.texels import compare_alpha, compare_alpha_twin
from shading_atlas_bench.packers.interface import Client, Frame, Owners, Payload

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device

WEIGHT = 1 / 512  # a texel of less weight changes a value by less than half of an 8-bit step
MARGIN = 2.0  # texels that barycentrics may lie outside: a lookup reaches at most sqrt(2) from an edge
EXACT = 0.1  # texels
DISTANCE = 1.0  # texels between a sample and where its surface point is looked up
STRAYS = 1 / 3
PART = 0.2  # texels: a step on the surface as long as so much of the way to the next texel, whatever a part's size
# Steps from a point to its six sides, in barycentrics 1 and 2: between the directions of edges, along which cuts run.
SIDES = 1e-4 * np.array([[2, -1], [-2, 1], [-1, 2], [1, -2], [-1, -1], [1, 1]], np.float32)
# Texels; exact maps give 0, the cells on the diagonals of L-packing up to 1/4 (their samples are no parallelogram), a
# client that forgets the half-texel offset 1/2.
LOCATION = 1 / 3
REACH = 3.0
NEAR = 0.49  # texels: whoever writes all texels within half a texel of a triangle writes these, rounding aside
BUDGET = 100_000  # per frame and kind: points of corners, of grids, of the novel view; samples of `once`
CHUNK, JUDGED = 1 << 17, 1 << 15  # points at a time, and of those marked, for the sake of memory
FINEST = 6  # grids have up to 2^6 steps along an edge
FIRST = 8  # offenders named per violation
SIDEWAYS = np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])  # columns and rows to the four texels beside one
STAGE = "check"
ANCHORS = np.array([[0, 0], [1, 0], [0, 1], [1 / 3, 1 / 3]], np.float32)  # corners and centre

Whole: TypeAlias = NDArray[np.integer[Any]]  # whole numbers of any width
Located: TypeAlias = tuple[Ints, Floats, Doubles]  # triangles (n), barycentrics (n, 2), atlas positions (n, 2)


@dataclass(frozen=True)
class Violation:
    """A rule that does not hold: how often, a sentence for people, and the first offenders.

    triangles: scene ids. texels: row * width + column.
    """

    rule: str
    count: int
    sentence: str
    triangles: tuple[int, ...] = ()
    texels: tuple[int, ...] = ()


@dataclass
class Gaps:
    """Of a packer that leaves texels unwritten: how many texels lookups touched, and how many of them are missing."""

    touched: int = 0
    missing: int = 0

    def count(self, touched: int, missing: int) -> None:
        """Add those of some lookups."""
        self.touched += touched
        self.missing += missing

    @property
    def share(self) -> float | None:
        """Missing over touched."""
        return self.missing / self.touched if self.touched else None


def check(
    frame: Frame,
    payload: Payload,
    owners: Owners | None,
    client: Client,
    visible: Located | None = None,
    *,
    budget: int | None = BUDGET,
    gaps: Gaps | None = None,
) -> list[Violation]:
    """Check every rule on one frame; an empty list if all hold.

    client: has received this payload. owners: None for a method without an atlas, of which only the list of unplaced
        triangles is checked.
    visible: int32 (n) triangles and float32 (n, 2) barycentrics that the novel view sees, and what the client's
        `locate` says of them; those of triangles without a place are passed over (they count as missing elsewhere).
    budget: None examines every triangle and every sample.
    gaps: given for a packer that declares to leave texels unwritten, whose share is counted here.
    """
    if owners is None or not payload.planes:
        return _check_unplaced(frame, payload, None)
    found = _check_ids(frame, owners)
    if found:
        return found  # nothing else can be computed with wrong ids
    turns = _turns(len(owners.triangle), budget)
    has_turn = np.zeros(frame.scene.triangles.count, bool)
    has_turn[frame.index % turns :: turns] = True
    atlas = _Atlas(frame.scene.device, owners, next(iter(payload.planes.values())), has_turn)
    found = [*atlas.violations(), *_check_planes(payload.planes, atlas)]
    anchors = client.locate(np.repeat(frame.pvs, len(ANCHORS)), np.tile(ANCHORS, (len(frame.pvs), 1)))
    if anchors is None:
        return [*found, *_check_unplaced(frame, payload, np.isin(frame.pvs, owners.triangle))]
    table = _Table(frame, anchors.reshape(-1, len(ANCHORS), 2))
    found += _check_unplaced(frame, payload, table.placed)
    found += _check_barycentrics(owners, _outside(owners, atlas, table), atlas, client)
    found += _check_once(owners, atlas, client)
    lookups = _Lookups(frame, atlas, table, gaps)
    for some in _points(frame, table, client, visible, budget):
        lookups.look_up(some)
    return [*found, *lookups.violations()]


def _check_ids(frame: Frame, owners: Owners) -> list[Violation]:
    count = frame.scene.triangles.count
    if owners.triangle.min(initial=0) >= 0 and owners.triangle.max(initial=0) < count:
        return []
    bad = np.flatnonzero((owners.triangle < 0) | (owners.triangle >= count))
    sentence = f"{bad.size} samples name a triangle that the scene of {count} triangles does not have."
    return [
        Violation("barycentrics", bad.size, sentence, first_few(owners.triangle[bad]), first_few(owners.texel[bad]))
    ]


def _check_unplaced(frame: Frame, payload: Payload, placed: Bools | None) -> list[Violation]:
    """placed: by place in the PVS; None if the method places nothing in an atlas."""
    listed = np.fromiter(payload.unplaced, np.int64, len(payload.unplaced))
    silent = np.array([triangle for triangle, reason in payload.unplaced.items() if not reason], np.int64)
    foreign = listed[~np.isin(listed, frame.pvs)]
    cases: list[tuple[Whole, str]] = [
        (silent, "are listed as unplaced without a reason"),
        (foreign, "are listed as unplaced and are not potentially visible"),
    ]
    if placed is not None:
        excused = np.isin(frame.pvs, listed)
        cases += [
            (frame.pvs[~placed & ~excused], "of the potentially visible set have no place and are not listed"),
            (frame.pvs[placed & excused], "are listed as unplaced and have a place"),
        ]
    return [
        Violation("placed", len(bad), f"{len(bad)} triangles {what}.", first_few(np.sort(bad)))
        for bad, what in cases
        if len(bad)
    ]


class _Atlas:
    """Which sample lies in each texel; of two in one texel the last counts.

    listed: samples, on the device. plane: int32 (height, width), on the device, their numbers, NO_SAMPLE without one.
    wrong_alpha: how many texels have an alpha that says otherwise. is_single: whether no texel is listed twice.
    chosen: int (k), numbers of the samples inside a triangle that has its turn. far: of those with a weight below -1 or
    not a number.
    """

    def __init__(self, device: Device, owners: Owners, texels: Array, has_turn: Bools) -> None:
        """texels: the first plane. has_turn: bool (T), by triangle."""
        self.height, self.width = texels.shape[:2]
        self.owners, self.texels = owners, texels
        self.listed = SampleList.lent(device, owners.texel, owners.triangle, owners.bary)
        placed = place_samples(device, self.listed, self.width, self.height, has_turn, STAGE)
        self.plane, self.outside = placed.plane, placed.outside
        owned, self.wrong_alpha = _compare_alpha(device, texels, self.plane)
        self.is_single = owned == len(owners.texel) - self.outside
        if not self.is_single:  # which of two a kernel writes last nobody knows
            self.plane.set(sample_plane_twin(owners.texel, self.width, self.height))
        count = len(owners.texel)
        self.chosen = np.flatnonzero(placed.chosen.get()[:count].view(bool))
        self.far = np.flatnonzero(placed.far.get()[:count].view(bool)) if placed.distant else np.empty(0, np.int64)

    @cached_property
    def samples(self) -> Ints:
        """The plane on the host, (height, width)."""
        samples: Ints = self.plane.get()
        return samples

    def sample_at(self, column: Whole, row: Whole) -> Ints:
        """The samples in texels of any shape: NO_SAMPLE where there is none, BORDER outside the atlas."""
        inside = (column >= 0) & (column < self.width) & (row >= 0) & (row < self.height)
        found = self.samples[np.where(inside, row, 0), np.where(inside, column, 0)]
        return np.where(inside, found, np.int32(BORDER))

    def triangle_of(self, sample: Ints) -> Ints:
        """Triangles of samples of any shape; NO_SAMPLE and BORDER stay what they are."""
        if not len(self.owners.triangle):
            return sample
        return np.where(sample < 0, sample, self.owners.triangle[np.maximum(sample, 0)])

    def bary_of(self, sample: Ints) -> Floats:
        """Barycentrics of samples, float32 (2, ...); zeros where there is none."""
        if not len(self.owners.bary):
            return np.zeros((2, *sample.shape), np.float32)
        bary = self.owners.bary[np.maximum(sample, 0)]
        bary[sample < 0] = 0
        return np.moveaxis(bary, -1, 0)

    def beside(self, texel: Longs, triangle: Ints, others: Longs) -> Bools:
        """Whether one of the four texels next to each texel (n) is among `others` and has the same owner: bool (n)."""
        among = np.zeros(self.width * self.height, bool)
        among[others[self._contains(others)]] = True
        found = np.zeros(len(texel), bool)
        kept = self._contains(texel)
        column, row = self._position(texel[kept])
        for across, down in SIDEWAYS:
            owned = self.triangle_of(self.sample_at(column + across, row + down)) == triangle[kept]
            beside = (row + down) * self.width + column + across
            found[kept] |= owned & among[np.where(owned, beside, 0)]
        return found

    def towards_neighbours(self, triangle: Ints, bary: Floats, texel: Longs) -> Iterator[tuple[Floats, Doubles]]:
        """Surface points a little off samples (n), between the directions to two neighbours of the same triangle, and
        where they should be looked up: float32 (n, 2) and float64 (n, 2), for each of eight directions."""
        if not len(texel):
            return
        # What lies outside breaks another rule.
        column, row = self._position(np.clip(texel, 0, self.width * self.height - 1))
        centre = self.centre(texel)
        for across, down in np.array([[2, 1], [1, 2], [-2, 1], [-1, 2], [2, -1], [1, -2], [-2, -1], [-1, -2]]):
            moved = bary.astype(np.float64)
            for step, count in (((np.sign(across), 0), abs(across)), ((0, np.sign(down)), abs(down))):
                beside = self.sample_at(column + step[0], row + step[1])
                own = self.triangle_of(beside) == triangle
                moved += np.where(own, count * PART * (self.bary_of(beside) - bary.T), 0).T
            yield moved.astype(np.float32), centre + PART * np.array([across, down])

    def near_inside(self, texel: Longs, triangle: Ints) -> Bools:
        """Whether a sample inside the triangle is within 1 + MARGIN texels of each texel (n): bool (n)."""
        (column, row), reach = self._position(texel), int(1 + MARGIN)
        found = np.zeros(len(texel), bool)
        for step in np.ndindex(2 * reach + 1, 2 * reach + 1):
            line = np.clip(row + step[0] - reach, 0, self.height - 1)
            beside = self.sample_at(np.clip(column + step[1] - reach, 0, self.width - 1), line)
            bary = self.bary_of(beside)
            inside = (bary.min(axis=0) >= -1e-4) & (bary.sum(axis=0) <= 1 + 1e-4)
            found |= inside & (self.triangle_of(beside) == triangle)
        return found

    def is_smooth(self, texel: Longs, triangle: Ints) -> Bools:
        """Whether each texel (n) continues three neighbours of its triangle, in a row or a square, as a plane does, to
        half of their differences: bool (n)."""
        at = np.stack(self._position(texel))[:, None]
        own = self.bary_of(self.sample_at(*at[:, 0]))
        smooth = np.zeros(len(texel), bool)
        for one, other in [(a, b) for a in SIDEWAYS for b in SIDEWAYS if (a != -b).any()]:
            three = self.sample_at(*at + np.stack([one, other, one + other], axis=1)[..., None])
            a, b, c = np.moveaxis(self.bary_of(three), 1, 0)
            off = np.abs(own - (a + b - c)).sum(axis=0)
            step = np.maximum(np.abs(a - c).sum(axis=0), np.abs(b - c).sum(axis=0))
            smooth |= (self.triangle_of(three) == triangle).all(axis=0) & (off <= step / 2)
        return smooth

    def centre(self, texel: Longs) -> Doubles:
        """Column and row of texels' centres, float64 (n, 2)."""
        return np.stack(self._position(texel), axis=1, dtype=np.float64) + 0.5

    def _contains(self, texel: Longs) -> Bools:
        return (texel >= 0) & (texel < self.width * self.height)

    def _position(self, texel: Longs) -> tuple[Longs, Longs]:
        """Columns and rows."""
        row = texel // self.width
        return texel - row * self.width, row

    def violations(self) -> list[Violation]:
        """Of the rules `inside` and `single owner`."""
        texel, triangle = self.owners.texel, self.owners.triangle
        found = []
        if self.outside:
            out = np.flatnonzero(~self._contains(texel))
            sentence = f"{out.size} samples lie outside the atlas of {self.width} x {self.height} texels."
            found.append(Violation("inside", out.size, sentence, first_few(triangle[out]), first_few(texel[out])))
        if not self.is_single:
            values, counts = np.unique(texel[self._contains(texel)], return_counts=True)
            twice = values[counts > 1]
            culprits = triangle[np.isin(texel, twice[:FIRST])]
            sentence = f"{twice.size} texels are listed more than once."
            found.append(
                Violation("single owner", twice.size, sentence, first_few(np.unique(culprits)), first_few(twice))
            )
        return found


def _compare_alpha(device: Device, texels: Array, plane: Array) -> tuple[int, int]:
    """As the kernel, of any numbers."""
    if texels.dtype == np.uint8:
        return compare_alpha(device, texels, plane, STAGE)
    return compare_alpha_twin(texels.get(), plane.get())


def _check_planes(planes: Mapping[str, Array], atlas: _Atlas) -> list[Violation]:
    found = []
    for name, plane in planes.items():
        values = plane.get() if plane.dtype.kind == "f" else None
        if values is not None and not np.isfinite(values).all():
            bad = np.flatnonzero(~np.isfinite(values).all(axis=-1))
            sentence = f"{bad.size} texels of the plane {name!r} are not finite."
            found.append(Violation("finite", bad.size, sentence, texels=first_few(bad)))
        if atlas.wrong_alpha and plane is atlas.texels:
            wrong = np.flatnonzero(plane.get()[..., 3] != (atlas.samples >= 0) * np.uint8(255))
            sentence = f"{wrong.size} texels have an alpha that is not 255 where they are listed, or not 0 elsewhere."
            found.append(Violation("alpha", wrong.size, sentence, texels=first_few(wrong)))
    return found


class _Table:
    """What the lookups need of each triangle of the PVS, by its place in the PVS (its row)."""

    def __init__(self, frame: Frame, anchors: Doubles) -> None:
        self.pvs = frame.pvs
        self.anchors = anchors
        finite = np.isfinite(anchors.reshape(-1, 2 * len(ANCHORS)))
        self.placed: Bools = np.logical_and.reduce(finite.T, axis=0)
        self.row = np.full(frame.scene.triangles.count, -1, np.int32)
        self.row[frame.pvs] = np.arange(len(frame.pvs), dtype=np.int32)
        corners = anchors[:, :3]
        # (2, n, 2): column and row of the atlas, triangle, and the barycentrics 1 and 2 they change with, in texels
        self.jacobian = np.ascontiguousarray((corners[:, 1:] - corners[:, :1]).transpose(2, 0, 1))
        self._frame = frame

    @cached_property
    def points(self) -> Doubles:
        """Those of the PVS."""
        return self.corners(self.pvs)

    def corners(self, triangles: Ints) -> Doubles:
        """Positions float64 (n, 3, 3)."""
        scene = self._frame.scene.host
        return scene.positions[scene.indices[triangles]].astype(np.float64)

    @cached_property
    def edges(self) -> Doubles:
        """Lengths in the atlas, in texels, of the edges opposite corners 0, 1 and 2: float64 (n, 3)."""
        corners = self.anchors[:, :3]
        lengths: Doubles = np.linalg.norm(corners[:, [2, 0, 1]] - corners[:, [1, 2, 0]], axis=2)
        return lengths

    def heights(self, rows: Ints) -> Doubles:
        """Heights in the atlas over the edges opposite corners 0, 1 and 2, in texels: float64 (n, 3)."""
        area = np.abs(self.determinant[rows])
        return area[:, None] / np.maximum(self.edges[rows], 1e-9)

    @cached_property
    def determinant(self) -> Doubles:
        """Twice the signed area in the atlas, in texels: float64 (n)."""
        column, row = self.jacobian
        area: Doubles = column[:, 0] * row[:, 1] - column[:, 1] * row[:, 0]
        return area

    @cached_property
    def texel_size(self) -> Doubles:
        """Longest extent on the surface of one texel, in scene units, at most the longest edge: float64 (n).

        The largest singular value of the map from the atlas to the surface (edges times the inverse Jacobian).
        """
        p = np.ascontiguousarray(self.points.transpose(1, 2, 0))  # NumPy is slow over axes of three
        with np.errstate(all="ignore"):
            longest = np.sqrt(np.max([_dot(edge, edge) for edge in (p[2] - p[1], p[0] - p[2], p[1] - p[0])], axis=0))
            (column1, column2), (row1, row2) = self.jacobian.transpose(0, 2, 1).copy()
            first, second = p[1] - p[0], p[2] - p[0]
            along_column = (first * row2 - second * row1) / self.determinant
            along_row = (second * column1 - first * column2) / self.determinant
            a, b, c = _dot(along_column, along_column), _dot(along_column, along_row), _dot(along_row, along_row)
            size = np.sqrt((a + c + np.sqrt((a - c) * (a - c) + 4 * b * b)) / 2)
        at_most: Doubles = np.fmin(size, longest)  # fmin: a triangle without area in the atlas gives NaN
        return at_most


def _outside(owners: Owners, atlas: _Atlas, table: _Table) -> Longs:
    """Samples whose barycentrics are not finite or lie too far outside their triangle, as one of one height."""
    bad = atlas.far  # -1 is allowed to all
    b1, b2 = owners.bary[bad].T
    rows = table.row[owners.triangle[bad]]
    weights = np.stack([1 - b1 - b2, b1, b2])
    heights, known = np.ones(weights.shape), rows >= 0
    heights[:, known] = table.heights(rows[known]).T
    allowed = weights >= -(1 + MARGIN / np.fmax(heights, 1))
    outside: Longs = bad[~(allowed & np.isfinite(weights)).all(axis=0)]
    return outside


def _check_barycentrics(owners: Owners, outside: Longs, atlas: _Atlas, client: Client) -> list[Violation]:
    if not outside.size:
        return []
    centre = atlas.centre(owners.texel[outside])
    outside = outside[~_close_by(owners.triangle[outside], owners.bary[outside], centre, client)]
    bad = outside[~_continues(owners.triangle[outside], owners.bary[outside], owners.texel[outside], atlas)]
    if not bad.size:
        return []
    sentence = f"{bad.size} samples have barycentrics that are not finite or lie too far outside their triangle."
    return [
        Violation("barycentrics", bad.size, sentence, first_few(owners.triangle[bad]), first_few(owners.texel[bad]))
    ]


def _close_by(triangle: Ints, bary: Floats, centre: Doubles, client: Client) -> Bools:
    """Whether samples (n) lie within 1 + MARGIN texels of where they, and a point inside their triangle, are looked up.

    A triangle in parts has no one height in the atlas: a texel beside a small part of it may be far outside.
    """
    close: Bools = np.all(np.isfinite(bary), axis=1)
    if not close.any():
        return close
    own = bary[close].astype(np.float64)[:, None]
    weights = np.maximum(np.concatenate([1 - own.sum(axis=2, keepdims=True), own], axis=2), 0)
    clamped = (weights / weights.sum(axis=2, keepdims=True))[..., 1:]
    points = np.concatenate([own, clamped, np.broadcast_to(ANCHORS, (len(own), *ANCHORS.shape))], axis=1)
    count = points.shape[1]
    places = _locate(client, np.repeat(triangle[close], count), points.reshape(-1, 2).astype(np.float32))
    near = np.abs(places.reshape(-1, count, 2) - centre[close][:, None]).max(axis=2) <= 1 + MARGIN
    close[close] = near[:, 0] & near[:, 1:].any(axis=1)
    return close


def _continues(triangle: Ints, bary: Floats, texel: Longs, atlas: _Atlas) -> Bools:
    """Whether samples (n) continue a low part of their triangle: near a sample inside it, and not far outside."""
    weights = np.stack([1 - bary.sum(axis=1), *bary.T])
    low = (weights >= -2 * (1 + MARGIN)).all(axis=0)
    return low & atlas.near_inside(texel, triangle) & atlas.is_smooth(texel, triangle)


def _locate(client: Client, triangles: Ints, bary: Floats) -> Doubles:
    """Where a client looks points up that said so of the corners."""
    located = client.locate(triangles, bary)
    if located is None:
        raise TypeError("The client's `locate` gives positions of some points, and None for others.")
    return located


def _check_once(owners: Owners, atlas: _Atlas, client: Client) -> list[Violation]:
    chosen = atlas.chosen
    triangle, bary, texel = owners.triangle.take(chosen), owners.bary.take(chosen, 0), owners.texel.take(chosen)
    centre = atlas.centre(texel)
    distance = _apart(_locate(client, triangle, bary), centre)
    strays = np.flatnonzero(distance > DISTANCE)  # not where a triangle has no place
    count = np.bincount(triangle)
    for side in SIDES:
        strays = _suspects(strays, triangle, count, atlas)
        if not strays.size:
            return []
        beside = _locate(client, triangle[strays], bary[strays] + side)
        distance[strays] = np.fmin(distance[strays], _apart(beside, centre[strays]))
        strays = strays[distance[strays] > DISTANCE]
    strays = _suspects(strays, triangle, count, atlas)
    for point, at in atlas.towards_neighbours(triangle[strays], bary[strays], texel[strays]):
        beside = _locate(client, triangle[strays], point)
        distance[strays] = np.fmin(distance[strays], _apart(beside, at))
    strays = strays[distance[strays] > DISTANCE]
    strays = strays[~atlas.beside(texel[strays], triangle[strays], texel[distance <= EXACT])]
    twice = np.flatnonzero(np.bincount(triangle[strays], minlength=len(count)) > STRAYS * count)
    if not twice.size:
        return []
    texels = texel[strays[np.isin(triangle[strays], twice)]]
    sentence = f"{twice.size} triangles have samples over {DISTANCE:g} texel from where a client looks them up."
    return [Violation("once", twice.size, sentence, first_few(twice), first_few(texels))]


def _suspects(strays: Longs, triangle: Ints, count: Longs, atlas: _Atlas) -> Longs:
    """Strays (k) without those of triangles that have too few to be placed a second time, as what finds more samples
    where they are looked up only takes strays away. triangle: of all samples. count: of each triangle."""
    if not atlas.is_single:  # samples of another triangle in the same texel count as well
        return strays
    many = np.bincount(triangle[strays], minlength=len(count)) > STRAYS * count
    return strays[many[triangle[strays]]]


def _points(
    frame: Frame, table: _Table, client: Client, visible: Located | None, budget: int | None
) -> Iterator[Lookups]:
    """All lookups, a chunk at a time."""
    rows = np.flatnonzero(table.placed)
    anchors = len(ANCHORS)
    turns = _turns(anchors * len(rows), budget)
    chosen = rows[frame.index % turns :: turns]
    for start in range(0, len(chosen), CHUNK // anchors):
        part = chosen[start : start + CHUNK // anchors]
        triangles, bary = np.repeat(table.pvs[part], anchors), np.tile(ANCHORS, (len(part), 1))
        yield Lookups(triangles, bary, table.anchors[part].reshape(-1, 2))
    for triangles, bary in _grids(frame, table, rows, budget):
        yield Lookups(triangles, bary, _locate(client, triangles, bary))
    if visible is None:
        return
    triangles, bary, located = visible
    turns = _turns(len(triangles), budget)
    for start in range(frame.index % turns, len(triangles), turns * CHUNK):
        some = slice(start, start + turns * CHUNK, turns)
        yield Lookups(triangles[some], bary[some], located[some], only_known=True)


def _grids(frame: Frame, table: _Table, rows: Whole, budget: int | None) -> Iterator[tuple[Ints, Floats]]:
    """Triangles and barycentrics of the grids of as many triangles as the budget allows in this frame."""
    longest = np.maximum(table.edges[rows].max(axis=1, initial=1), 1)
    level = np.minimum(np.ceil(log2(longest)), FINEST).astype(np.int64)
    patterns = [_pattern(1 << step) for step in range(FINEST + 1)]
    if budget is not None:
        spent = np.cumsum(np.array([len(pattern) for pattern in patterns])[level])
        turn = spent // budget
        chosen = turn == frame.index % (turn[-1] + 1 if turn.size else 1)
        rows, level = rows[chosen], level[chosen]
    for step, pattern in enumerate(patterns):
        triangles = table.pvs[rows[level == step]]
        several = max(1, CHUNK // len(pattern))
        for start in range(0, len(triangles), several):
            part = triangles[start : start + several]
            yield np.repeat(part, len(pattern)), np.tile(pattern, (len(part), 1))


def _pattern(steps: int) -> Floats:
    """Barycentrics of a grid of `steps` along each edge, and of 2 * `steps` on the edges; float32 (n, 2).

    The corners are left out, because they are looked up for every triangle.
    """
    i, j = np.meshgrid(np.arange(1, steps), np.arange(1, steps), indexing="ij")
    grid = np.stack([i, j], axis=-1)[i + j < steps] / steps
    t = np.arange(1, 2 * steps) / (2 * steps)
    edges = [np.stack(pair, axis=1) for pair in ((t, 0 * t), (0 * t, t), (t, 1 - t))]
    return np.concatenate([grid, *edges]).astype(np.float32)


class _Lookups:
    """The rules `inside`, `written` and `surface`, over any number of lookups."""

    def __init__(self, frame: Frame, atlas: _Atlas, table: _Table, gaps: Gaps | None) -> None:
        self._atlas, self._table, self._gaps = atlas, table, gaps
        near = None if gaps is None else NEAR
        triangles = TriangleTable(table.row, table.jacobian, table.texel_size, table.points)
        limits = Limits(WEIGHT, near, LOCATION, REACH)
        self._screen = LookupScreen(frame.scene.device, atlas.listed, atlas.plane, triangles, limits, STAGE)
        self._outside = np.zeros(len(frame.pvs), bool)  # triangles, by row
        self._misplaced = np.zeros(len(frame.pvs), bool)
        self._incomplete = np.zeros(len(frame.pvs), bool)
        self._unwritten: list[Whole] = []  # texels

    def look_up(self, lookups: Lookups) -> None:
        """Look up some points."""
        screened = self._screen.screen(lookups)
        if self._gaps:
            self._gaps.count(screened.touched, screened.missing)
        for start in range(0, len(screened.marked), JUDGED):
            some = screened.marked[start : start + JUDGED]
            self._examine(lookups.triangle[some], lookups.bary[some], lookups.place[some])

    @np.errstate(invalid="ignore")  # barycentrics may hold infinities, which another rule reports
    def _examine(self, triangles: Ints, bary: Floats, located: Doubles) -> None:
        """Judge n of them: int32 (n), float32 (n, 2), and where the client looks them up, float64 (n, 2)."""
        atlas = self._atlas
        rows = self._table.row[triangles]
        x = np.clip(located[:, 0] + 0.5, 0, atlas.width + 0.999)  # from centre to centre, from those of the border on
        y = np.clip(located[:, 1] + 0.5, 0, atlas.height + 0.999)
        column, line = x.astype(np.int32), y.astype(np.int32)
        x -= column
        y -= line
        column, line = column + np.array([[-1], [0], [-1], [0]]), line + np.array([[-1], [-1], [0], [0]])
        weights = np.stack([(1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y])
        touched = weights > WEIGHT
        weights *= touched
        samples = atlas.sample_at(column, line)
        owner = atlas.triangle_of(samples)
        own = (owner == triangles) | ~touched
        whole = own.all(axis=0)
        if self._gaps:
            excused = ~own & (owner != BORDER) & _far(x, y)
            touched, own = touched & ~excused, own | excused
        if owner.min() < 0:
            self._note_gaps(rows, line * atlas.width + column, owner, touched)
        self._check_location(rows, bary, samples, weights, whole)
        if not own.all():
            self._check_others(rows, bary, samples, ~own & (owner >= 0))

    def _note_gaps(self, rows: Ints, texels: Ints, owner: Ints, touched: Bools) -> None:
        self._outside[rows[(touched & (owner == BORDER)).any(axis=0)]] = True
        gaps = touched & (owner == NO_SAMPLE)
        self._incomplete[rows[gaps.any(axis=0)]] = True
        self._unwritten.append(np.unique(texels[gaps]))

    def _check_location(self, rows: Ints, bary: Floats, samples: Ints, weights: Doubles, whole: Bools) -> None:
        """Lookups whose texels are all the triangle's own: interpolated against true barycentrics, in texels."""
        total = weights.sum(axis=0)
        off1, off2 = (
            (weights * of).sum(axis=0) / total - bary[:, i] for i, of in enumerate(self._atlas.bary_of(samples))
        )
        to_column, to_row = self._table.jacobian[:, rows]
        column, row = to_column[:, 0] * off1 + to_column[:, 1] * off2, to_row[:, 0] * off1 + to_row[:, 1] * off2
        bad = np.flatnonzero(whole & ~(np.maximum(np.abs(column), np.abs(row)) <= LOCATION))
        if bad.size:
            off = np.stack([off1[bad], off2[bad]], axis=1)
            ignored = ~(weights[:, bad] > 0).all(axis=0) & (np.abs(off).max(axis=1) <= 2 * WEIGHT)  # too light to touch
            ignored |= self._torn(samples[:, bad]) if self._gaps else False
            bad, off = bad[~ignored], off[~ignored]
            touched = weights[:, bad] > 0
            own = self._atlas.triangle_of(samples[:, bad]) == self._table.pvs[rows[bad]]
            touched |= own & (touched.sum(axis=0) == 1)  # one alone shows no step, its neighbours do
            steps = self._steps(samples[:, bad], touched)
            self._misplaced[rows[bad[~(_distance(off, steps) <= LOCATION)]]] = True

    def _torn(self, samples: Ints) -> Bools:
        """Whether the four samples (4, n) around a lookup are of several parts of a triangle: bool (n)."""
        bary = self._atlas.bary_of(samples)
        twist = np.abs(bary[:, 0] - bary[:, 1] - bary[:, 2] + bary[:, 3])  # 0 on one plane, gentle in perspective
        torn: Bools = np.any(twist > np.ptp(bary, axis=1) / 2, axis=0)
        return torn

    def _steps(self, samples: Ints, touched: Bools) -> Doubles:
        """Changes of both barycentrics from a texel to the next column and to the next row: float64 (n, 2, 2).

        The larger of those between the four samples (4, n) around a lookup that it touches, because one may be a copy
        of another. A direction without is taken to be at right angles to the other one, and as long.
        """
        steps = np.empty((samples.shape[1], 2, 2))
        for axis, pairs in enumerate([((0, 1), (2, 3)), ((0, 2), (1, 3))]):
            one, other = (
                np.where(touched[i] & touched[j], np.diff(self._atlas.bary_of(samples[[i, j]]), axis=1)[:, 0], 0).T
                for i, j in pairs
            )
            larger = np.abs(one).sum(axis=1) >= np.abs(other).sum(axis=1)
            steps[:, :, axis] = np.where(larger[:, None], one, other)
        for axis in (0, 1):
            alone = (steps[:, :, axis] == 0).all(axis=1)
            steps[alone, :, axis] = steps[alone, :, 1 - axis][:, ::-1] * [-1, 1]
        return steps

    def _check_others(self, rows: Ints, bary: Floats, samples: Ints, other: Bools) -> None:
        """Samples of other owners, `other` (4, n): the distance between their surface point and the one looked up."""
        table = self._table
        corner, point = np.nonzero(other)
        sample, row = samples[corner, point], rows[point]
        triangle = self._atlas.triangle_of(sample)
        there = _surface_points(table.corners(triangle), self._atlas.bary_of(sample).T)
        here = _surface_points(table.corners(table.pvs[row]), bary[point])
        other_row = table.row[triangle]
        size = np.where(other_row >= 0, table.texel_size[other_row], table.texel_size[row])
        allowed = REACH * (table.texel_size[row] + size)
        self._misplaced[row[~(np.linalg.norm(there - here, axis=1) <= allowed)]] = True

    def violations(self) -> list[Violation]:
        """What broke a rule so far."""
        found = []
        outside, incomplete, misplaced = (
            self._table.pvs[flags] for flags in (self._outside, self._incomplete, self._misplaced)
        )
        if outside.size:
            sentence = f"Lookups in {outside.size} triangles touch texels outside the atlas."
            found.append(Violation("inside", outside.size, sentence, first_few(outside)))
        if incomplete.size:
            unwritten = np.unique(np.concatenate(self._unwritten))
            count = unwritten.size
            sentence = f"Lookups in {incomplete.size} triangles touch {count} texels that were not written."
            found.append(Violation("written", count, sentence, first_few(incomplete), first_few(unwritten)))
        if misplaced.size:
            sentence = f"Lookups in {misplaced.size} triangles find another surface, or another point of their own."
            found.append(Violation("surface", misplaced.size, sentence, first_few(misplaced)))
        return found


def _dot(one: Doubles, other: Doubles) -> Doubles:
    """Of vectors (3, n): (n)."""
    product: Doubles = one[0] * other[0] + one[1] * other[1] + one[2] * other[2]
    return product


def _apart(one: Doubles, other: Doubles) -> Doubles:
    """Texels between positions (n, 2), in the direction where it is more: (n)."""
    column, row = np.abs(one - other).T  # NumPy's reductions are slow over axes of two
    apart: Doubles = np.maximum(column, row)
    return apart


def _far(x: Doubles, y: Doubles) -> Bools:
    """Whether each of the four texels around a lookup is more than NEAR away, by its place (n) between their centres:
    bool (4, n)."""
    across, down = np.stack([x, 1 - x] * 2), np.stack([y, y, 1 - y, 1 - y])
    far: Bools = across * across + down * down > NEAR * NEAR
    return far


def _distance(off: Doubles, steps: Doubles) -> Doubles:
    """Texels, in the worse direction, that make up barycentrics `off` (n, 2) at `steps` (n, 2, 2) per texel."""
    determinant = steps[:, 0, 0] * steps[:, 1, 1] - steps[:, 0, 1] * steps[:, 1, 0]
    column = off[:, 0] * steps[:, 1, 1] - off[:, 1] * steps[:, 0, 1]
    row = off[:, 1] * steps[:, 0, 0] - off[:, 0] * steps[:, 1, 0]
    with np.errstate(all="ignore"):
        return np.maximum(np.abs(column), np.abs(row)) / np.abs(determinant)


def _surface_points(corners: Doubles, bary: Floats) -> Doubles:
    """corners (n, 3, 3) and barycentrics (n, 2) to points float64 (n, 3)."""
    b1, b2 = bary[:, 0, None].astype(np.float64), bary[:, 1, None].astype(np.float64)
    return corners[:, 0] + b1 * (corners[:, 1] - corners[:, 0]) + b2 * (corners[:, 2] - corners[:, 0])


def _turns(count: int, budget: int | None) -> int:
    """In how many frames `count` things have their turn."""
    return 1 if budget is None else max(1, -(-count // budget))


def first_few(values: Whole) -> tuple[int, ...]:
    """The offenders that a `Violation` names, of all, int (n)."""
    return tuple(int(value) for value in values[:FIRST])
