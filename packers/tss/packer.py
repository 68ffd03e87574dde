"""Tessellated Shading Streaming: L-packing for triangles near to equilateral ones, Oversampling for slanted ones.

See README.md in this folder for what is as published and what is ours.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from arithmetic import draws
from arithmetic.functions import log2, power
from kernels.common.rank import rank_by_class
from kernels.tss.bins import Bins
from kernels.tss.emit import CellTable, build_kernels, count_samples, emit_samples
from kernels.tss.footprint import camera_floats
from kernels.tss.forms import OVERSAMPLED, choose_forms
from kernels.tss.layout import lay_out, place_items
from kernels.tss.perspective import invert_depths
from kernels.tss.primitives import Primitives, list_primitives
from packers.atlas_client import geometry_encoder
from packers.budget import BudgetedRate
from packers.interface import ClientScene, Frame, Packer, Paper, Parameter, Payload, ServerScene
from packers.tss.client import TessellatedClient
from packers.tss.message import Placement, encode
from packers.tss.picture import draw_strategies
from packers.tss.statistics import describe

if TYPE_CHECKING:
    from pyopencl.array import Array

STRATEGIES = {"lpacking": float("inf"), "oversampling": 0.0}  # threshold of slantedness that they amount to
ORDERS = ("primitive", "arrival")
PICTURES = ("density", "size")
STEPS = 16  # of the scale per doubling
LAST = 16 * STEPS  # the smallest scale: every primitive is a single texel
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
            3.0,
            (2.0, 3.0, 5.0),
            "longest edge over height on screen above which a triangle goes to Oversampling",
            "1",
            "meaning: TSS, section 3.3; value: ours",
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
        self.step, self.guess = 0, -1  # of the last frame's scale, and where the search for it began
        self.budgeted = BudgetedRate()

    def settled(self) -> bool:
        """Only the scale is kept from frame to frame, to begin with; the order of arrival is another in each."""
        return self.order == "primitive" and self.step == self.guess

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
        """Primitives, bins and their positions: those within the frame's sample budget, if any fit; without one those
        at the largest scale that fits, at the smallest if none does.

        The search begins at the last frame's scale, which is mostly the same: then two layouts are enough.
        """
        client = frame.predicted[0] if frame.predicted else frame.server
        widest = 1.0 if self.picture == "density" else client.width / frame.server.width
        if frame.sample_budget is not None and (within := self._within_budget(frame, camera, widest)):
            return within
        fitting: Arranged | None = None
        uncut: tuple[int, Primitives] | None = None  # a step without cut triangles, as are all larger ones

        def excess(step: int) -> float:
            nonlocal fitting, uncut
            scale = widest * scale_at(step)
            primitives = uncut[1] if uncut and step >= uncut[0] else self._list(frame, camera, scale)
            if primitives.count == primitives.rows and not (uncut and step >= uncut[0]):
                uncut = (step, primitives)
            arranged = self._arrange_at(frame, primitives, scale)
            over = float(log2(max(arranged.used, 0.5) / frame.atlas_height)) if arranged.used >= 0 else np.inf
            if over <= 0 or step == LAST:
                fitting = arranged
            return over

        self.guess = self.step
        self.step = smallest_that_fits(excess, LAST, self.guess)
        if fitting is None:
            excess(LAST)
        return fitting

    def _within_budget(self, frame: Frame, camera: Array, widest: float) -> Arranged | None:
        """The layout that has as many samples as the frame's budget; None if the atlas has no room for any."""

        def samples(rate: float) -> int | None:
            nonlocal last
            primitives = self._list(frame, camera, rate * widest)
            last = self._arrange_at(frame, primitives, rate * widest)
            if not 0 <= last.used <= frame.atlas_height:
                return None
            return count_samples(frame.scene.device, primitives.count, last.forms, self.cells)

        last: Arranged
        rate = self.budgeted.rate
        met = self.budgeted.meet(frame.sample_budget, samples)
        self.guess = self.step if self.budgeted.rate == rate else -1
        return last if met else None

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


def scale_at(step: int) -> float:
    """Share of the texels per pixel that there would be in a large enough atlas."""
    return float(power(2.0, -step / STEPS))


def smallest_that_fits(excess: Callable[[int], float], last: int, guess: int = 0) -> int:
    """The smallest step from 0 to `last` whose excess is not above 0, or `last`; larger steps have less excess.

    Excess is the logarithm of needed over given area, which falls by about 2 per doubling of the scale: from the guess
    on this says where to look, then a secant finds where it is 0 in few trials, with a bisection every third time, so
    that it always does. The last step tried that fits is the one returned, but for `last`, which may be untried.
    """
    low, over, high, under = -1, np.inf, last, -np.inf
    step, trials = min(guess, last - 1), 0
    while high - low > 1:
        found = excess(step)
        if found > 0:
            low, over = step, found
        else:
            high, under = step, found
        trials += 1
        if np.isfinite(over) and np.isfinite(under):
            step = low + int(np.ceil(over / (over - under) * (high - low)))
        elif np.isfinite(over):
            step = low + 1 + int(over * STEPS / 2)
        elif np.isfinite(under):
            step = high - 1 - int(-under * STEPS / 2)
        if trials % 3 == 0 or not (np.isfinite(over) or np.isfinite(under)):
            step = (low + high) // 2
        step = min(max(step, low + 1), high - 1)
    return high


def find_lost(placement: Placement, parents: np.ndarray) -> np.ndarray:
    """Rows of the triangles that have not all of their items placed; takes the places of the others from them."""
    forms, places = placement.forms, placement.places
    halves = forms[:, 0] < 0
    missing = (places[:, 0] < 0) & (~halves | (forms[:, 2] > 0)) | halves & (forms[:, 3] > 0) & (places[:, 1] < 0)
    lost = np.unique(parents[missing])
    places[np.isin(parents, lost)] = -1
    return lost
