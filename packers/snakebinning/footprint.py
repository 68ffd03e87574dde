"""Triangle footprints (section 3.1): triangles measured in the predicted view in which they are largest.

Bins follow from footprints (3.2): both are one kernel.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.functions import log2
from shading_atlas_bench.packers.snakebinning.kernels.footprint import (
    CLIPPED,
    KEPT,
    MOVED_BACK,
    POINT,
    SLENDER,
    Fit,
    Footprints,
    measure_triangles,
    pack_views,
)
from shading_atlas_bench.packers.snakebinning.kernels.pieces import TriangleList
from shading_atlas_bench.packers.snakebinning.kernels.slices import MOST, texel_steps
from shading_atlas_bench.packers.snakebinning.slicing import Items, Slicing

if TYPE_CHECKING:
    from shading_atlas_bench.arithmetic.arrays import Bools, Bytes, Doubles, Floats, Ints
    from shading_atlas_bench.packers.interface import Frame, ServerScene, View

OUTSIDE_RATE = 1 / 8  # of pieces that no view from the cell shows
ROUNDING = 0.2  # texels that float32 barycentrics may round by: pieces that would have smaller texels get larger ones
NOTES = {"moved_back": MOVED_BACK, "slender": SLENDER, "clipped": CLIPPED, "kept_bins": KEPT, "points": POINT}


@dataclass(frozen=True)
class Sampling:
    """How triangles are measured. rate: texels per pixel. fit: what shapes fit into."""

    rate: float
    fit: Fit

    def without_hysteresis(self) -> Sampling:
        """The same for triangles that do not keep their bins."""
        return replace(self, fit=self.fit.without_hysteresis())


@dataclass(frozen=True)
class SetFootprints:
    """Of a frame's set. noted: how many triangles have each of NOTES. areas: float64 (n) of the items, infinite of
    pieces, which dominate the screen. area: of all of them. Both in texels."""

    noted: dict[str, float]
    areas: Doubles
    area: float


class TriangleFootprints:
    """Measures triangles, and pieces of those that are sliced. measured: of all of them, kept from frame to frame."""

    def __init__(self, scene: ServerScene, prediction_frames: int, slicing: float) -> None:
        self.device, self.prediction_frames = scene.device, prediction_frames
        self.measured = Footprints.allocate(scene.device, scene.triangles.count + MOST)
        self.slicing = Slicing(scene.device, scene.triangles, slicing)

    def measure(
        self, frame: Frame, listed: TriangleList, sampling: Sampling, into: Footprints | None = None
    ) -> tuple[Bytes, Floats]:
        """Footprints of triangles: notes and areas (see measure_triangles)."""
        views = [(view.view, view.projection, view.width) for view in reference_views(frame, self.prediction_frames)]
        packed, into = pack_views(views, sampling.rate), into or self.measured
        return measure_triangles(self.device, listed, self.slicing.scene, packed, sampling.fit, into)

    def measure_set(
        self, frame: Frame, number: int, sampling: Sampling, left_out: Bools
    ) -> tuple[Items, SetFootprints]:
        """Footprints of the whole set; triangles that dominate the screen are sliced, and measured piece by piece.

        number: of the frame. left_out: what gets no slot, see Slicing.items.
        """
        pvs, slicing = frame.pvs, self.slicing
        notes, areas = self.measure(frame, TriangleList(frame.pvs_device, len(pvs)), sampling)
        slicing.slice(frame, number, pvs[(notes & MOVED_BACK) > 0], reference_views(frame, self.prediction_frames))
        items = slicing.items(frame, left_out)
        noted: dict[str, float] = {name: int(np.count_nonzero(notes & bit)) for name, bit in NOTES.items()}
        of_pieces, whole = self._measure_pieces(frame, slicing.pieces, sampling), areas[~slicing.is_sliced(pvs)]
        of_items = np.concatenate([whole, np.full(len(items.shown), np.inf)])
        return items, SetFootprints(noted, of_items, _total(whole) + _total(of_pieces))

    def measure_new(self, frame: Frame, new: Ints, listed: TriangleList, sampling: Sampling) -> float:
        """Footprints of new items, int32 (n), on the host and on the device, pieces last; their area in texels."""
        whole = new[new < self.slicing.first]
        _, areas = self.measure(frame, TriangleList(listed.ids, len(whole)), sampling)
        return _total(areas) + _total(self._measure_pieces(frame, new[len(whole) :], sampling))

    def _measure_pieces(self, frame: Frame, ids: Ints, sampling: Sampling) -> Floats:
        """Footprints of pieces, coarser where float32 barycentrics could not tell their texels apart; their areas."""
        slices, first, end = self.slicing.slices, self.slicing.first, self.slicing.first + len(self.slicing.pieces)
        rows = ids - first
        rates = np.where(slices.inside[rows], sampling.rate, sampling.rate * OUTSIDE_RATE)
        areas = self._measure_each(frame, ids, rates, sampling)
        if not len(ids):
            return areas
        lengths, words = (array[first:end].get()[rows] for array in (self.measured.lengths, self.measured.words))
        steps = texel_steps(slices.bary[rows], lengths, words)
        fine = steps > ROUNDING
        if fine.any():
            halvings = np.ceil(log2(steps[fine] / ROUNDING)).astype(int)
            areas[fine] = self._measure_each(frame, ids[fine], np.ldexp(rates[fine], -halvings), sampling)
        return areas

    def _measure_each(self, frame: Frame, ids: Ints, rates: Doubles, sampling: Sampling) -> Floats:
        """Measure pieces, each at its own rate, without hysteresis: areas."""
        areas, fit = np.zeros(len(ids), np.float32), sampling.fit.without_hysteresis()
        for rate in np.unique(rates):
            some = TriangleList.upload(self.device, ids[rates == rate])
            _, areas[rates == rate] = self.measure(frame, some, Sampling(float(rate), fit))
        return areas


def _total(areas: Floats) -> float:
    return float(areas.sum(dtype=np.float64))


def reference_views(frame: Frame, count: int) -> list[View]:
    """So many of the predicted client views, the last always among them, evenly spaced; without any, the server's."""
    predicted = frame.predicted
    count = min(count, len(predicted))
    if count == 0:
        return [frame.server]
    return [predicted[-(-len(predicted) * (k + 1) // count) - 1] for k in range(count)]
