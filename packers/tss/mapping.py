"""Atlas mapping (section 4): what becomes of each primitive, in which bin it is, and at which scale all have room."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic import draws
from shading_atlas_bench.kernels.common.rank import rank_by_class
from shading_atlas_bench.packers.budget import ALL, BudgetedRate
from shading_atlas_bench.packers.tss.kernels.bins import Bins
from shading_atlas_bench.packers.tss.kernels.emit import CellTable, count_samples
from shading_atlas_bench.packers.tss.kernels.forms import choose_strategies
from shading_atlas_bench.packers.tss.kernels.layout import Items, lay_out, place_items
from shading_atlas_bench.packers.tss.kernels.primitives import Primitives, list_primitives

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.packers.interface import Frame

LOWEST = 2.0**-16  # the smallest scale: every primitive is a single texel


@dataclass(frozen=True)
class Mapped:
    """A frame's primitives in their bins, on the device.

    scale: texels per pixel. forms: int32 (n, 4), as from `choose_strategies`. regions: int32 (B, 6), of the bins. used: rows
    of the atlas that it needs, -1 if the atlas is too narrow.
    """

    scale: float
    primitives: Primitives
    forms: Array
    items: Items
    regions: Array
    used: int


class AtlasMapping:
    """Maps frame by frame; the scale is kept for as long as it does.

    threshold: longest edge over height above which a primitive is slanted. by_arrival: whether primitives come to their
    bins in a random order, another one in each frame. sized: whether the server's view has as many pixels as the
    client's, instead of as many per angle in its centre.
    """

    def __init__(self, device: Device, threshold: float, by_arrival: bool, sized: bool) -> None:
        self.threshold, self.by_arrival, self.sized = threshold, by_arrival, sized
        self.bins, self.cells = Bins.make(), CellTable.upload(device)
        self.tables = self.bins.upload(device)
        self.budgeted = BudgetedRate(lowest=LOWEST)

    def is_atlas_full(self, frame: Frame) -> bool:
        """Whether the room in the atlas holds the frame's samples down."""
        return frame.sample_budget is None and self.budgeted.rate < 1

    def map(self, frame: Frame, camera: Array) -> Mapped:
        """As many samples as the frame's budget has, without one those of the largest scale that fits; the smallest if
        none does.

        camera: float32 (21), see `camera_floats`. The search begins at the last frame's scale, which mostly stays: then
        one layout is enough.
        """
        client = frame.predicted[0] if frame.predicted else frame.server
        widest = client.width / frame.server.width if self.sized else 1.0
        last: Mapped

        def rows(rate: float) -> int | None:
            nonlocal last
            last = self._map_at(rate * widest, frame, camera)
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

    def _map_at(self, scale: float, frame: Frame, camera: Array) -> Mapped:
        device, triangles = frame.scene.device, frame.scene.triangles
        listed = (frame.pvs_device, len(frame.pvs), triangles, camera, scale, self.threshold)
        primitives = list_primitives(device, *listed)
        order = np.arange(primitives.count, dtype=np.int32)
        if self.by_arrival:
            order = draws.generator([frame.seed, frame.index]).permutation(order)
        turns = device.upload(order)
        forms, bins = choose_strategies(device, primitives, scale, self.threshold, turns, self.tables)
        ranks, totals = rank_by_class(device, bins, 2 * primitives.count, self.bins.count, "structs/rank")
        regions, used = lay_out(device, self.tables, totals, frame.atlas_width)
        return Mapped(scale, primitives, forms, Items(turns, bins, ranks), regions, used)

    def place(self, mapped: Mapped, frame: Frame) -> Array:
        """Places int32 (n, 2) of the items in the frame's atlas, see `place_items`."""
        count = mapped.primitives.count
        return place_items(frame.scene.device, count, frame.atlas_height, mapped.items, self.tables, mapped.regions)
