"""SnakeBinning: triangles of similar footprint one after the other in strips, strips in superblocks of the atlas.

See README.md in this folder for what is as published and what is ours.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.functions import log2
from shading_atlas_bench.packers.atlas_client import geometry_encoder
from shading_atlas_bench.packers.budget import BudgetedRate
from shading_atlas_bench.packers.interface import (
    FULL,
    ClientScene,
    Frame,
    Packer,
    Paper,
    Payload,
    RareCost,
    ServerScene,
    View,
)
from shading_atlas_bench.packers.snakebinning.client import FIELDS, SnakeBinningClient, encode_pieces, encode_records
from shading_atlas_bench.packers.snakebinning.kernels.bins import LARGEST_ATLAS, HeightBins
from shading_atlas_bench.packers.snakebinning.kernels.clear import clear_strips
from shading_atlas_bench.packers.snakebinning.kernels.count import BinCounts
from shading_atlas_bench.packers.snakebinning.kernels.emit import emit_samples
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
from shading_atlas_bench.packers.snakebinning.kernels.mapping import Mapping
from shading_atlas_bench.packers.snakebinning.kernels.place import Places, find_new, list_records, place_triangles
from shading_atlas_bench.packers.snakebinning.kernels.slices import (
    MOST,
    Slices,
    screen_shares,
    slice_dominating,
    texel_steps,
)
from shading_atlas_bench.packers.snakebinning.kernels.superblocks import Atlas, Superblocks
from shading_atlas_bench.packers.snakebinning.parameters import PARAMETERS
from shading_atlas_bench.packers.snakebinning.picture import draw_packing

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.samples import Samples

STEPS = 66  # ways to fill the atlas, from full rate on: see SnakeBinning.rate and its neighbours
TIGHT_SPARE = 0.1  # largest `capacity` from the second step on; at the last there is none
POINT_TEXELS = 2.0  # longest edge of a triangle below which it takes one texel, where texels are short
OUTSIDE_RATE = 1 / 8  # of pieces that no view from the cell shows
ROUNDING = 0.2  # texels that float32 barycentrics may round by: pieces that would have smaller texels get larger ones
UNPLACED = "the atlas is full with every triangle at one texel, and larger ones come first"


class SnakeBinning(Packer):
    """Packs triangles into strips; see the module."""

    name = "snakebinning"
    paper = Paper(
        "SnakeBinning: Efficient Temporally Coherent Triangle Packing for Shading Streaming", 2021, "10.1111/cgf.142648"
    )
    parameters = PARAMETERS
    skips = {  # noqa: RUF012
        "bin mapping": ("the search for sinks", "no new bin is sparse", "new bins are sparse"),
        "re-binning": ("footprints and bins of the whole set", "the layout is frozen", "the layout is rebuilt"),
    }

    def prepare(self, scene: ServerScene) -> None:
        """Allocate what is kept per triangle."""
        count = scene.triangles.count
        self.footprints = Footprints.allocate(scene.device, count + MOST)
        self.places = Places.allocate(scene.device, count + MOST)
        self.slices, self.sliced_at = Slices(), -1
        self.pieces = (count, self.slices.upload(scene.device))
        self.bins = BinCounts(scene.device)
        self.mapper = Mapping(scene.device, self.mapping, self.sink)
        self.geometry = geometry_encoder(scene, {})
        self.sent = np.zeros((count, FIELDS), np.uint32)
        self.shown = np.empty(0, np.int32)  # the last frame's set
        self.frame = self.rebuilt = self.frozen_frames = 0
        self.rebuilt_area = self.added_area = 0.0  # texels, at the last rebuild and since then
        self.rebuilds = self.remappings = self.resets = 0
        self.step = self.mapped_at = 0
        self.budgeted = BudgetedRate(self.shading_rate)
        self.left_out = np.zeros(count + MOST, bool)  # triangles and pieces for which the atlas is too small
        self.blocks: Superblocks | None = None

    def rare_costs(self) -> tuple[RareCost, ...]:
        """A rebuild measures and ranks the whole set, a new mapping empties all bins, a reset tries shading rates."""
        found = [RareCost("an atlas reset", "when the atlas is full or the samples leave their budget", "resets")]
        if self.remap_interval > 0 and self.mapping != "off":
            when = f"after {self.remap_interval} frames at the latest"
            found.append(RareCost("a new mapping of all bins", when, "remappings", self.remap_interval + 1))
        if self.freeze > 0:
            when = f"after {self.freeze_frames} frozen frames at the latest"
            found.append(RareCost("a rebuild of the layout", when, "rebuilds", self.freeze_frames + 2))
        return tuple(found)

    def pack(self, frame: Frame) -> Payload:
        """Slots for the triangles of the frame's set, and their shading."""
        device, resets = frame.scene.device, self.resets
        self.frame += 1
        if self.blocks is None:
            self._begin(frame)
            self._reset(frame)
        elif not self._append(frame):
            self.rebuilds += 1
            if not self._rebuild(frame):
                self.resets += 1
                self._reset(frame)
        samples = self._emit_within_budget(frame, resets)
        records, cuts = list_records(device, *self.items, self.places, self.footprints, self.blocks.strips)
        planes = frame.shade(samples)
        if self.average_clear:
            clear_strips(device, self.blocks, planes["atlas"])
        return self._payload(frame, records, cuts, samples, planes)

    def _emit_within_budget(self, frame: Frame, resets: int) -> Samples:
        """The samples of the layout; where they are not as many as the frame's budget has, of one at another rate.

        resets: before this frame.
        """
        samples, budget = self._emit(frame), frame.sample_budget
        if budget is None:
            return samples
        lowered = self.step > 1  # so that they are not those of the rate asked for
        known = not lowered or self.budgeted.reached is not None
        if known and self.budgeted.keeps(budget, samples.count):
            return samples

        def at(rate: float) -> int | None:
            nonlocal samples
            self.budgeted.rate = rate
            if not (self._fits(frame, 0) or self._fits(frame, 1)):
                return None
            samples = self._emit(frame)
            return samples.count

        self.resets = resets + (self.frame > 1)
        if not self.budgeted.meet(budget, at, None if lowered else samples.count):
            self._reset(frame)
            samples = self._emit(frame)
            self.budgeted.reached = samples.count
        return samples

    def _emit(self, frame: Frame) -> Samples:
        known = (self.places, self.blocks.strips, self.footprints, frame.scene.triangles, self.pieces)
        known += (frame.atlas_width, self.full_footprint, self.enlarge)
        return emit_samples(frame.scene.device, *self.items, *known)

    def _begin(self, frame: Frame) -> None:
        """Set up for an atlas."""
        width, height = frame.atlas_width, frame.atlas_height
        self.superblock = check_atlas(width, height, self.superblock_height)
        self.blocks = Superblocks(frame.scene.device, self._atlas(frame))
        self.heights = HeightBins(float(self.superblock - 1), self.logarithmic)
        self.tops = frame.scene.device.upload(self.heights.tops())

    def _atlas(self, frame: Frame) -> Atlas:
        """The atlas at the present step: from the second on nothing is wasted for coherence."""
        tight = self.step > 0
        rules = (self.shrink, self.collapse, self.enlarge, "tight" if tight else self.assignment, self.orphans)
        capacity = 1 + (min(TIGHT_SPARE, self.capacity) if tight else self.capacity) * (self.step < STEPS - 1)
        return Atlas(frame.atlas_width, frame.atlas_height, self.superblock, capacity, *rules)

    @property
    def leaves_unwritten(self) -> bool:
        """The paper's enlargement does."""
        return self.enlarge == "paper"

    @property
    def rate(self) -> float:
        """Texels per pixel: all of them at the first two steps, and 2^(1/8) times fewer at each one further."""
        return self.budgeted.rate * 2 ** (-max(self.step - 1, 0) / 8)

    def _append(self, frame: Frame) -> bool:
        """Add what is new to strips in which nothing moves; False if the set has changed too much for that."""
        if self.frozen_frames >= self.freeze_frames or self.freeze <= 0 or self._remap_is_due():
            return False
        coarse = self.slices.corners[~self.slices.inside]
        if (screen_shares(coarse, frame.server.matrix) > 0).any():
            return False
        ids = self._list_items(frame)
        is_new = find_new(frame.scene.device, *self.items, self.rebuilt, self.places, self.blocks.strips)
        new = ids[is_new.get()[: len(ids)] > 0]
        whole, uploaded = new[new < self.pieces[0]], frame.scene.device.upload(new)
        _, areas = self._measure(frame, uploaded, len(whole), self.rate, keep=self.hysteresis)
        of_pieces = self._measure_pieces(frame, new[len(whole) :])
        self.added_area += float(areas.sum(dtype=np.float64)) + float(of_pieces.sum(dtype=np.float64))
        if self.added_area >= self.freeze * self.rebuilt_area:
            return False
        if self.left_out.any():
            self.left_out[new] = True
            self._list_items(frame)
        elif not self._place(frame, is_new, (uploaded, len(new))):
            return False
        if not frame.scene.skips.leaves_out("re-binning", True):
            self._bin_in_vain(frame)
        self.frozen_frames += 1
        return True

    def _bin_in_vain(self, frame: Frame) -> None:
        """What a frozen layout saves: footprints and bins of the whole set, which nobody reads."""
        device, count = frame.scene.device, len(frame.pvs)
        spare, bins = Footprints.allocate(device, self.pieces[0] + MOST), BinCounts(device)
        self._measure(frame, frame.pvs_device, count, self.rate, keep=False, footprints=spare)
        bins.count(frame.pvs_device, count, spare.bins, spare.lengths)

    def _rebuild(self, frame: Frame) -> bool:
        """Bins, mapping, superblocks and ranks of the whole set; False if the atlas has or had no room for some."""
        if self.left_out.any() or (self.step > 0 and self._remap_is_due()):
            return False
        if self._remap_is_due():
            self.mapper.reset()
            self.remappings += 1
            self.mapped_at = self.frame
        self._measure_set(frame, keep=self.hysteresis)
        return self._settle(frame)

    def _remap_is_due(self) -> bool:
        return 0 < self.remap_interval <= self.frame - self.mapped_at

    def _reset(self, frame: Frame) -> None:
        """Empty the atlas, and fill it at the first step at which everything has a place; without one, with what fits.

        Looked for from the present step on, in growing strides, because the sets of neighbouring frames need about the
        same; on to higher rates only where a reset was due, not where the room ran out. Where it did so soon after the
        last time, the step leaves no room for what comes, and the next one is taken.
        """
        is_due = self.left_out.any() or self._remap_is_due()
        is_soon = self.mapped_at > 0 and self.frame - self.mapped_at <= self.freeze_frames and self.step < STEPS - 1
        low = -1 if is_due else self.step - (not is_soon)  # not everything has a place there
        high, step, stride = STEPS, max(self.step, low + 1), 1  # at high it has
        while low + 1 < high:
            low, high = (low, step) if self._fits(frame, step) else (step, high)
            further = high - stride if step == high else low + stride
            step, stride = further if low < further < high else (low + high) // 2, 2 * stride
        if high == STEPS:
            self._choose(frame)
        elif high != self.step:
            self._fits(frame, high)

    def _fits(self, frame: Frame, step: int) -> bool:
        """Fill an empty atlas at one step; whether everything has a place."""
        self.step, self.mapped_at = step, self.frame
        self.left_out[:] = False
        self._empty(frame)
        self._measure_set(frame, keep=False)
        return self._settle(frame)

    def _empty(self, frame: Frame) -> None:
        self.mapper.reset()
        self.blocks.reset(self._atlas(frame))

    def _choose(self, frame: Frame) -> None:
        """Fill an atlas that is too small with as many triangles as it holds, the largest on the screen first."""
        ids = self._list_items(frame)
        order, most = np.lexsort((ids, -self.item_areas)), len(ids)
        while self.blocks.numbers["left"]:
            most -= self.blocks.numbers["left"]
            self.left_out[ids[order[most:]]] = True
            self._list_items(frame)
            self._empty(frame)
            self._settle(frame)

    def _settle(self, frame: Frame) -> bool:
        """Place the whole set as measured; False if the atlas has no room for some."""
        self.rebuilt = self.frame
        is_new = frame.scene.device.recycled(self.items[1], np.uint8)  # all strips move, so it says nothing
        if not self._place(frame, is_new):
            return False
        self.added_area, self.frozen_frames, self.rebuilt_bins = 0.0, 0, self.bins.used_count
        return True

    def _measure_set(self, frame: Frame, keep: bool) -> None:
        """Footprints of the whole set; triangles that dominate the screen are sliced, and measured piece by piece."""
        notes, areas = self._measure(frame, frame.pvs_device, len(frame.pvs), self.rate, keep)
        if self.sliced_at != self.frame:
            self.sliced_at = self.frame
            self._slice(frame, frame.pvs[(notes & MOVED_BACK) > 0])
        self._list_items(frame)
        named = {"moved_back": MOVED_BACK, "slender": SLENDER, "clipped": CLIPPED, "kept_bins": KEPT, "points": POINT}
        self.noted = {name: int(np.count_nonzero(notes & bit)) for name, bit in named.items()}
        everything = self.pieces[0] + np.arange(len(self.slices.parents), dtype=np.int32)
        of_pieces, whole = self._measure_pieces(frame, everything), ~np.isin(frame.pvs, self.slices.parents)
        self.item_areas = np.concatenate([areas[whole], np.full(len(self.shown_pieces), np.inf)])  # pieces dominate
        self.rebuilt_area = float(areas[whole].sum(dtype=np.float64)) + float(of_pieces.sum(dtype=np.float64))

    def _measure_pieces(self, frame: Frame, ids: np.ndarray) -> np.ndarray:
        """Footprints of pieces, coarser where float32 barycentrics could not tell their texels apart; their areas."""
        rows = ids - self.pieces[0]
        rates = np.where(self.slices.inside[rows], self.rate, self.rate * OUTSIDE_RATE)
        areas = self._measure_each(frame, ids, rates)
        if not len(ids):
            return areas
        end = self.pieces[0] + len(self.slices.parents)
        measured = (a[self.pieces[0] : end].get()[rows] for a in (self.footprints.lengths, self.footprints.words))
        steps = texel_steps(self.slices.bary[rows], *measured)
        fine = steps > ROUNDING
        if fine.any():
            halvings = np.ceil(log2(steps[fine] / ROUNDING)).astype(int)
            areas[fine] = self._measure_each(frame, ids[fine], np.ldexp(rates[fine], -halvings))
        return areas

    def _measure_each(self, frame: Frame, ids: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """Measure pieces, each at its own rate, without hysteresis: areas."""
        areas = np.zeros(len(ids), np.float32)
        for rate in np.unique(rates):
            some = ids[rates == rate]
            _, areas[rates == rate] = self._measure(frame, frame.scene.device.upload(some), len(some), rate, keep=False)
        return areas

    def _slice(self, frame: Frame, candidates: np.ndarray) -> None:
        """Choose what to slice, among triangles that leave the screen of a camera turned to them."""
        triangles = frame.scene.triangles
        corners = triangles.host_positions[triangles.host_indices[candidates]].astype(np.float64)
        clients = [view.matrix for view in reference_views(frame, self.prediction_frames)]
        known = (clients, frame.server.matrix, frame.cell_radius)
        before = len(self.slices.parents)
        self.slices = slice_dominating(candidates, corners, *known, self.slicing) if self.slicing > 0 else Slices()
        if before or len(self.slices.parents):
            self.pieces = (triangles.count, self.slices.upload(frame.scene.device))

    def _list_items(self, frame: Frame) -> np.ndarray:
        """What gets slots in this frame: the triangles of the set that are not sliced, and the pieces of the others,
        without those that are left out."""
        self.shown_pieces = np.flatnonzero(np.isin(self.slices.parents, frame.pvs))
        if not len(self.shown_pieces) and not self.left_out.any():
            self.items = (frame.pvs_device, len(frame.pvs))
            return frame.pvs
        whole = frame.pvs[~np.isin(frame.pvs, self.slices.parents)]
        ids = np.concatenate([whole, self.pieces[0] + self.shown_pieces.astype(np.int32)])
        ids = ids[~self.left_out[ids]]
        self.items = (frame.scene.device.upload(ids), len(ids))
        return ids

    def _measure(
        self,
        frame: Frame,
        triangles: Array,
        count: int,
        rate: float,
        keep: bool,
        footprints: Footprints | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Footprints of triangles: notes and areas; those within the hysteresis keep their bins if `keep`."""
        views = [(view.view, view.projection, view.width) for view in reference_views(frame, self.prediction_frames)]
        near = (30, 5) if keep else (-1, -1)
        fit = Fit(
            self.heights, float(frame.atlas_width - 2), self.perspective, *near, POINT_TEXELS * self._has_points(frame)
        )
        scene = frame.scene.triangles
        known = (scene.positions, scene.indices, self.pieces, pack_views(views, rate), fit)
        known += (footprints or self.footprints,)
        return measure_triangles(frame.scene.device, triangles, count, *known)

    def _has_points(self, frame: Frame) -> bool:
        """Whether texels are so short that small triangles take one."""
        return self.points and (self.step > 0 or frame.sample_budget is not None)

    def _place(self, frame: Frame, is_new: Array, new: tuple[Array, int] | None = None) -> bool:
        """Bins, mapping, superblocks and ranks of all items, or of `new` ones among them; False if there is no room."""
        device, bins, frozen = frame.scene.device, self.bins, new is not None
        bins.count(*(new or self.items), self.footprints.bins, self.footprints.lengths)
        skips = frame.scene.skips
        sparse = self.mapper.update(bins.used, bins.used_count, bins.counts, always="bin mapping" in skips.off)
        skips.leaves_out("bin mapping", not sparse)
        fits = self.blocks.update(self.frame, bins, self.mapper.targets, self.tops, frozen)
        if fits:
            known = (is_new, self.footprints, self.mapper.targets, self.blocks, self.places)
            place_triangles(device, self.frame, *self.items, *known)
        return fits

    def _payload(
        self, frame: Frame, listed: np.ndarray, cuts: np.ndarray, samples: Samples, planes: dict[str, Array]
    ) -> Payload:
        """listed: records of the items."""
        slices, shown = self.slices, self.shown_pieces
        is_sliced = np.isin(frame.pvs, slices.parents[shown])
        is_listed = ~is_sliced & ~self.left_out[frame.pvs]
        whole, of_pieces = np.count_nonzero(is_listed), np.zeros((len(shown), FIELDS), np.uint32)
        of_pieces[~self.left_out[self.pieces[0] + shown]] = listed[whole:]
        lost = np.unique(slices.parents[shown][of_pieces[:, 0] == 0])  # a triangle is there as a whole, or not at all
        sent = ~np.isin(slices.parents[shown], lost)
        records = np.zeros((len(frame.pvs), FIELDS), np.uint32)
        records[is_listed] = listed[:whole]
        before = self.sent[frame.pvs]
        places = encode_records(records, before)
        self.sent[frame.pvs] = records
        stayed = np.isin(frame.pvs, self.shown) & (before[:, 0] > 0) & (records[:, 0] > 0)
        self.shown = frame.pvs
        moved = int(np.count_nonzero(stayed & (before[:, 0] != records[:, 0])))
        mapped = cuts[cuts >= 0]
        statistics = self._statistics(samples.count) | {
            "triangles_moved": moved,
            "mapped_triangles": len(mapped),
            "mapping_distortion": float(mapped.mean(dtype=np.float64)) if len(mapped) else 0.0,
            "sliced": int(np.count_nonzero(is_sliced)),
            "pieces": len(shown),
        }
        missing = np.concatenate([frame.pvs[~is_sliced & (records[:, 0] == 0)], lost])
        of_piece = (slices.parents[shown][sent], slices.bary[shown][sent][:, :, 1:], of_pieces[sent])
        return Payload(
            planes=planes,
            blobs={"places": places, "pieces": encode_pieces(*of_piece)},
            geometry=self.geometry.encode(frame.pvs),
            sample_count=samples.count,
            samples=samples,
            unplaced={int(triangle): UNPLACED for triangle in missing},
            statistics=statistics,
        )

    def pictures(self, payload: Payload) -> dict[str, np.ndarray]:
        """The packing: superblocks, strips and slots in colours."""
        owner = np.full(payload.planes["atlas"].shape[:2], -1, np.int32)
        found = payload.owners()
        owner.reshape(-1)[found.texel] = found.triangle
        return {"packing": draw_packing(self.blocks.live_strips(), self.blocks.live_superblocks(), owner)}

    def client(self, scene: ClientScene) -> SnakeBinningClient:
        """A client without any triangle yet."""
        return SnakeBinningClient(scene)

    def _statistics(self, samples: int) -> dict[str, float]:
        """What the report shows beyond the common columns; of the last frame that was not frozen where that is all."""
        numbers, strips, blocks = self.blocks.numbers, self.blocks.live_strips(), self.blocks.live_superblocks()
        placed = strips[strips["superblock"] >= 0]
        rows = placed["rows"].astype(np.int64)
        slots = int((rows * placed["per_row"] * placed["texels"]).sum())
        in_rows = int((rows * placed["lines"] * blocks["width"][placed["superblock"]]).sum())
        in_superblocks = int((blocks["width"].astype(np.int64) * blocks["height"]).sum())
        atlas = self.blocks.atlas
        sinks = int(np.count_nonzero(strips["count"] > self.sink))
        return self.noted | {
            "shading_rate": self.rate,
            FULL: int(self.step > 0),
            "bins_before_mapping": self.rebuilt_bins,
            "bins_after_mapping": int(np.count_nonzero(strips["count"])),
            "sinks": sinks,
            "sources": max(0, self.rebuilt_bins - sinks),
            "superblocks": len(blocks),
            "rebuilds": self.rebuilds,
            "remappings": self.remappings + self.resets,
            "resets": self.resets,
            "collapsed": numbers["collapsed"],
            "outgrown": numbers["outgrown"],
            "shrunk": numbers["shrunk"],
            "frozen_frames": self.frozen_frames,
            "wasted_in_slots": slots - samples,
            "wasted_row_ends": in_rows - slots,
            "wasted_in_superblocks": in_superblocks - in_rows,
            "unallocated": atlas.width * atlas.lines - in_superblocks,
        }


def reference_views(frame: Frame, count: int) -> list[View]:
    """So many of the predicted client views, the last always among them, evenly spaced; without any, the server's."""
    predicted = frame.predicted
    count = min(count, len(predicted))
    if count == 0:
        return [frame.server]
    return [predicted[-(-len(predicted) * (k + 1) // count) - 1] for k in range(count)]


def check_atlas(width: int, height: int, superblock_height: int) -> int:
    """The height of superblocks in an atlas; ValueError for sizes that cannot be used."""
    if max(width, height) > LARGEST_ATLAS or min(width, height) < 2:
        raise ValueError(
            f"The atlas of {width}x{height} has a side outside 2 to {LARGEST_ATLAS} texels: give another size."
        )
    chosen = superblock_height or height // max(1, height // max(512, height // 4))
    if not 2 <= chosen <= height:
        raise ValueError(f"The superblock height {chosen} is outside 2 to the atlas height {height}; 0 chooses one.")
    return chosen
