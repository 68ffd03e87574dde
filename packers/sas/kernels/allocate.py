"""Blocks for patches that stay where they are: superblocks, size classes and three-phase allocation.

A superblock is a square of the atlas that holds blocks of one size (a *class*: 2^w by 2^h texels). A class owns a list
of superblocks, its *slots* are numbered through them in that order, and a patch's location word names its slot.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.kernels.common.rank import rank_by_class, rank_by_class_twin
from shading_atlas_bench.packers.sas.kernels.bias import levels_at
from shading_atlas_bench.packers.sas.kernels.layout import pack_location, unpack_location

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device

HERE = Path(__file__).parent

STAGE = "structs/allocate"


@dataclass(frozen=True)
class Grid:
    """The superblocks of an atlas: log2 of their side, and how many lie beside and below each other."""

    top: int
    columns: int
    rows: int

    @property
    def total(self) -> int:
        return self.columns * self.rows

    @property
    def classes(self) -> int:
        return (self.top + 1) * (self.top + 1)

    @property
    def capacity(self) -> np.ndarray:
        """Blocks per superblock of each class, int64 (classes)."""
        level = np.arange(self.top + 1)
        return 1 << (2 * self.top - (level[:, None] + level).reshape(-1))


class Allocator:
    """Location words of all patches, kept from frame to frame.

    words: uint32 (P) on the device, as in layout.py; 0 for a patch without a block. A block stays in place while
    its patch asks for the same size, also while the patch is hidden. When no superblock is left, all are given up and
    every visible patch gets a new block. With `reuse`, a block is given up as soon as its patch is hidden or asks for
    another size, and serves others.
    """

    def __init__(self, device: Device, grid: Grid, patch_count: int, reuse: bool) -> None:
        self.device, self.grid, self.reuse = device, grid, reuse
        self.kernels = device.build(HERE / "allocate.cl")
        self.words = device.empty(patch_count, np.uint32)
        self.used, self.owned, self.bases = (device.empty(grid.classes, np.int32) for _ in range(3))
        self.table = device.empty((grid.classes, grid.total), np.int32)
        self.ordinals, self.state = device.empty(grid.total, np.int32), device.empty(2, np.int32)
        self.resets = 0
        self._clear()

    def _clear(self) -> None:
        for array in (self.words, self.used, self.owned, self.state):
            self.device.fill(array, 0, STAGE)
        self.free = np.zeros(self.grid.classes, np.int64)
        self.pool, self.pool_starts = self.device.zeros(1, np.int32), np.zeros(self.grid.classes, np.int64)
        self.shown = (self.device.empty(0, np.int32), 0)

    def allocate(
        self, patches: Array, count: int, sizes: Array, bias: int, members: Array, marks: Array, mark: int
    ) -> None:
        """Give each of `count` visible patches a block of its level; those that do not fit even in an empty atlas get
        none (word 0).

        patches, sizes: int32 (count), sizes as from `measure_sides`. bias: in eighths. members, marks, mark: as in
        `visible_patches`, they say which patches are visible.
        """
        arguments = (patches, count, sizes, bias, members, marks, mark)
        if not self._try(*arguments) and self.grid.total:
            self._clear()
            self.resets += 1
            self._try(*arguments)
        self.shown = (patches, count)

    def _try(
        self, patches: Array, count: int, sizes: Array, bias: int, members: Array, marks: Array, mark: int
    ) -> bool:
        """One pass of the three phases; False if superblocks ran out."""
        device, grid = self.device, self.grid
        wanted, released = device.empty(count, np.int32), device.empty(count, np.int32)
        asked = (sizes, bias, grid.top, self.words)
        device.launch(STAGE, self.kernels.request, count, count, patches, *asked, wanted, released)
        if self.reuse:
            old_patches, old_count = self.shown
            hidden = device.empty(old_count, np.int32)
            known = (members, marks, mark, grid.top, self.words)
            device.launch(STAGE, self.kernels.release_hidden, old_count, old_count, old_patches, *known, hidden)
            self._recycle(old_patches, old_count, hidden)
            self._recycle(patches, count, released)
        ranks, requests = rank_by_class(device, wanted, count, grid.classes, STAGE)
        free, starts = (device.upload(values.astype(np.int32)) for values in (self.free, self.pool_starts))
        lists = (self.used, self.owned, self.bases, self.table, self.ordinals, self.state)
        device.launch(STAGE, self.kernels.provision, 1, grid.top, grid.total, requests, free, *lists, local=1)
        where = (grid.top, grid.total, grid.columns, self.bases, self.owned, self.table, free, starts, self.pool)
        device.launch(STAGE, self.kernels.assign, count, count, patches, wanted, ranks, *where, self.words)
        if self.reuse:
            self.free = np.maximum(self.free - requests.get(), 0)
        return not self.state.get()[1]

    def _recycle(self, patches: Array, count: int, released: Array) -> None:
        """Add the blocks of `patches` whose entry in `released` is a class to that class's free slots."""
        device, grid = self.device, self.grid
        ranks, totals = rank_by_class(device, released, count, grid.classes, STAGE)
        kept, added = self.free, totals.get().astype(np.int64)
        ends = np.cumsum(kept + added)
        starts = ends - kept - added
        pool = device.empty(int(ends[-1]), np.int32)
        free, old_starts, new_starts = (device.upload(v.astype(np.int32)) for v in (kept, self.pool_starts, starts))
        carried = (free, old_starts, self.pool, new_starts, pool)
        device.launch(STAGE, self.kernels.carry_pool, grid.classes, grid.classes, *carried)
        where = (grid.top, grid.columns, self.ordinals, free, new_starts, pool, self.words)
        device.launch(STAGE, self.kernels.recycle, count, count, patches, released, ranks, *where)
        self.free, self.pool, self.pool_starts = kept + added, pool, starts

    def read(self, patches: Array, count: int) -> np.ndarray:
        """Location words of some patches, uint32 (count)."""
        found = self.device.zeros(count, np.uint32)
        self.device.launch(STAGE, self.kernels.read_words, count, count, patches, self.words, found)
        return found.get()[:count]

    def superblocks_in_use(self) -> int:
        """Superblocks that some class owns."""
        return int(self.state.get()[0])

    def blocks_by_class(self) -> np.ndarray:
        """Slots handed out since the last reset and not free again, int64 (classes)."""
        return self.used.get().astype(np.int64) - self.free


def request_twin(sizes: np.ndarray, bias: int, top: int, words: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Classes of the blocks that patches with these sizes and words want and release, -1 for none."""
    w, h = levels_at(sizes & 0xFF, bias, top), levels_at(sizes >> 8, bias, top)
    now, held = h * (top + 1) + w, classes_of(words, top)
    return np.where(held == now, -1, now), np.where(held == now, -1, held)


def classes_of(words: np.ndarray, top: int) -> np.ndarray:
    """The class of each location word's block, -1 for a word of 0."""
    _, _, w, h = unpack_location(words)
    return np.where(words > 0, h * (top + 1) + w, -1)


class AllocatorTwin:
    """Allocator on the host: words uint32 (P), resets, and `allocate`."""

    def __init__(self, grid: Grid, patch_count: int, reuse: bool) -> None:
        self.grid, self.reuse, self.resets = grid, reuse, 0
        self.words = np.zeros(patch_count, np.uint32)
        self.slot = np.full(patch_count, -1)
        self._clear()

    def _clear(self) -> None:
        self.words[:] = 0
        self.used = np.zeros(self.grid.classes, np.int64)
        self.owned: list[list[int]] = [[] for _ in range(self.grid.classes)]
        self.free: list[list[int]] = [[] for _ in range(self.grid.classes)]
        self.taken = 0
        self.shown = np.empty(0, np.int64)

    def allocate(self, patches: np.ndarray, sizes: np.ndarray, bias: int) -> None:
        """Blocks for the visible patches, in their order."""
        if not self._try(patches, sizes, bias):
            self._clear()
            self.resets += 1
            self._try(patches, sizes, bias)
        self.shown = patches

    def _try(self, patches: np.ndarray, sizes: np.ndarray, bias: int) -> bool:
        wanted, released = request_twin(sizes, bias, self.grid.top, self.words[patches])
        if self.reuse:
            for patch in (*self.shown[~np.isin(self.shown, patches)], *patches[released >= 0]):
                if self.words[patch]:
                    c = classes_of(self.words[[patch]], self.grid.top)[0]
                    self.free[c].append(self.slot[patch])
                    self.words[patch] = 0
        ranks, requests = rank_by_class_twin(wanted, self.grid.classes)
        fits = self._provision(requests)
        for i in np.flatnonzero(wanted >= 0):
            self._assign(patches[i], wanted[i], ranks[i])
        for c, asked in enumerate(requests):
            self.free[c] = self.free[c][: max(0, len(self.free[c]) - asked)]
        return fits

    def _provision(self, requests: np.ndarray) -> bool:
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
