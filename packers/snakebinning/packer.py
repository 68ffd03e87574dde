"""SnakeBinning: triangles of similar footprint one after the other in strips, strips in superblocks of the atlas.

See README.md in this folder for what is as published and what is ours.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kernels.snakebinning.bins import LARGEST_ATLAS, HeightBins
from kernels.snakebinning.count import BinCounts
from kernels.snakebinning.emit import emit_samples
from kernels.snakebinning.footprint import Fit, Footprints, measure_triangles, pack_views
from kernels.snakebinning.mapping import Mapping
from kernels.snakebinning.place import Places, list_records, place_triangles
from kernels.snakebinning.superblocks import Atlas, Superblocks
from packers.atlas_client import geometry_encoder
from packers.interface import Frame, Packer, Paper, Payload, ServerScene, View
from packers.snakebinning.client import FIELDS, SnakeBinningClient, encode_records
from packers.snakebinning.parameters import PARAMETERS

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
        self.placed_in = np.full(count, -1, np.int32)  # rebuild in which a triangle got its place
        self.rebuilds, self.rebuilt_pvs, self.frozen_frames = 0, np.empty(0, np.int32), 0
        self.resets, self.rate_step, self.since_mapping = 0, 0, 0
        self.blocks: Superblocks | None = None

    def pack(self, frame: Frame) -> Payload:
        """Slots for the triangles of the frame's set, and their shading."""
        device = frame.scene.device
        if self.blocks is None:
            self._begin(frame)
            self._reset(frame)
        elif not self._append(frame) and not self._rebuild(frame):
            self.resets += 1
            self._reset(frame)
        listed = (frame.pvs_device, len(frame.pvs))
        records = list_records(device, *listed, self.places, self.footprints)
        known = (self.places, self.blocks.strips, self.footprints, frame.scene.triangles, frame.atlas_width)
        samples = emit_samples(device, *listed, *known, self.full_footprint, self.enlarge)
        atlas = device.recycled((frame.atlas_height, frame.atlas_width, 4), np.uint8)
        device.fill(atlas.view(np.uint32), 0, "gather/clear")
        frame.scene.shader.shade(samples, eye=frame.server.eye, target=atlas, stage="gather/shade")
        return self._payload(frame, records, samples, atlas)

    def _begin(self, frame: Frame) -> None:
        """Set up for an atlas of this size."""
        width, height = frame.atlas_width, frame.atlas_height
        self.superblock = check_atlas(width, height, self.superblock_height)
        atlas = Atlas(width, height, self.superblock, 1 + self.capacity, self.shrink, self.collapse, self.enlarge)
        self.blocks = Superblocks(frame.scene.device, atlas)
        self.heights = HeightBins(float(self.superblock - 1), self.logarithmic)
        self.tops = frame.scene.device.upload(self.heights.tops())

    @property
    def rate(self) -> float:
        """Texels per pixel of the current frame."""
        return self.shading_rate * 2 ** (-self.rate_step / 8)

    def _append(self, frame: Frame) -> bool:
        """Add what is new to strips in which nothing moves; False if the set has changed too much for that."""
        changed = len(np.setxor1d(frame.pvs, self.rebuilt_pvs, assume_unique=True))
        if self.frozen_frames >= self.freeze_frames or changed >= self.freeze * len(self.rebuilt_pvs):
            return False
        new = frame.pvs[self.placed_in[frame.pvs] != self.rebuilds]
        self._measure(frame, frame.scene.device.upload(new), len(new), keep=self.hysteresis)
        if not self._place(frame, frame.scene.device.upload(new), len(new), frozen=True):
            return False
        self.placed_in[new] = self.rebuilds
        self.frozen_frames += 1
        self.since_mapping += 1
        return True

    def _rebuild(self, frame: Frame) -> bool:
        """Bins, mapping, superblocks and ranks of the whole set; False if the atlas has no room."""
        remap = 0 < self.remap_interval <= self.since_mapping
        if remap and self.rate_step > 0:
            return False
        if remap:
            self.mapper.reset()
            self.since_mapping = 0
        self._measure(frame, frame.pvs_device, len(frame.pvs), keep=self.hysteresis)
        return self._settle(frame)

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
        self._measure(frame, frame.pvs_device, len(frame.pvs), keep=False)
        return self._settle(frame)

    def _settle(self, frame: Frame) -> bool:
        """Place the whole set as measured; False if the atlas has no room for some."""
        if not self._place(frame, frame.pvs_device, len(frame.pvs), frozen=False) and self.rate_step < RATES - 1:
            return False
        self.rebuilds += 1
        self.placed_in[frame.pvs] = self.rebuilds
        self.rebuilt_pvs, self.frozen_frames = frame.pvs.copy(), 0
        self.since_mapping += 1
        return True

    def _measure(self, frame: Frame, triangles: Array, count: int, keep: bool) -> None:
        """Footprints of triangles; those within the hysteresis keep their bins if `keep`."""
        views = [(view.view, view.projection, view.width) for view in reference_views(frame, self.prediction_frames)]
        near = (30, 5) if keep else (-1, -1)
        fit = Fit(self.heights, float(frame.atlas_width - 2), self.perspective, *near)
        scene = frame.scene.triangles
        known = (scene.positions, scene.indices, pack_views(views, self.rate), fit, self.footprints)
        self.notes = measure_triangles(frame.scene.device, triangles, count, *known)

    def _place(self, frame: Frame, triangles: Array, count: int, frozen: bool) -> bool:
        """Bins, mapping, superblocks and ranks of measured triangles; False if there is no room."""
        device, bins = frame.scene.device, self.bins
        bins.count(triangles, count, self.footprints.bins, self.footprints.lengths)
        self.mapper.update(bins.used, bins.used_count, bins.counts)
        fits = self.blocks.update(bins, self.mapper.targets, self.tops, frozen)
        if fits or (not frozen and self.rate_step == RATES - 1):
            place_triangles(device, triangles, count, self.footprints, self.mapper.targets, self.blocks, self.places)
        return fits

    def _payload(self, frame: Frame, records: np.ndarray, samples: Samples, atlas: Array) -> Payload:
        places = encode_records(records, self.sent[frame.pvs])
        self.sent[frame.pvs] = records
        return Payload(
            planes={"atlas": atlas},
            blobs={"places": places},
            geometry=self.geometry.encode(frame.pvs),
            sample_count=samples.count,
            samples=samples,
            unplaced={int(triangle): UNPLACED for triangle in frame.pvs[records[:, 0] == 0]},
            statistics=self._statistics(frame),
        )

    def client(self, scene: ServerScene) -> SnakeBinningClient:
        """A client without any triangle yet."""
        return SnakeBinningClient(scene)

    def _statistics(self, frame: Frame) -> dict[str, float]:
        """What the report shows beyond the common columns."""
        numbers = self.blocks.numbers
        return {
            "shading_rate": self.rate,
            "resets": self.resets,
            "frozen_frames": self.frozen_frames,
            "bins": self.bins.used_count,
            "superblocks": numbers["superblocks"],
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
    chosen = superblock_height or height
    if not 2 <= chosen <= height:
        raise ValueError(
            f"The superblock height {chosen} is outside 2 to the atlas height {height}; 0 takes the latter."
        )
    return chosen
