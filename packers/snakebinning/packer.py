"""SnakeBinning: triangles of similar footprint one after the other in strips, strips in superblocks of the atlas.

See README.md in this folder for what is as published and what is ours.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kernels.snakebinning.bins import LARGEST_ATLAS, HeightBins
from kernels.snakebinning.clear import clear_strips
from kernels.snakebinning.count import BinCounts
from kernels.snakebinning.emit import emit_samples
from kernels.snakebinning.footprint import (
    CLIPPED,
    KEPT,
    MOVED_BACK,
    SLENDER,
    Fit,
    Footprints,
    measure_triangles,
    pack_views,
)
from kernels.snakebinning.mapping import Mapping
from kernels.snakebinning.place import Places, find_new, list_records, place_triangles
from kernels.snakebinning.superblocks import Atlas, Superblocks
from packers.atlas_client import geometry_encoder
from packers.interface import Frame, Packer, Paper, Payload, ServerScene, View
from packers.snakebinning.client import FIELDS, SnakeBinningClient, encode_records
from packers.snakebinning.parameters import PARAMETERS
from packers.snakebinning.picture import draw_packing

if TYPE_CHECKING:
    from pyopencl.array import Array

    from kernels.samples import Samples

RATES = 65  # shading rates tried: each is 2^(1/8) times smaller than the one before, down to 1/256
UNPLACED = "the atlas is full at 1/256 of the shading rate"


class SnakeBinning(Packer):
    """Packs triangles into strips; see the module."""

    name = "snakebinning"
    paper = Paper(
        "SnakeBinning: Efficient Temporally Coherent Triangle Packing for Shading Streaming", 2021, "10.1111/cgf.142648"
    )
    parameters = PARAMETERS

    def prepare(self, scene: ServerScene) -> None:
        """Allocate what is kept per triangle."""
        count = scene.triangles.count
        self.footprints = Footprints.allocate(scene.device, count)
        self.places = Places.allocate(scene.device, count)
        self.bins = BinCounts(scene.device)
        self.mapper = Mapping(scene.device, self.mapping, self.sink)
        self.geometry = geometry_encoder(scene, {})
        self.sent = np.zeros((count, FIELDS), np.uint32)
        self.frame = self.rebuilt = self.frozen_frames = 0
        self.rebuilt_area = self.added_area = 0.0  # texels, at the last rebuild and since then
        self.resets, self.rate_step, self.since_mapping = 0, 0, 0
        self.blocks: Superblocks | None = None

    def pack(self, frame: Frame) -> Payload:
        """Slots for the triangles of the frame's set, and their shading."""
        device = frame.scene.device
        self.frame += 1
        if self.blocks is None:
            self._begin(frame)
            self._reset(frame)
        elif not self._append(frame) and not self._rebuild(frame):
            self.resets += 1
            self._reset(frame)
        listed = (frame.pvs_device, len(frame.pvs))
        records, cuts = list_records(device, *listed, self.places, self.footprints, self.blocks.strips)
        known = (self.places, self.blocks.strips, self.footprints, frame.scene.triangles, frame.atlas_width)
        samples = emit_samples(device, *listed, *known, self.full_footprint, self.enlarge)
        atlas = device.recycled((frame.atlas_height, frame.atlas_width, 4), np.uint8)
        device.fill(atlas.view(np.uint32), 0, "gather/clear")
        frame.scene.shader.shade(samples, eye=frame.server.eye, target=atlas, stage="gather/shade")
        if self.average_clear:
            clear_strips(device, self.blocks, atlas)
        return self._payload(frame, records, cuts, samples, atlas)

    def _begin(self, frame: Frame) -> None:
        """Set up for an atlas of this size."""
        width, height = frame.atlas_width, frame.atlas_height
        self.superblock = check_atlas(width, height, self.superblock_height)
        rules = (1 + self.capacity, self.shrink, self.collapse, self.enlarge, self.assignment)
        atlas = Atlas(width, height, self.superblock, *rules)
        self.blocks = Superblocks(frame.scene.device, atlas)
        self.heights = HeightBins(float(self.superblock - 1), self.logarithmic)
        self.tops = frame.scene.device.upload(self.heights.tops())

    @property
    def rate(self) -> float:
        """Texels per pixel of the current frame."""
        return self.shading_rate * 2 ** (-self.rate_step / 8)

    def _append(self, frame: Frame) -> bool:
        """Add what is new to strips in which nothing moves; False if the set has changed too much for that."""
        if self.frozen_frames >= self.freeze_frames or self.freeze <= 0 or self._remap_is_due():
            return False
        listed = (frame.pvs_device, len(frame.pvs))
        is_new = find_new(frame.scene.device, *listed, self.rebuilt, self.places, self.blocks.strips)
        new = frame.pvs[is_new.get()[: len(frame.pvs)] > 0]
        uploaded = frame.scene.device.upload(new)
        self.added_area += self._measure(frame, uploaded, len(new), keep=self.hysteresis)
        if self.added_area >= self.freeze * self.rebuilt_area or not self._place(frame, is_new, uploaded, len(new)):
            return False
        self.frozen_frames += 1
        self.since_mapping += 1
        return True

    def _rebuild(self, frame: Frame) -> bool:
        """Bins, mapping, superblocks and ranks of the whole set; False if the atlas has no room."""
        if self._remap_is_due():
            if self.rate_step > 0:
                return False
            self.mapper.reset()
            self.since_mapping = 0
        self.rebuilt_area = self._measure(frame, frame.pvs_device, len(frame.pvs), keep=self.hysteresis)
        return self._settle(frame)

    def _remap_is_due(self) -> bool:
        return 0 < self.remap_interval <= self.since_mapping

    def _reset(self, frame: Frame) -> None:
        """Empty the atlas, and fill it at the largest shading rate at which everything has a place."""
        self.since_mapping = 0
        if self._fits(frame, 0):
            return
        low, high = 0, RATES  # too large; small enough, where beyond the last step everything counts as that
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if self._fits(frame, middle) else (middle, high)
        if self.rate_step != high:
            self._fits(frame, min(high, RATES - 1))

    def _fits(self, frame: Frame, step: int) -> bool:
        """Fill an empty atlas at one shading rate."""
        self.rate_step = step
        self.mapper.reset()
        self.blocks.reset()
        self.rebuilt_area = self._measure(frame, frame.pvs_device, len(frame.pvs), keep=False)
        return self._settle(frame)

    def _settle(self, frame: Frame) -> bool:
        """Place the whole set as measured; False if the atlas has no room for some."""
        self.rebuilt = self.frame
        is_new = frame.scene.device.recycled(len(frame.pvs), np.uint8)  # all strips move, so it says nothing
        if not self._place(frame, is_new) and self.rate_step < RATES - 1:
            return False
        self.added_area, self.frozen_frames, self.rebuilt_bins = 0.0, 0, self.bins.used_count
        notes = {"moved_back": MOVED_BACK, "slender": SLENDER, "clipped": CLIPPED, "kept_bins": KEPT}
        self.noted = {name: int(np.count_nonzero(self.notes & bit)) for name, bit in notes.items()}
        self.since_mapping += 1
        return True

    def _measure(self, frame: Frame, triangles: Array, count: int, keep: bool) -> float:
        """Footprints of triangles, and their area; those within the hysteresis keep their bins if `keep`."""
        views = [(view.view, view.projection, view.width) for view in reference_views(frame, self.prediction_frames)]
        near = (30, 5) if keep else (-1, -1)
        fit = Fit(self.heights, float(frame.atlas_width - 2), self.perspective, *near)
        scene = frame.scene.triangles
        known = (scene.positions, scene.indices, pack_views(views, self.rate), fit, self.footprints)
        self.notes, areas = measure_triangles(frame.scene.device, triangles, count, *known)
        return float(areas.sum(dtype=np.float64))

    def _place(self, frame: Frame, is_new: Array, new: Array | None = None, count: int = 0) -> bool:
        """Bins, mapping, superblocks and ranks of the set, or of `new` triangles in it; False if there is no room."""
        device, bins, frozen = frame.scene.device, self.bins, new is not None
        listed = (new, count) if frozen else (frame.pvs_device, len(frame.pvs))
        bins.count(*listed, self.footprints.bins, self.footprints.lengths)
        self.mapper.update(bins.used, bins.used_count, bins.counts)
        fits = self.blocks.update(self.frame, bins, self.mapper.targets, self.tops, frozen)
        if fits or (not frozen and self.rate_step == RATES - 1):
            known = (is_new, self.footprints, self.mapper.targets, self.blocks, self.places)
            place_triangles(device, self.frame, frame.pvs_device, len(frame.pvs), *known)
        return fits

    def _payload(self, frame: Frame, records: np.ndarray, cuts: np.ndarray, samples: Samples, atlas: Array) -> Payload:
        before = self.sent[frame.pvs]
        places = encode_records(records, before)
        self.sent[frame.pvs] = records
        moved = int(np.count_nonzero((before[:, 0] != records[:, 0]) & (before[:, 0] > 0)))
        mapped = cuts[cuts >= 0]
        statistics = self._statistics(samples.count) | {
            "triangles_moved": moved,
            "mapped_triangles": len(mapped),
            "mapping_distortion": float(mapped.mean(dtype=np.float64)) if len(mapped) else 0.0,
        }
        return Payload(
            planes={"atlas": atlas},
            blobs={"places": places},
            geometry=self.geometry.encode(frame.pvs),
            sample_count=samples.count,
            samples=samples,
            unplaced={int(triangle): UNPLACED for triangle in frame.pvs[records[:, 0] == 0]},
            statistics=statistics,
        )

    def pictures(self, payload: Payload) -> dict[str, np.ndarray]:
        """The packing: superblocks, strips and slots in colours."""
        owner = np.full(payload.planes["atlas"].shape[:2], -1, np.int32)
        found = self.owners(payload)
        owner.reshape(-1)[found.texel] = found.triangle
        return {
            "packing": draw_packing(self.blocks.live_strips(), self.blocks.live_superblocks(), self.superblock, owner)
        }

    def client(self, scene: ServerScene) -> SnakeBinningClient:
        """A client without any triangle yet."""
        return SnakeBinningClient(scene)

    def _statistics(self, samples: int) -> dict[str, float]:
        """What the report shows beyond the common columns; of the last frame that was not frozen where that is all."""
        numbers, strips, blocks = self.blocks.numbers, self.blocks.live_strips(), self.blocks.live_superblocks()
        placed = strips[strips["superblock"] >= 0]
        rows = placed["rows"].astype(np.int64)
        slots = int((rows * placed["per_row"] * placed["texels"]).sum())
        in_rows = int((rows * placed["lines"] * blocks["width"][placed["superblock"]]).sum())
        in_superblocks = int(blocks["width"].sum()) * self.superblock
        atlas = self.blocks.atlas
        return self.noted | {
            "shading_rate": self.rate,
            "bins_before_mapping": self.rebuilt_bins,
            "bins_after_mapping": len(strips),
            "sinks": int(np.count_nonzero(strips["count"] > self.sink)),
            "superblocks": len(blocks),
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
    chosen = superblock_height or min(height, max(512, height // 4))
    if not 2 <= chosen <= height:
        raise ValueError(f"The superblock height {chosen} is outside 2 to the atlas height {height}; 0 chooses one.")
    return chosen
