"""Filling the atlas with a frame's set: as published if that has room, else in steps (README.md, Full atlases)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.packers.budget import BudgetedRate
from shading_atlas_bench.packers.snakebinning.footprint import Sampling, TriangleFootprints

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic.arrays import Ints
    from shading_atlas_bench.packers.interface import Frame
    from shading_atlas_bench.packers.snakebinning.freezing import Freezing
    from shading_atlas_bench.packers.snakebinning.kernels.footprint import Fit
    from shading_atlas_bench.packers.snakebinning.kernels.pieces import TriangleList
    from shading_atlas_bench.packers.snakebinning.kernels.superblocks import Atlas
    from shading_atlas_bench.packers.snakebinning.slots import Slots

STEPS = 66  # ways to fill the atlas, from full rate on
TIGHT_SPARE = 0.1  # largest `capacity` from the second step on; at the last there is none
POINT_TEXELS = 2.0  # longest edge of a triangle below which it takes one texel, where texels are short


class Filling:
    """Measures a frame's set and gives it slots, at a rate at which it has room.

    atlas, fit: as at the first step. budgeted: texels per pixel that are asked for. points: whether small triangles
    take one texel where texels are short.

    items: of the frame. measured: the set for which the layout was made. step: at which that was. resets: of the atlas,
    so far. left_out: bool (T + MOST), triangles and pieces for which the atlas is too small.
    """

    def __init__(
        self,
        footprints: TriangleFootprints,
        slots: Slots,
        freezing: Freezing,
        atlas: Atlas,
        fit: Fit,
        budgeted: BudgetedRate,
        points: bool,
    ) -> None:
        self.footprints, self.slots, self.freezing = footprints, slots, freezing
        self.atlas, self.fit, self.budgeted, self.points = atlas, fit, budgeted, points
        self.step = self.resets = 0
        self.left_out = np.zeros(footprints.measured.bins.shape, bool)

    @property
    def rate(self) -> float:
        """Texels per pixel: all of them at the first two steps, and 2^(1/8) times fewer at each one further."""
        return self.budgeted.rate * 2 ** (-max(self.step - 1, 0) / 8)

    def sampling(self, frame: Frame) -> Sampling:
        """How triangles of a frame are measured at the present step."""
        has_points = self.points and (self.step > 0 or frame.sample_budget is not None)
        return Sampling(self.rate, replace(self.fit, point=POINT_TEXELS * has_points))

    def list_items(self, frame: Frame) -> None:
        """Items of the frame, whose layout may be that of an earlier one."""
        self.items = self.footprints.slicing.items(frame, self.left_out)

    def make(self, frame: Frame, sampling: Sampling) -> bool:
        """Measure the whole set, and give it slots; False if the atlas has no room for some."""
        number, left_out = self.slots.frames, self.left_out
        self.items, self.measured = self.footprints.measure_set(frame, number, sampling, left_out)
        return self._settle(frame)

    def extend(self, frame: Frame, is_new: Array, new: Ints, listed: TriangleList) -> bool:
        """Slots for new items that are measured; without room for all, they wait for the next layout. False if
        only now there is none.

        is_new: uint8 (n) on the device, of the set's items. new: int32 (m), the numbers of those that are.
        """
        if self.left_out.any():
            self.left_out[new] = True
            self.list_items(frame)
            return True
        return self.slots.extend(self.items.listed, is_new, listed, frame.scene.skips)

    def reset(self, frame: Frame) -> None:
        """Empty the atlas, and fill it at the first step at which everything has a place; without one, with what fits.

        Looked for from the present step on, because the sets of neighbouring frames need about the same; on to higher
        rates only where a reset was due, not where the room ran out. Where it did so soon after the last time, the step
        leaves no room for what comes, and the next one is taken.
        """
        slots, mapped_at = self.slots, self.slots.mapping.mapped_at
        is_due = self.left_out.any() or slots.mapping.is_due(slots.frames)
        is_soon = mapped_at > 0 and slots.frames - mapped_at <= self.freezing.most and self.step < STEPS - 1
        too_full = -1 if is_due else self.step - (not is_soon)
        step = first_with_room(lambda step: self.fill(frame, step), too_full, self.step)
        if step == STEPS:
            self._leave_out(frame)
        elif step != self.step:
            self.fill(frame, step)

    def fill(self, frame: Frame, step: int) -> bool:
        """Fill an empty atlas at one step; whether everything has a place."""
        self.step = step
        self.left_out[:] = False
        self._empty()
        return self.make(frame, self.sampling(frame).without_hysteresis())

    def _leave_out(self, frame: Frame) -> None:
        """Fill an atlas that is too small with as many triangles as it holds, the largest on the screen first."""
        ids = self.items.ids
        order, most = np.lexsort((ids, -self.measured.areas)), len(ids)
        while left := self.slots.superblocks.numbers["left"]:
            most -= left
            self.left_out[ids[order[most:]]] = True
            self.list_items(frame)
            self._empty()
            self._settle(frame)

    def _empty(self) -> None:
        """From the second step on nothing is wasted for coherence."""
        tight, atlas = self.step > 0, self.atlas
        if tight:
            spare = min(1 + TIGHT_SPARE, atlas.capacity) if self.step < STEPS - 1 else 1.0
            atlas = replace(atlas, capacity=spare, fit="tight")
        self.slots.empty(atlas)

    def _settle(self, frame: Frame) -> bool:
        """Slots for all items; False if the atlas has no room for some."""
        if not self.slots.make(self.items.listed, frame.scene.skips):
            return False
        self.freezing.restart(self.measured.area)
        return True


def first_with_room(has_room: Callable[[int], bool], too_full: int, start: int) -> int:
    """The first step after `too_full` that has room, STEPS for none; tried from `start` on in growing strides.

    has_room: of a step; where it has, all later ones have.
    """
    low, high, step, stride = too_full, STEPS, max(start, too_full + 1), 1
    while low + 1 < high:
        low, high = (low, step) if has_room(step) else (step, high)
        further = high - stride if step == high else low + stride
        step, stride = further if low < further < high else (low + high) // 2, 2 * stride
    return high
