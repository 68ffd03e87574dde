"""The shading samples of placed primitives: which texels, on which triangle, where on it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.kernels.common.scan import exclusive_scan
from shading_atlas_bench.kernels.samples import WIDTH, Samples
from shading_atlas_bench.packers.tss.kernels.forms import OVERSAMPLED
from shading_atlas_bench.packers.tss.kernels.layout import unpack_place
from shading_atlas_bench.packers.tss.kernels.pattern import LEVELS, cells_of
from shading_atlas_bench.packers.tss.kernels.perspective import to_object
from shading_atlas_bench.packers.tss.kernels.primitives import piece_corners

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic import arrays
    from shading_atlas_bench.arithmetic.arrays import Doubles, Floats, Ints, Longs
    from shading_atlas_bench.kernels.device import Device, Kernels
    from shading_atlas_bench.kernels.triangles import Triangles
    from shading_atlas_bench.packers.tss.kernels.primitives import Primitives

HERE = Path(__file__).parent

STAGE, BUDGET = "gather/emit", "structs/budget"
RUNS = 512  # on a CPU: primitives differ in size, so more runs than cores by far


@dataclass(frozen=True)
class CellTable:
    """The cells of all levels one after the other, on the device.

    starts: int32 (66), each level's first cell. near, far: float32, weights of corners 1 and 2. at: int32, column |
    row << 16.
    """

    starts: Array
    near: Array
    far: Array
    at: Array

    @classmethod
    def upload(cls, device: Device) -> CellTable:
        """Tabulate the levels 0 to 64."""
        levels = [cells_of(level) for level in range(LEVELS + 1)]
        starts = np.cumsum([0, *(len(cells.column) for cells in levels)]).astype(np.int32)
        padding = np.zeros(WIDTH, np.int32)  # whole steps are read
        weights = np.concatenate([*(cells.weights for cells in levels), np.zeros((WIDTH, 2))]).astype(np.float32)
        at = np.concatenate([*(cells.column | cells.row << 16 for cells in levels), padding]).astype(np.int32)
        return cls(*(device.upload(values) for values in (starts, weights[:, 0], weights[:, 1], at)))


def build_kernels(device: Device) -> None:
    """Build both forms of the kernels, so that no frame waits for the compiler."""
    for oversampled in (0, 1):
        device.build(HERE / "emit.cl", OVERSAMPLING=oversampled)


@dataclass(frozen=True)
class Placed:
    """Primitives with their places, on the device.

    forms, places: int32 (n, 4) and (n, 2), as from `choose_strategies` and `place_items`. inverse: as from
    `invert_depths`.
    """

    primitives: Primitives
    forms: Array
    places: Array
    inverse: Array


@dataclass(frozen=True)
class _Runs:
    """Primitives, gone through by work-items: `runs` of them, for `run` primitives each.

    oversampled: whether any form is OVERSAMPLED; without, their code is not there.
    """

    count: int
    forms: Array
    places: Array
    table: CellTable
    oversampled: bool
    run: int
    runs: int

    @classmethod
    def cut(
        cls,
        device: Device,
        count: int,
        forms: Array,
        places: Array,
        table: CellTable,
        oversampled: bool = True,
        runs: int | None = None,
    ) -> _Runs:
        """Into so many runs; None for as many as suit the device."""
        run = max(1, -(-count // (runs or RUNS))) if device.is_cpu or runs else 1
        return cls(count, forms, places, table, oversampled, run, -(-count // run))

    @property
    def arguments(self) -> tuple[int | Array, ...]:
        """What kernels read of it first."""
        return self.count, self.run, self.runs, self.forms, self.places, self.table.starts

    def kernels(self, device: Device) -> Kernels:
        """Those that know its forms."""
        return device.build(HERE / "emit.cl", OVERSAMPLING=int(self.oversampled))

    def samples(self, device: Device, stage: str) -> Array:
        """int32 (runs), the samples of each run."""
        counts, local = device.empty(self.runs, np.int32), 1 if device.is_cpu else None
        kernel = self.kernels(device).count_samples
        device.launch(stage, kernel, self.runs, *self.arguments, counts, local=local)
        return counts


def emit_samples(
    device: Device,
    placed: Placed,
    triangles: Triangles,
    table: CellTable,
    atlas_width: int,
    runs: int | None = None,
    oversampled: bool = True,
) -> Samples:
    """The samples of all placed items, in the order of primitives, then rows.

    A primitive's samples are spaced evenly on screen. The footprint is the longest way on the surface from a sample to
    the next along an edge of an L, or along base or height of a right triangle.
    oversampled: whether any form is OVERSAMPLED; without, their code is not there.
    """
    primitives = placed.primitives
    work = _Runs.cut(device, primitives.count, placed.forms, placed.places, table, oversampled, runs)
    counts = work.samples(device, STAGE)
    offsets, total = exclusive_scan(device, counts, work.runs, STAGE)
    s = Samples.allocate(device, total)
    known = (primitives.firsts, primitives.parents, primitives.starts, primitives.pieces, placed.inverse)
    scene = (primitives.ids, triangles.indices, triangles.positions, table.near, table.far, table.at, atlas_width)
    results = (counts, offsets, s.triangle, s.bary1, s.bary2, s.footprint, s.texel)
    kernel, local = work.kernels(device).emit_samples, 1 if device.is_cpu else None
    device.launch(STAGE, kernel, work.runs, *work.arguments, *known, *scene, *results, local=local)
    return s


def count_samples(device: Device, count: int, forms: Array, table: CellTable) -> int:
    """The samples that primitives of these forms, int32 (count, 4), have once all of their items are placed."""
    places = device.recycled((count, 2), np.int32)
    device.fill(places, 0, BUDGET)
    work = _Runs.cut(device, count, forms, places, table)
    return exclusive_scan(device, work.samples(device, BUDGET), work.runs, BUDGET)[1]


def row_length(p: int, q: int, row: int) -> int:
    """Texels in a row (0 to q) of a right triangle with p texels to one side and q to the other: those that bilinear
    lookups inside touch, and few more. Row i of the other side: min(q + 1, ceil(q (1 - max(0, i - 1) / p)) + 1)."""
    return min(p, -(-p * (q - max(row - 1, 0)) // q)) + 1


def half_texels(p: int, q: int) -> tuple[Longs, Longs]:
    """Column and row, int (n), of all texels of such a right triangle, by row."""
    lengths = [row_length(p, q, row) for row in range(q + 1)]
    return np.concatenate([np.arange(n) for n in lengths]), np.repeat(np.arange(q + 1), lengths)


def emit_primitive_twin(
    triangle: int,
    corners: Floats,
    inverse: Doubles,
    piece: tuple[int, int],
    first: int,
    form: Ints,
    places: Ints,
    atlas_width: int,
) -> dict[str, arrays.Array]:
    """The samples of one primitive by the names of Samples, float64.

    corners: (3, 3). inverse: (3). piece: parts along an edge, and the piece's number. first: corner where the longest
    edge begins. form (4), places (2): as in `choose_strategies` and `place_items`.
    """
    at = piece_corners(*(np.array([k]) for k in piece))[0]
    halves, level = form[0] == OVERSAMPLED, int(form[0])
    local, offset, steps = _halves(at, first, form, places) if halves else _cells(at, level, places)
    column, row, sign = unpack_place(offset[:, 0])
    texel = (row + sign * offset[:, 2]) * atlas_width + column + sign * offset[:, 1]
    spread = np.broadcast_to(inverse, (len(local), 3))
    ways = [_ways(corners, inverse, at.mean(axis=0)[None], step)[0] for step in steps]
    footprint = _ways(corners, inverse, local, steps[int(np.argmax(ways))])
    bary = to_object(local, spread)
    names = ("triangle", "bary1", "bary2", "footprint", "texel")
    return dict(zip(names, (np.full(len(local), triangle), *bary.T, footprint, texel), strict=True))


def _cells(at: Doubles, level: int, places: Ints) -> tuple[Doubles, arrays.Array, list[Doubles]]:
    """Screen weights (n, 2), place with column and row (n, 3), and steps of an L's samples."""
    cells = cells_of(level)
    first, second = at[1] - at[0], at[2] - at[0]
    local = at[0] + cells.weights[:, :1] * first + cells.weights[:, 1:] * second
    offset = np.stack([np.full(len(cells.row), places[0]), cells.column, cells.row], axis=1)
    return local, offset, [step / max(level, 1) for step in (first, second, first - second)]


def _halves(at: Doubles, first: int, form: Ints, places: Ints) -> tuple[Doubles, arrays.Array, list[Doubles]]:
    """The same for right triangles."""
    _, height, before, after = (int(k) for k in form)
    begin, end, apex = (at[(first + k) % 3] for k in range(3))
    along = (end - begin) / (before + after)
    foot = begin + before * along
    up = (apex - foot) / height
    points, offsets = [], []
    for side, texels, place in ((-along, before, places[0]), (along, after, places[1])):
        if place < 0:
            continue
        column, row = half_texels(max(texels, height), min(texels, height))
        base, rise = (column, row) if texels > height else (row, column)
        points.append(foot + base[:, None] * side + rise[:, None] * up)
        offsets.append(np.stack([np.full(len(row), place), column, row], axis=1))
    return np.concatenate(points), np.concatenate(offsets), [along, up]


def _ways(corners: Floats, inverse: Doubles, points: Doubles, step: Doubles) -> Doubles:
    """Lengths (n) on the surface of a small step of screen weights at points (n, 2): the perspective's derivative."""
    weights = np.column_stack([1 - points.sum(axis=1), points]) * inverse
    change = np.array([-step.sum(), *step]) * inverse
    total = np.maximum(weights.sum(axis=1, keepdims=True), inverse.min() / 4)
    derivative = (change - weights / total * change.sum()) / total
    lengths: Doubles = np.linalg.norm(derivative @ (corners.astype(np.float64) - corners[0]), axis=1)
    return lengths
