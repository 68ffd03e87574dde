"""Which lookups in an atlas could break a rule of harness/measure/validity.py: the others, nearly all, need no look."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic import arrays
from shading_atlas_bench.arithmetic.arrays import Bools, Doubles, Floats, Ints, Longs
from shading_atlas_bench.kernels.validity.samples import SampleList

if TYPE_CHECKING:
    from numpy.typing import DTypeLike
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device

RUN = 16  # lookups per item
BORDER = -2  # the owner of what lies around an atlas; that of texels without a sample is NO_SAMPLE


@dataclass(frozen=True)
class Limits:
    """weight: above which a texel is touched. near: texels from the point looked up, beyond which a texel may be
    missing; None if none may. location: texels that a point may be found off. reach: texel sizes that a point may be
    off on the surface."""

    weight: float
    near: float | None
    location: float
    reach: float


@dataclass(frozen=True)
class TriangleTable:
    """What lookups need of triangles, in rows; on the host.

    row: int32 (T), of each triangle of the scene, -1 for one without. jacobian: float64 (2, rows, 2), column and row in
    the atlas, and the barycentrics 1 and 2 that they change with, in texels. texel_size: float64 (rows), scene units.
    corners: float64 (rows, 3, 3), positions.
    """

    row: Ints
    jacobian: Doubles
    texel_size: Doubles
    corners: Doubles


@dataclass(frozen=True)
class Lookups:
    """Surface points, and where they are looked up; on the host.

    triangle: int32 (n). bary: float32 (n, 2). place: float64 (n, 2), column and row, where texel (0, 0) covers 0..1.
    only_known: those of triangles in no row, or without a place, are passed over.
    """

    triangle: Ints
    bary: Floats
    place: Doubles
    only_known: bool = False


@dataclass(frozen=True)
class Screened:
    """marked: int64 (k), ascending, lookups that could break a rule. touched, missing: texels that lookups touch, and
    those of them that are another triangle's or nobody's, where some may be; else both 0."""

    marked: Longs
    touched: int
    missing: int


class LookupScreen:
    """Screens lookups in one atlas. row: that of the table.

    samples: what `plane`, int32 (height, width), on the device, has the numbers of; see PlacedSamples.
    """

    def __init__(
        self, device: Device, samples: SampleList, plane: Array, table: TriangleTable, limits: Limits, stage: str
    ) -> None:
        self._device, self._stage, self.row = device, stage, table.row
        height, width = plane.shape
        self._sizes = (width, height, len(table.texel_size))
        near = limits.near or 0.0
        numbers = np.array([limits.weight, near * near, limits.location, limits.reach])
        doubles = (table.jacobian, table.texel_size, table.corners)
        self._tables = [_lent(device, table.row, np.int32), *(_lent(device, of, np.float64) for of in doubles)]
        self._atlas = (plane, samples.triangle, samples.bary, device.lent(numbers))
        gaps = limits.near is not None
        self._kernel = device.build("validity/lookups.cl", BORDER=BORDER, RUN=RUN, GAPS=int(gaps)).screen_lookups

    def screen(self, lookups: Lookups) -> Screened:
        """Which of them could break a rule: a place that is NaN, a texel touched that is outside or nobody's, a point
        of another triangle too far away, or one of its own over the limit away by the map through its corners."""
        device, count = self._device, len(lookups.triangle)
        points = (
            _lent(device, lookups.triangle, np.int32),
            _lent(device, lookups.bary, np.float32),
            _lent(device, lookups.place, np.float64),
        )
        marks, counts = device.recycled(count, np.uint8), device.zeros(3, np.int32)
        sizes = (count, int(lookups.only_known), *self._sizes)
        arrays = (*points, *self._tables, *self._atlas, marks, counts)
        device.launch(self._stage, self._kernel, -(-count // RUN), *sizes, *arrays)
        marked, touched, missing = counts.get().tolist()
        some = np.flatnonzero(marks.get()[:count].view(bool)) if marked else np.empty(0, np.int64)
        return Screened(some, touched, missing)


def _lent(device: Device, values: arrays.Array, dtype: DTypeLike) -> Array:
    return device.lent(np.asarray(values, dtype))


def screen_lookups_twin(
    samples: tuple[Ints, Floats], plane: Ints, table: TriangleTable, limits: Limits, lookups: Lookups
) -> Screened:
    """The same; samples: their triangles (n) and barycentrics (n, 2)."""
    row = table.row[lookups.triangle]
    known = (row >= 0) & np.isfinite(lookups.place[:, 0])
    marked = np.zeros(len(row), bool) if lookups.only_known else ~known
    some = np.flatnonzero(known)
    nowhere = np.isnan(lookups.place[some, 1])
    marked[some[nowhere]] = True
    some = some[~nowhere]
    if not some.size:
        return Screened(np.flatnonzero(marked), 0, 0)
    with np.errstate(all="ignore"):
        marked[some], touched, missing = _screen_known(
            samples, plane, table, limits, Lookups(lookups.triangle[some], lookups.bary[some], lookups.place[some])
        )
    return Screened(np.flatnonzero(marked), touched, missing)


def _screen_known(
    samples: tuple[Ints, Floats], plane: Ints, table: TriangleTable, limits: Limits, lookups: Lookups
) -> tuple[Bools, int, int]:
    row = table.row[lookups.triangle]
    size = np.array(plane.shape[::-1])
    plane = np.pad(plane, 1, constant_values=BORDER)
    place = np.clip(lookups.place + 0.5, 0, size + 0.999)
    column, line = place.astype(np.int64).T
    x, y = place[:, 0] - column, place[:, 1] - line
    weights = np.stack([(1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y])
    texels = plane[line + np.array([[0], [0], [1], [1]]), column + np.array([[0], [1], [0], [1]])]
    there = np.maximum(texels, 0)
    triangle, bary = samples if len(samples[0]) else (np.zeros(1, np.int32), np.zeros((1, 2), np.float32))
    owner = np.where(texels >= 0, triangle[there], texels)
    own_bary = np.where((texels >= 0)[..., None], bary[there], 0).astype(np.float64)
    touched = weights > limits.weight
    weights *= touched
    other = touched & (owner != lookups.triangle)
    off = (weights[..., None] * own_bary).sum(axis=0) / weights.sum(axis=0)[:, None] - lookups.bary
    texels_off = (table.jacobian[:, row] * off).sum(axis=2)
    bad = ~other.any(axis=0) & ~(np.abs(texels_off) <= limits.location).all(axis=0)
    counts = (0, 0)
    if limits.near is not None:
        across, down = np.stack([x, 1 - x] * 2), np.stack([y, y, 1 - y, 1 - y])
        excused = other & (owner != BORDER) & (across * across + down * down > limits.near * limits.near)
        counts = (int(touched.sum()), int(excused.sum()))
        other &= ~excused
    other_row = np.where(owner >= 0, table.row[owner], -1)
    points = [_surface_points(table.corners[at], of) for at, of in ((other_row, own_bary), (row, lookups.bary))]
    reach = limits.reach * (table.texel_size[row] + table.texel_size[other_row])
    near = (other_row >= 0) & (((points[0] - points[1]) ** 2).sum(axis=-1) <= reach * reach * (1 - 1e-9))
    return bad | (other & ~near).any(axis=0), *counts


def _surface_points(corners: Doubles, bary: Floats | Doubles) -> Doubles:
    """corners (..., 3, 3) and barycentrics (..., 2) to points (..., 3)."""
    b1, b2 = (bary[..., i, None].astype(np.float64) for i in (0, 1))
    first: Doubles = corners[..., 0, :]
    return first + b1 * (corners[..., 1, :] - first) + b2 * (corners[..., 2, :] - first)
