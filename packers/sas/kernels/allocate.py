"""Blocks for patches that stay where they are: superblocks, size classes and three-phase allocation.

A superblock is a square of the atlas that holds blocks of one size (a *class*: 2^w by 2^h texels). A class owns a list
of superblocks, its *slots* are numbered through them in that order, and a patch's location word names its slot.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from shading_atlas_bench.kernels.common.rank import rank_by_class, rank_by_class_twin
from shading_atlas_bench.packers.sas.kernels.bias import levels_at
from shading_atlas_bench.packers.sas.kernels.layout import pack_location, unpack_location
from shading_atlas_bench.packers.sas.kernels.visible import VisiblePatches

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic.arrays import Ints, Longs, Words
    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.packers.sas.kernels.bias import Request
    from shading_atlas_bench.packers.sas.kernels.visible import Marks

HERE = Path(__file__).parent

STAGE = "structs/allocate"


@dataclass(frozen=True)
class SuperblockGrid:
    """The superblocks of an atlas: log2 of their side, and how many lie beside and below each other."""

    top: int
    columns: int
    rows: int

    @property
    def total(self) -> int:
        """Superblocks of the atlas."""
        return self.columns * self.rows

    @property
    def classes(self) -> int:
        """Size classes of blocks: every power of two up to a superblock's side, in width and in height."""
        return (self.top + 1) * (self.top + 1)

    @property
    def capacity(self) -> Longs:
        """Blocks per superblock of each class, int64 (classes)."""
        level = np.arange(self.top + 1)
        blocks: Longs = 1 << (2 * self.top - (level[:, None] + level).reshape(-1))
        return blocks


@dataclass(frozen=True)
class Superblocks:
    """Which class owns which superblock, on the device.

    used: int32 (classes), slots ever handed out. owned: int32 (classes), superblocks. bases: int32 (classes), `used`
    before the last request. table: int32 (classes, total), the superblocks of each class in order; ordinals: int32
    (total), the inverse. state: int32 (2), superblocks that are taken, and 1 if they did not suffice.
    """

    used: Array
    owned: Array
    bases: Array
    table: Array
    ordinals: Array
    state: Array

    @classmethod
    def allocate(cls, device: Device, grid: SuperblockGrid) -> Superblocks:
        """Those of an atlas, with anything in them."""
        used, owned, bases = (device.empty(grid.classes, np.int32) for _ in range(3))
        table, ordinals = device.empty((grid.classes, grid.total), np.int32), device.empty(grid.total, np.int32)
        return cls(used, owned, bases, table, ordinals, device.empty(2, np.int32))


@dataclass(frozen=True)
class FreeSlots:
    """Slots that patches gave up, by class: counts and starts, int64 (classes), of each class's part of the pool, int32
    on the device."""

    counts: Longs
    starts: Longs
    pool: Array

    @classmethod
    def none(cls, device: Device, grid: SuperblockGrid) -> FreeSlots:
        """Of an atlas whose blocks are all in place."""
        return cls(np.zeros(grid.classes, np.int64), np.zeros(grid.classes, np.int64), device.zeros(1, np.int32))

    def upload(self, device: Device) -> tuple[Array, Array]:
        """Counts and starts as kernels read them, int32 (classes)."""
        return device.upload(self.counts.astype(np.int32)), device.upload(self.starts.astype(np.int32))


class Allocator:
    """Location words of all patches, kept from frame to frame.

    words: uint32 (P) on the device, as in layout.py; 0 for a patch without a block. A block stays in place while
    its patch asks for the same size, also while the patch is hidden. When no superblock is left, all are given up and
    every visible patch gets a new block. With `reuse`, a block is given up as soon as its patch is hidden or asks for
    another size, and serves others.
    """

    def __init__(self, device: Device, grid: SuperblockGrid, patch_count: int, reuse: bool) -> None:
        self.device, self.grid, self.reuse = device, grid, reuse
        self.kernels = device.build(HERE / "allocate.cl")
        self.words = device.empty(patch_count, np.uint32)
        self.superblocks = Superblocks.allocate(device, grid)
        self.resets = 0
        self._clear()

    def _clear(self) -> None:
        for array in (self.words, self.superblocks.used, self.superblocks.owned, self.superblocks.state):
            self.device.fill(array, 0, STAGE)
        self.free = FreeSlots.none(self.device, self.grid)
        self.shown = VisiblePatches.none(self.device)

    def allocate(self, visible: VisiblePatches, request: Request, members: Array, marks: Marks) -> None:
        """Give each visible patch a block of its level; those that do not fit even in an empty atlas get none (word 0).

        members: int32 (P, 3), of all patches. marks: as `visible_patches` left them.
        """
        if not self._try(visible, request, members, marks) and self.grid.total:
            self._clear()
            self.resets += 1
            self._try(visible, request, members, marks)
        self.shown = visible

    def _try(self, visible: VisiblePatches, request: Request, members: Array, marks: Marks) -> bool:
        """One pass of the three phases; False if superblocks ran out."""
        device, grid, count = self.device, self.grid, visible.count
        wanted, released = device.empty(count, np.int32), device.empty(count, np.int32)
        asked = (visible.patches, request.sizes, request.bias, grid.top, self.words)
        device.launch(STAGE, self.kernels.request, count, count, *asked, wanted, released)
        if self.reuse:
            self._recycle(self.shown, self._hidden(members, marks))
            self._recycle(visible, released)
        ranks, requests = rank_by_class(device, wanted, count, grid.classes, STAGE)
        free, starts = self.free.upload(device)
        tables = self.superblocks
        lists = (tables.used, tables.owned, tables.bases, tables.table, tables.ordinals, tables.state)
        device.launch(STAGE, self.kernels.provision, 1, grid.top, grid.total, requests, free, *lists, local=1)
        where = (grid.top, grid.total, grid.columns, tables.bases, tables.owned, tables.table)
        slots = (*where, free, starts, self.free.pool)
        device.launch(STAGE, self.kernels.assign, count, count, visible.patches, wanted, ranks, *slots, self.words)
        if self.reuse:
            self.free = replace(self.free, counts=np.maximum(self.free.counts - requests.get(), 0))
        return not tables.state.get()[1]

    def _hidden(self, members: Array, marks: Marks) -> Array:
        """int32 (n): of the patches shown last, the class of the block of each that is not any more, -1 for others."""
        shown, hidden = self.shown, self.device.empty(self.shown.count, np.int32)
        known = (shown.patches, members, marks.triangles, marks.number, self.grid.top, self.words)
        self.device.launch(STAGE, self.kernels.release_hidden, shown.count, shown.count, *known, hidden)
        return hidden

    def _recycle(self, listed: VisiblePatches, released: Array) -> None:
        """Add the blocks of the patches whose entry in `released` is a class to that class's free slots."""
        device, grid, kept = self.device, self.grid, self.free
        ranks, totals = rank_by_class(device, released, listed.count, grid.classes, STAGE)
        counts = kept.counts + totals.get().astype(np.int64)
        ends = np.cumsum(counts)
        grown = FreeSlots(counts, ends - counts, device.empty(int(ends[-1]), np.int32))
        (free, old_starts), new_starts = kept.upload(device), device.upload(grown.starts.astype(np.int32))
        carried = (free, old_starts, kept.pool, new_starts, grown.pool)
        device.launch(STAGE, self.kernels.carry_pool, grid.classes, grid.classes, *carried)
        where = (grid.top, grid.columns, self.superblocks.ordinals, free, new_starts, grown.pool, self.words)
        given_up = (listed.count, listed.patches, released, ranks)
        device.launch(STAGE, self.kernels.recycle, listed.count, *given_up, *where)
        self.free = grown

    def read(self, visible: VisiblePatches) -> Words:
        """Location words of these patches, uint32 (n)."""
        found, count = self.device.zeros(visible.count, np.uint32), visible.count
        self.device.launch(STAGE, self.kernels.read_words, count, count, visible.patches, self.words, found)
        words: Words = found.get()[:count]
        return words

    def superblocks_in_use(self) -> int:
        """Superblocks that some class owns."""
        return int(self.superblocks.state.get()[0])

    def blocks_by_class(self) -> Longs:
        """Slots handed out since the last reset and not free again, int64 (classes)."""
        blocks: Longs = self.superblocks.used.get().astype(np.int64) - self.free.counts
        return blocks


def request_twin(sizes: Ints, bias: int, top: int, words: Words) -> tuple[Longs, Longs]:
    """Classes, int64 (n), of the blocks that patches want and release, -1 for none.

    sizes: int32 (n), as in Request. words: uint32 (n), locations.
    """
    w, h = levels_at(sizes & 0xFF, bias, top), levels_at(sizes >> 8, bias, top)
    now, held = h * (top + 1) + w, classes_of(words, top)
    return np.where(held == now, -1, now), np.where(held == now, -1, held)


def classes_of(words: Words, top: int) -> Longs:
    """The class of each location word's block, int64 (n) for words uint32 (n), -1 for a word of 0."""
    _, _, w, h = unpack_location(words)
    return np.where(words > 0, h * (top + 1) + w, -1)


class AllocatorTwin:
    """Allocator on the host: words uint32 (P), resets, and `allocate`."""

    def __init__(self, grid: SuperblockGrid, patch_count: int, reuse: bool) -> None:
        self.grid, self.reuse, self.resets = grid, reuse, 0
        self.words = np.zeros(patch_count, np.uint32)
        self.slot = np.full(patch_count, -1, np.int64)
        self._clear()

    def _clear(self) -> None:
        self.words[:] = 0
        self.used: Longs = np.zeros(self.grid.classes, np.int64)
        self.owned: list[list[int]] = [[] for _ in range(self.grid.classes)]
        self.free: list[list[int]] = [[] for _ in range(self.grid.classes)]
        self.taken = 0
        self.shown: NDArray[np.integer[Any]] = np.empty(0, np.int64)

    def allocate(self, patches: Ints, sizes: Ints, bias: int) -> None:
        """Blocks for the visible patches, int32 (n), in their order; sizes: int32 (n), as in Request."""
        if not self._try(patches, sizes, bias):
            self._clear()
            self.resets += 1
            self._try(patches, sizes, bias)
        self.shown = patches

    def _try(self, patches: Ints, sizes: Ints, bias: int) -> bool:
        wanted, released = request_twin(sizes, bias, self.grid.top, self.words[patches])
        if self.reuse:
            for patch in (*self.shown[~np.isin(self.shown, patches)], *patches[released >= 0]):
                if self.words[patch]:
                    c = classes_of(self.words[[patch]], self.grid.top)[0]
                    self.free[c].append(int(self.slot[patch]))
                    self.words[patch] = 0
        ranks, requests = rank_by_class_twin(wanted, self.grid.classes)
        fits = self._provision(requests)
        for i in np.flatnonzero(wanted >= 0):
            self._assign(int(patches[i]), int(wanted[i]), int(ranks[i]))
        for c, asked in enumerate(requests):
            self.free[c] = self.free[c][: max(0, len(self.free[c]) - asked)]
        return fits

    def _provision(self, requests: Longs) -> bool:
        capacity, fits = self.grid.capacity, True
        self.bases = self.used.copy()
        for c, asked in enumerate(requests):
            end = self.used[c] + max(0, asked - len(self.free[c]))
            while len(self.owned[c]) * capacity[c] < end and self.taken < self.grid.total:
                self.owned[c].append(self.taken)
                self.taken += 1
            self.used[c] = min(end, len(self.owned[c]) * capacity[c])
            fits &= bool(self.used[c] == end)
        return fits

    def _assign(self, patch: int, c: int, rank: int) -> None:
        top, columns = self.grid.top, self.grid.columns
        w, h = c % (top + 1), c // (top + 1)
        fresh = rank - len(self.free[c])
        slot = self.free[c][-fresh - 1] if fresh < 0 else self.bases[c] + fresh
        order, inside = divmod(int(slot), int(self.grid.capacity[c]))
        self.slot[patch], self.words[patch] = slot, 0
        if order < len(self.owned[c]):
            row, column = divmod(self.owned[c][order], columns)
            inside_row, inside_column = divmod(inside, 1 << (top - w))
            x, y = (column << top) + (inside_column << w), (row << top) + (inside_row << h)
            self.words[patch] = pack_location(x, y, w, h)
