"""SnakeBinning: triangles of similar footprint one after the other in strips, strips in superblocks of the atlas.

See README.md in this folder for what is as published and what is ours, and for the file of each section of the paper.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np

from shading_atlas_bench.packers.atlas_client import geometry_encoder
from shading_atlas_bench.packers.budget import BudgetedRate
from shading_atlas_bench.packers.interface import ClientScene, Frame, Packer, Paper, Payload, RareCost, ServerScene
from shading_atlas_bench.packers.snakebinning.client import SnakeBinningClient
from shading_atlas_bench.packers.snakebinning.filling import Filling
from shading_atlas_bench.packers.snakebinning.footprint import TriangleFootprints
from shading_atlas_bench.packers.snakebinning.freezing import Freezing
from shading_atlas_bench.packers.snakebinning.gathering import gather
from shading_atlas_bench.packers.snakebinning.kernels.bins import HeightBins
from shading_atlas_bench.packers.snakebinning.kernels.clear import clear_strips
from shading_atlas_bench.packers.snakebinning.kernels.count import BinCounts
from shading_atlas_bench.packers.snakebinning.kernels.emit import Blowup
from shading_atlas_bench.packers.snakebinning.kernels.footprint import Fit, Footprints
from shading_atlas_bench.packers.snakebinning.kernels.pieces import TriangleList
from shading_atlas_bench.packers.snakebinning.kernels.place import Placement, Places, list_records
from shading_atlas_bench.packers.snakebinning.kernels.slices import MOST
from shading_atlas_bench.packers.snakebinning.kernels.superblocks import Atlas, Superblocks, superblock_height
from shading_atlas_bench.packers.snakebinning.mapping import BinMapping
from shading_atlas_bench.packers.snakebinning.parameters import PARAMETERS, Parameters
from shading_atlas_bench.packers.snakebinning.picture import draw_packing
from shading_atlas_bench.packers.snakebinning.records import Records, SetRecords
from shading_atlas_bench.packers.snakebinning.slots import Slots
from shading_atlas_bench.packers.snakebinning.statistics import statistics_of

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic.arrays import Bytes, Floats
    from shading_atlas_bench.kernels.samples import Samples

UNPLACED = "the atlas is full with every triangle at one texel, and larger ones come first"


class SnakeBinning(Parameters, Packer):
    """Packs triangles into strips; see the module."""

    name = "snakebinning"
    paper = Paper(
        "SnakeBinning: Efficient Temporally Coherent Triangle Packing for Shading Streaming", 2021, "10.1111/cgf.142648"
    )
    parameters = PARAMETERS
    skips: ClassVar[dict[str, tuple[str, str, str]]] = {
        "bin mapping": ("the search for sinks", "no new bin is sparse", "new bins are sparse"),
        "re-binning": ("footprints and bins of the whole set", "the layout is frozen", "the layout is rebuilt"),
    }

    def prepare(self, scene: ServerScene) -> None:
        """Allocate what is kept per triangle."""
        device, count = scene.device, scene.triangles.count
        self.footprints = TriangleFootprints(scene, self.prediction_frames, self.slicing)  # section 3.1
        self.places = Places.allocate(device, count + MOST)  # 3.3
        self.bins = BinCounts(device)  # 3.2
        self.bin_mapping = BinMapping(device, self.mapping, self.sink, self.remap_interval)  # 3.4
        self.filling: Filling | None = None  # 3.5, from the first frame on, whose atlas it fills
        self.freezing = Freezing(self.freeze, self.freeze_frames)  # 3.6
        self.geometry = geometry_encoder(scene, {})
        self.records = Records(count)  # 3.9
        self.shown = np.empty(0, np.int32)  # the last frame's set

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
        """Slots for the triangles of the frame's set (sections 3.1 to 3.6), and their shading (3.7 to 3.9)."""
        filling = self.filling = self.filling or self._begin(frame)
        resets = filling.resets
        self._lay_out(frame, filling)
        samples = gather(frame, filling, Blowup(self.enlarge, self.full_footprint), resets)
        listed, cuts = list_records(frame.scene.device, filling.items.listed, filling.slots.placement)
        planes = frame.shade(samples)
        if self.average_clear:
            clear_strips(frame.scene.device, filling.slots.superblocks, planes["atlas"])
        records = SetRecords.of(frame.pvs, filling.items, self.footprints.slicing, filling.left_out, listed)
        return self._payload(frame, filling, samples, planes, records, cuts)

    def _begin(self, frame: Frame) -> Filling:
        """Set up for an atlas."""
        device, width, lines = frame.scene.device, frame.atlas_width, frame.atlas_height
        height = superblock_height(width, lines, self.superblock_height)
        atlas = Atlas(
            width,
            lines,
            height,
            capacity=1 + self.capacity,
            shrink=self.shrink,
            collapse=self.collapse,
            enlarge=self.enlarge,
            fit=self.assignment,
            orphans=self.orphans,
        )
        placement = Placement(self.footprints.measured, Superblocks(device, atlas), self.places)
        heights = HeightBins(float(height - 1), self.logarithmic)
        slots = Slots(device, self.bins, self.bin_mapping, placement, heights)
        fit = Fit(heights, float(width - 2), self.perspective)
        fit = fit if self.hysteresis else fit.without_hysteresis()
        rate = BudgetedRate(self.shading_rate)
        return Filling(self.footprints, slots, self.freezing, atlas, fit, rate, self.points)

    def _lay_out(self, frame: Frame, filling: Filling) -> None:
        """Keep the layout, else rebuild it, else reset the atlas."""
        filling.slots.frames += 1
        if filling.slots.frames == 1:
            filling.reset(frame)
        elif not self._freeze(frame, filling):
            self.freezing.rebuilds += 1
            if not self._rebuild(frame, filling):
                filling.resets += 1
                filling.reset(frame)

    def _freeze(self, frame: Frame, filling: Filling) -> bool:
        """Add what is new to strips in which nothing moves (section 3.6); False if the set has changed too much."""
        device, slots, footprints = frame.scene.device, filling.slots, self.footprints
        if self.freezing.is_over or self.bin_mapping.is_due(slots.frames):
            return False
        if footprints.slicing.shows_outside(frame.server):
            return False
        filling.list_items(frame)
        items, sampling = filling.items, filling.sampling(frame)
        is_new = slots.find_new(items.listed)
        new = items.ids[is_new.get()[: len(items.ids)] > 0]
        listed = TriangleList.upload(device, new)
        if self.freezing.is_exceeded_by(footprints.measure_new(frame, new, listed, sampling)):
            return False
        if not filling.extend(frame, is_new, new, listed):
            return False
        if not frame.scene.skips.leaves_out("re-binning", True):
            self._force_rebinning(frame, filling)
        self.freezing.frozen_frames += 1
        return True

    def _force_rebinning(self, frame: Frame, filling: Filling) -> None:
        """What a frozen layout saves: footprints and bins of the whole set, which nobody reads."""
        device, listed = frame.scene.device, TriangleList(frame.pvs_device, len(frame.pvs))
        spare, bins = Footprints.allocate(device, frame.scene.triangles.count + MOST), BinCounts(device)
        self.footprints.measure(frame, listed, filling.sampling(frame).without_hysteresis(), spare)
        bins.count(listed, spare.bins, spare.lengths)

    def _rebuild(self, frame: Frame, filling: Filling) -> bool:
        """Footprints, bins, superblocks and ranks of the whole set (sections 3.1 to 3.5); False if the atlas has or had
        no room for some."""
        number = filling.slots.frames
        is_due = self.bin_mapping.is_due(number)
        if filling.left_out.any() or (filling.step > 0 and is_due):
            return False
        if is_due:
            self.bin_mapping.renew(number)
        return filling.make(frame, filling.sampling(frame))

    def _payload(
        self,
        frame: Frame,
        filling: Filling,
        samples: Samples,
        planes: dict[str, Array],
        records: SetRecords,
        cuts: Floats,
    ) -> Payload:
        """What is sent. cuts: of the items, see list_records."""
        before, places = self.records.words[frame.pvs, 0], records.words[:, 0]
        stayed = np.isin(frame.pvs, self.shown) & (before > 0) & (places > 0)
        self.shown, mapped = frame.pvs, cuts[cuts >= 0]
        statistics = {
            **statistics_of(filling, samples.count),
            "triangles_moved": int(np.count_nonzero(stayed & (before != places))),
            "mapped_triangles": len(mapped),
            "mapping_distortion": float(mapped.mean(dtype=np.float64)) if len(mapped) else 0.0,
            "sliced": int(np.count_nonzero(records.is_sliced)),
            "pieces": len(filling.items.shown),
        }
        return Payload(
            planes=planes,
            blobs={"places": self.records.encode(frame.pvs, records.words), "pieces": records.pieces.encode()},
            geometry=self.geometry.encode(frame.pvs),
            sample_count=samples.count,
            samples=samples,
            unplaced={int(triangle): UNPLACED for triangle in records.missing},
            statistics=statistics,
        )

    @property
    def leaves_unwritten(self) -> bool:
        """The paper's enlargement does."""
        return self.enlarge == "paper"

    def pictures(self, payload: Payload) -> dict[str, Bytes]:
        """The packing: superblocks, strips and slots in colours."""
        found = payload.owners()
        if self.filling is None or found is None:
            return {}
        owner = np.full(payload.planes["atlas"].shape[:2], -1, np.int32)
        owner.reshape(-1)[found.texel] = found.triangle
        superblocks = self.filling.slots.superblocks
        return {"packing": draw_packing(superblocks.live_strips(), superblocks.live_superblocks(), owner)}

    def client(self, scene: ClientScene) -> SnakeBinningClient:
        """A client without any triangle yet."""
        return SnakeBinningClient(scene)
