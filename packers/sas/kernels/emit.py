"""The shading samples of allocated blocks: which texels, on which triangle, where on it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.kernels.common.scan import exclusive_scan
from shading_atlas_bench.kernels.samples import Samples
from shading_atlas_bench.packers.sas.kernels.bias import levels_at
from shading_atlas_bench.packers.sas.kernels.layout import (
    POINTS,
    ROLE_WEIGHTS,
    corner_points,
    pack_location,
    unpack_location,
)

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic import arrays
    from shading_atlas_bench.arithmetic.arrays import Bools, Bytes, Doubles, Ints, Longs, Words
    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.packers.sas.kernels.bias import Request
    from shading_atlas_bench.packers.sas.kernels.inputs import Soup
    from shading_atlas_bench.packers.sas.kernels.tables import PatchTables
    from shading_atlas_bench.packers.sas.kernels.visible import VisiblePatches

HERE = Path(__file__).parent

STAGE, BUDGET = "gather/emit", "structs/budget"
RUNS = 512  # on a CPU: patches differ in size by 65536, so more runs than cores by far


@dataclass(frozen=True)
class _Runs:
    """The blocks of visible patches, gone through by work-items: `runs` of them, for `run` patches each."""

    visible: VisiblePatches
    words: Array
    tables: PatchTables
    complete: bool
    run: int
    runs: int

    @classmethod
    def cut(
        cls,
        device: Device,
        visible: VisiblePatches,
        words: Array,
        tables: PatchTables,
        complete: bool,
        runs: int | None = None,
    ) -> _Runs:
        """Into so many runs; None for as many as suit the device."""
        run = max(1, -(-visible.count // (runs or RUNS))) if device.is_cpu or runs else 1
        return cls(visible, words, tables, complete, run, -(-visible.count // run))

    @property
    def arguments(self) -> tuple[int | Array, ...]:
        """What kernels read of it first."""
        visible = (self.visible.patches, self.visible.masks)
        return self.visible.count, self.run, self.runs, int(self.complete), *visible, self.tables.members, self.words

    def count(self, device: Device, stage: str) -> tuple[Array, Array]:
        """Samples of each run, and the number of triangles without a texel."""
        counts, without = device.empty(self.runs, np.int32), device.empty(1, np.int32)
        device.fill(without, 0, stage)
        kernel, local = device.build(HERE / "emit.cl").count_samples, 1 if device.is_cpu else None
        device.launch(stage, kernel, self.runs, *self.arguments, counts, without, local=local)
        return counts, without


def emit_samples(
    device: Device,
    visible: VisiblePatches,
    words: Array,
    tables: PatchTables,
    atlas_width: int,
    complete: bool,
    runs: int | None = None,
) -> tuple[Samples, int]:
    """The samples of the blocks of visible patches, in the order of patches, rows and columns; and how many triangles
    in the set have a block, but own no texel of it.

    words: uint32 (P), locations.
    Of each block the texels that bilinear lookups inside the triangles in the set touch, row by row from the first to
    the last such column; all of it where `complete`. A texel belongs to the patch's triangle that it lies in, or that
    continues there. Its barycentrics follow from the half-texel inset: corners lie at the centres of the corner texels;
    along a side of one texel the middle stands for all. The footprint is the longer of the two ways on the surface
    between neighbouring texels.
    """
    work = _Runs.cut(device, visible, words, tables, complete, runs)
    counts, without = work.count(device, STAGE)
    offsets, total = exclusive_scan(device, counts, work.runs, STAGE)
    bare = int(without.get()[0])
    s = Samples.allocate(device, total)
    kernels, local = device.build(HERE / "emit.cl"), 1 if device.is_cpu else None
    known = (tables.codes, tables.weights, tables.ways, atlas_width, counts, offsets)
    results = (s.triangle, s.bary1, s.bary2, s.footprint, s.texel)
    device.launch(STAGE, kernels.emit_samples, work.runs, *work.arguments, *known, *results, local=local)
    return s, bare


def count_asked(
    device: Device, visible: VisiblePatches, request: Request, top: int, tables: PatchTables, complete: bool
) -> int:
    """The samples that visible patches have in blocks as large as they ask for.

    top: log2 of a superblock's side. complete: as in `emit_samples`.
    """
    words, count = device.recycled(tables.count, np.uint32), visible.count
    asked = (visible.patches, request.sizes, request.bias, top, words)
    device.launch(BUDGET, device.build(HERE / "emit.cl").ask_in_corner, count, count, *asked)
    work = _Runs.cut(device, visible, words, tables, complete)
    counts, _ = work.count(device, BUDGET)
    return exclusive_scan(device, counts, work.runs, BUDGET)[1]


def count_asked_twin(masks: Bytes, sizes: Ints, bias: int, top: int, soup: Soup) -> int:
    """The same for patches 0, 1, ... of which `masks` and `sizes` are."""
    zeros, patches = np.zeros(len(sizes), np.int64), np.arange(len(sizes), dtype=np.int32)
    words = pack_location(zeros, zeros, levels_at(sizes & 0xFF, bias, top), levels_at(sizes >> 8, bias, top))
    return len(emit_samples_twin(patches, masks, words, soup, 1, False)["texel"])


def without_texel_twin(patches: Ints, masks: Bytes, words: Words, members: Ints, triangle: arrays.Array) -> int:
    """Triangles in the set with a block of which they own no texel, from the triangles of all samples, int (m).

    patches: int32 (n), the visible ones. masks: uint8 (n), see VisiblePatches. words: uint32 (P), locations. members:
    int32 (P, 3).
    """
    placed = (masks[:, None] >> np.arange(3) & 1 > 0) & (words[patches] > 0)[:, None]
    return int((~np.isin(members[patches][placed], triangle)).sum())


def emit_samples_twin(
    patches: Ints, masks: Bytes, words: Words, soup: Soup, atlas_width: int, complete: bool
) -> dict[str, arrays.Array]:
    """The samples, (m) each, by the names of Samples; floats are float64.

    patches: int32 (n), the visible ones. masks: uint8 (n), see VisiblePatches. words: uint32 (P), locations.
    """
    blocks: list[dict[str, arrays.Array]] = []
    for patch, mask in zip(patches, masks, strict=True):
        if words[patch]:
            own = soup.members[patch][soup.members[patch] >= 0]
            corners, codes = soup.positions[soup.indices[own]].astype(np.float64), soup.codes[own]
            blocks.append(_emit_block(words[patch], 7 if complete else int(mask), own, codes, corners, atlas_width))
    names = ("triangle", "bary1", "bary2", "footprint", "texel")
    return {name: np.concatenate([block[name] for block in blocks]) if blocks else np.empty(0) for name in names}


def _emit_block(
    word: np.uint32, mask: int, members: Ints, codes: Bytes, corners: Doubles, atlas_width: int
) -> dict[str, arrays.Array]:
    """The samples of one block; members (1 to 3) are triangles, codes and corners (3, 3) one of each per member."""
    x0, y0, w, h = (int(value[0]) for value in unpack_location(np.array([word])))
    w, h = 1 << w, 1 << h
    column, row = (grid.reshape(-1) for grid in np.meshgrid(np.arange(w), np.arange(h)))
    if mask != 7:
        kept = _touched(w, h, mask, codes)
        column, row = column[kept], row[kept]
    u = column / (w - 1) if w > 1 else np.full(len(column), 0.5)
    v = row / (h - 1) if h > 1 else np.full(len(row), 0.5)
    if len(members) == 1 and w == h == 1:  # the middle of the triangle, not of its rectangle
        u, v = np.full(1, 1 / 3), np.full(1, 1 / 3)
    elif len(members) == 1 and w == 1:
        u = (1 - v) / 2
    elif len(members) == 1 and h == 1:
        v = (1 - u) / 2
    owner = _owner(u, v, len(members), mask)
    weights = [ROLE_WEIGHTS[code // 3][(np.arange(3) - code % 3) % 3] for code in codes.astype(int)]
    basis = np.stack([np.ones_like(u), u, v])
    bary = np.stack([weight @ basis for weight in weights])[owner, :, np.arange(len(u))]
    sides = [weight[:, 1:].T @ corner for weight, corner in zip(weights, corners, strict=True)]
    sizes = [np.linalg.norm(side, axis=1) / [max(w - 1, 1), max(h - 1, 1)] for side in sides]
    return {
        "triangle": members[owner],
        "bary1": bary[:, 1],
        "bary2": bary[:, 2],
        "footprint": np.array([size.max() for size in sizes])[owner],
        "texel": (y0 + row) * atlas_width + x0 + column,
    }


def _owner(u: Doubles, v: Doubles, members: int, mask: int) -> Longs:
    """Slot of the triangle that owns each position; on a shared edge the first, if it is in the set."""
    margin = 1e-9 if mask & 1 else -1e-9
    owner = np.zeros(len(u), np.int64)
    if members == 2:
        owner[u + v - 1 > margin] = 1
    if members == 3:
        owner[2 * u - v - 1 > margin] = 1
        owner[1 - 2 * u - v > margin] = 2
    return owner


def _touched(w: int, h: int, mask: int, codes: Bytes) -> Bools:
    """bool (h * w): columns of each row between the first and last that lookups inside the triangles in `mask` touch.

    A lookup touches the texels less than one away in both directions; a triangle comes that near a texel if, cut by the
    two rows around it, it has a width that comes that near.
    """
    touched = np.zeros((h, w), bool)
    for slot, code in enumerate(codes):
        if not mask >> slot & 1:
            continue
        corners = POINTS[corner_points(np.array([code]))[0]] * [w - 1, h - 1]
        for row in range(h):
            low, high = _extent(corners, row - 1, row + 1)
            column = np.arange(w)
            touched[row] |= (column > low - 1 + 1e-9) & (column < high + 1 - 1e-9)
    filled = np.maximum.accumulate(touched, axis=1) & np.maximum.accumulate(touched[:, ::-1], axis=1)[:, ::-1]
    return filled.reshape(-1)


def _extent(corners: Doubles, above: float, below: float) -> tuple[float, float]:
    """Lowest and highest x of a triangle (3, 2) between two rows."""
    found = [x for x, y in corners if above <= y <= below]
    for k in range(3):
        (x0, y0), (x1, y1) = corners[k], corners[(k + 1) % 3]
        for y in (above, below):
            if y0 != y1 and min(y0, y1) <= y <= max(y0, y1):
                found.append(x0 + (x1 - x0) * (y - y0) / (y1 - y0))
    return (min(found), max(found)) if found else (np.inf, -np.inf)
