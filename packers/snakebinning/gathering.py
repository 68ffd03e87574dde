"""Shading gathering (section 3.7): the samples of a layout, as many as the frame may have."""

from __future__ import annotations

from typing import TYPE_CHECKING

from shading_atlas_bench.packers.snakebinning.kernels.emit import Blowup, emit_samples

if TYPE_CHECKING:
    from shading_atlas_bench.kernels.samples import Samples
    from shading_atlas_bench.packers.interface import Frame
    from shading_atlas_bench.packers.snakebinning.filling import Filling


def gather(frame: Frame, filling: Filling, blowup: Blowup, resets: int) -> Samples:
    """The samples of the layout; where they are not as many as the frame's budget has, of one at another rate.

    resets: before this frame.
    """
    samples, budget, budgeted = _emit(frame, filling, blowup), frame.sample_budget, filling.budgeted
    if budget is None:
        return samples
    is_lowered = filling.step > 1  # so that they are not those of the rate asked for
    is_known = not is_lowered or budgeted.reached is not None
    if is_known and budgeted.keeps(budget, samples.count):
        return samples

    def at(rate: float) -> int | None:
        nonlocal samples
        budgeted.rate = rate
        if not (filling.fill(frame, 0) or filling.fill(frame, 1)):
            return None
        samples = _emit(frame, filling, blowup)
        return samples.count

    filling.resets = resets + (filling.slots.frames > 1)
    if not budgeted.meet(budget, at, None if is_lowered else samples.count):
        filling.reset(frame)
        samples = _emit(frame, filling, blowup)
        budgeted.reached = samples.count
    return samples


def _emit(frame: Frame, filling: Filling, blowup: Blowup) -> Samples:
    scene, listed = filling.footprints.slicing.scene, filling.items.listed
    return emit_samples(frame.scene.device, listed, scene, filling.slots.placement, blowup, frame.atlas_width)
