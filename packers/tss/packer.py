"""Tessellated Shading Streaming: L-packing for triangles near to equilateral ones, Oversampling for slanted ones.

See README.md in this folder for what is as published and what is ours.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic import draws
from shading_atlas_bench.kernels.common.rank import rank_by_class
from shading_atlas_bench.packers.atlas_client import geometry_encoder
from shading_atlas_bench.packers.budget import ALL, BudgetedRate
from shading_atlas_bench.packers.interface import (
    FULL,
    ClientScene,
    Frame,
    Packer,
    Paper,
    Parameter,
    Payload,
    ServerScene,
)
from shading_atlas_bench.packers.tss.client import TessellatedClient
from shading_atlas_bench.packers.tss.kernels.bins import Bins
from shading_atlas_bench.packers.tss.kernels.emit import CellTable, build_kernels, count_samples, emit_samples
from shading_atlas_bench.packers.tss.kernels.footprint import camera_floats
from shading_atlas_bench.packers.tss.kernels.forms import OVERSAMPLED, choose_forms
from shading_atlas_bench.packers.tss.kernels.layout import lay_out, place_items
from shading_atlas_bench.packers.tss.kernels.perspective import invert_depths
from shading_atlas_bench.packers.tss.kernels.primitives import Primitives, list_primitives
from shading_atlas_bench.packers.tss.message import Placement, encode
from shading_atlas_bench.packers.tss.picture import draw_strategies
from shading_atlas_bench.packers.tss.statistics import describe

if TYPE_CHECKING:
    from pyopencl.array import Array

STRATEGIES = {"lpacking": float("inf"), "oversampling": 0.0}  # threshold of slantedness that they amount to
ORDERS = ("primitive", "arrival")
PICTURES = ("density", "size")
LOWEST = 2.0**-16  # the smallest scale: every primitive is a single texel
UNPLACED = "the atlas is full with every primitive at one texel"


class TessellatedShadingStreaming(Packer):
    """Packs triangles as Ls or as pairs of right triangles; see the module."""

    name = "tss"
    paper = Paper("Tessellated Shading Streaming", 2019, "10.1111/cgf.13780")
    parameters = {  # noqa: RUF012
        "strategy": Parameter(
            "combined",
            ("combined", "lpacking", "oversampling"),
            "how triangles are sampled: by their slantedness, or all in the same way",
            "",
            "TSS, sections 3.2 and 3.3, figure 15",
        ),
        "slanted": Parameter(
            8.0,
            (3.0, 5.0, 8.0),
            "longest edge over height on screen above which a triangle goes to Oversampling",
            "1",
            "meaning: TSS, section 3.3; value: ours, by the shares in TSS, table 1",
        ),
        "order": Parameter(
            "primitive",
            ORDERS,
            "which of the triangles of a bin comes first: the one with the lower id, or a random one in each frame, as "
            "with the paper's atomic counters",
            "",
            "arrival: TSS, section 4; primitive: ours",
            published="arrival",
        ),
        "picture": Parameter(
            "density",
            PICTURES,
            "what the server's view, as wide as the cell's, has of the client's: pixels per angle in its centre, or "
            "the number of pixels",
            "",
            "wide view: SnakeBinning, section 5.2; density: ours",
        ),
    }

    skips = {  # noqa: RUF012
        "oversampling": ("right triangles of samples", "no primitive is slanted", "primitives are slanted"),
    }

    def __init__(self, **values) -> None:
        super().__init__(**values)
        if self.strategy not in ("combined", *STRATEGIES):
            raise ValueError(f"The strategy {self.strategy!r} is not known: combined, {', '.join(STRATEGIES)}.")
        if self.order not in ORDERS:
            raise ValueError(f"The order {self.order!r} is not known: {', '.join(ORDERS)}.")
        if self.picture not in PICTURES:
            raise ValueError(f"The picture {self.picture!r} is not known: {', '.join(PICTURES)}.")
        self.threshold = STRATEGIES.get(self.strategy, float(self.slanted))

    def prepare(self, scene: ServerScene) -> None:
        """Tabulate bins and Ls."""
        self.bins = Bins.make()
        self.bin_tables = self.bins.upload(scene.device)
        self.cells = CellTable.upload(scene.device)
        self.geometry = geometry_encoder(scene, {})
        build_kernels(scene.device)
        self.budgeted = BudgetedRate(lowest=LOWEST)

    def settled(self) -> bool:
        """Only the scale is kept from frame to frame, where it was found to do; the order of arrival is another in
        each."""
        return self.order == "primitive"

    def pack(self, frame: Frame) -> TessellatedPayload:
        """Places for the triangles of the frame's set, and their shading."""
        device, server = frame.scene.device, frame.server
        camera = camera_floats(server.view, server.projection, server.width, server.height)
        triangles, rows = frame.scene.triangles, len(frame.pvs)
        arranged = self._arrange(frame, device.upload(camera))
        primitives, listed = arranged.primitives, (*arranged.listed, self.bin_tables, arranged.regions)
        places = place_items(device, primitives.count, frame.atlas_height, *listed)
        placement = self._read(arranged, places, camera)
        lost = find_lost(placement, primitives.parents.get()[: primitives.count])
        if len(lost):
            places = device.upload(placement.places)
        inverse = invert_depths(
            device, primitives.depths, primitives.pieces, rows, arranged.scale, "structs/perspective"
        )
        placed = (primitives, arranged.forms, places, inverse, triangles, self.cells)
        slanted = bool((placement.forms[:, 0] == OVERSAMPLED).any())
        oversampled = not frame.scene.skips.leaves_out("oversampling", not slanted)
        samples = emit_samples(device, *placed, frame.atlas_width, oversampled=oversampled)
        blobs = encode(placement, self.bins)
        statistics = describe(placement)
        statistics[FULL] = int(frame.sample_budget is None and self.budgeted.rate < 1)
        statistics |= {f"{name}_bytes": len(blobs[name]) for name in ("lpacking", "oversampling")}
        statistics["metadata_bytes"] = sum(len(blob) for blob in blobs.values())
        return TessellatedPayload(
            planes=frame.shade(samples),
            blobs=blobs,
            geometry=self.geometry.encode(frame.pvs),
            sample_count=samples.count,
            samples=samples,
            unplaced={int(triangle): UNPLACED for triangle in frame.pvs[lost]},
            statistics=statistics,
            placement=placement,
        )

    def details(self, payload: TessellatedPayload) -> dict[str, np.ndarray]:
        """The primitives' forms and places, see Placement."""
        return {"forms": payload.placement.forms, "places": payload.placement.places}

    def pictures(self, payload: TessellatedPayload) -> dict[str, np.ndarray]:
        """The atlas by strategy."""
        height, width = payload.planes["atlas"].shape[:2]
        texel = payload.samples.texel.get()[: payload.sample_count]
        drawn = draw_strategies(payload.placement.forms, payload.placement.places, texel, width, height)
        return {"strategies": drawn}

    def _arrange(self, frame: Frame, camera: Array) -> Arranged:
        """Primitives, bins and their positions: as many samples as the frame's budget has, without one those of the
        largest scale that fits; at the smallest if none does.

        The search begins at the last frame's scale, which mostly stays: then one layout is enough.
        """
        client = frame.predicted[0] if frame.predicted else frame.server
        widest = 1.0 if self.picture == "density" else client.width / frame.server.width
        last: Arranged

        def rows(rate: float) -> int | None:
            nonlocal last
            last = self._arrange_at(frame, self._list(frame, camera, rate * widest), rate * widest)
            return last.used if 0 <= last.used <= frame.atlas_height else None

        def samples(rate: float) -> int | None:
            if rows(rate) is None:
                return None
            return count_samples(frame.scene.device, last.primitives.count, last.forms, self.cells)

        if frame.sample_budget is None:
            self.budgeted.meet(ALL, rows, highest=1.0)
        else:
            self.budgeted.meet(frame.sample_budget, samples)
        return last

    def _list(self, frame: Frame, camera: Array, scale: float) -> Primitives:
        listed = (frame.pvs_device, len(frame.pvs), frame.scene.triangles, camera, scale, self.threshold)
        return list_primitives(frame.scene.device, *listed)

    def _arrange_at(self, frame: Frame, primitives: Primitives, scale: float) -> Arranged:
        device, count = frame.scene.device, primitives.count
        turns = np.arange(count, dtype=np.int32)
        if self.order == "arrival":
            turns = draws.generator([frame.seed, frame.index]).permutation(turns)
        turns = device.upload(turns)
        form = (primitives, scale, self.threshold, turns, self.bin_tables)
        forms, items = choose_forms(device, *form)
        ranks, totals = rank_by_class(device, items, 2 * count, self.bins.count, "structs/rank")
        regions, used = lay_out(device, self.bin_tables, totals, frame.atlas_width)
        return Arranged(scale, primitives, forms, (turns, items, ranks), regions, used)

    def _read(self, arranged: Arranged, places: Array, camera: np.ndarray) -> Placement:
        """What was decided, on the host."""
        primitives, count = arranged.primitives, arranged.primitives.count

        def table(array: Array, width: int) -> np.ndarray:
            return array.get().reshape(-1)[: width * count].reshape(count, width)

        turns, _, ranks = arranged.listed
        first_ranks = table(ranks, 2)[turns.get()[:count], 0]
        pieces, firsts = primitives.pieces.get()[: primitives.rows], primitives.firsts.get()[:count]
        decided = (table(arranged.forms, 4), table(places, 2), firsts, first_ranks, arranged.regions.get())
        return Placement(camera, arranged.scale, pieces, *decided)

    def client(self, scene: ClientScene) -> TessellatedClient:
        """A client without any triangle yet."""
        return TessellatedClient(scene)


@dataclass(kw_only=True)
class TessellatedPayload(Payload):
    """A payload, and what was decided about it, which pictures and `--dump` show."""

    placement: Placement


@dataclass(frozen=True)
class Arranged:
    """A layout, on the device.

    listed: the items' turns, bins and ranks. regions: of the bins. used: rows of the atlas that it needs, -1 if the
    atlas is too narrow.
    """

    scale: float
    primitives: Primitives
    forms: Array
    listed: tuple[Array, Array, Array]
    regions: Array
    used: int


def find_lost(placement: Placement, parents: np.ndarray) -> np.ndarray:
    """Rows of the triangles that have not all of their items placed; takes the places of the others from them."""
    forms, places = placement.forms, placement.places
    halves = forms[:, 0] < 0
    missing = (places[:, 0] < 0) & (~halves | (forms[:, 2] > 0)) | halves & (forms[:, 3] > 0) & (places[:, 1] < 0)
    lost = np.unique(parents[missing])
    places[np.isin(parents, lost)] = -1
    return lost
