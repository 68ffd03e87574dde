"""The allocation bias: how much smaller than they appear blocks are, so that they fit or have the samples asked for."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.functions import log2, power
from shading_atlas_bench.packers.budget import ALL, BudgetedRate
from shading_atlas_bench.packers.sas.kernels.bias import Request, needed_superblocks
from shading_atlas_bench.packers.sas.kernels.emit import count_asked
from shading_atlas_bench.packers.sas.kernels.footprint import SIZES, STEPS, measure_sides

if TYPE_CHECKING:
    from shading_atlas_bench.packers.interface import Frame
    from shading_atlas_bench.packers.sas.kernels.allocate import SuperblockGrid
    from shading_atlas_bench.packers.sas.kernels.tables import PatchTables
    from shading_atlas_bench.packers.sas.kernels.visible import VisiblePatches

LARGEST = (SIZES - 1) / STEPS  # every block is a single texel


class AllocationBias:
    """The bias, kept from frame to frame for as long as it does.

    fit: share of the superblocks that a request may take. of_picture: whether the pixels of the server's view hold the
    samples down as well. complete: whether every texel of a block is shaded.
    """

    def __init__(self, tables: PatchTables, fit: float, of_picture: bool, complete: bool) -> None:
        self.tables, self.fit, self.of_picture, self.complete = tables, fit, of_picture, complete
        # The bias as a factor. Whole eighths of it are the bias of a request, and the rest, which makes it any number,
        # is in the sizes.
        self.budgeted = BudgetedRate(lowest=float(power(2.0, -LARGEST)))

    @property
    def value(self) -> float:
        """In doublings of a side; below 0 where more samples are asked for."""
        return 0.0 - float(log2(self.budgeted.rate))

    def is_atlas_full(self, frame: Frame) -> bool:
        """Whether only the room in the atlas holds the frame's samples down."""
        return frame.sample_budget is None and not self.of_picture and self.budgeted.rate < 1

    def request(self, frame: Frame, visible: VisiblePatches, grid: SuperblockGrid) -> Request:
        """What the patches ask for, held down to what `fit` allows and to the samples that the frame may have; with the
        largest bias if none does."""
        device, room = frame.scene.device, int(self.fit * grid.total)
        last: Request

        def needed(rate: float) -> int | None:
            nonlocal last
            last, superblocks = self._request_at(rate, frame, visible, grid)
            return superblocks if superblocks <= room else None

        def samples(rate: float) -> int | None:
            if needed(rate) is None:
                return None
            return count_asked(device, visible, last, grid.top, self.tables, self.complete)

        if frame.sample_budget is not None:
            self.budgeted.meet(frame.sample_budget, samples)
        elif self.of_picture:
            pixels = sum(view.width * view.height for view in frame.cell_views)
            self.budgeted.meet(pixels, samples, highest=1.0)
        else:
            self.budgeted.meet(ALL, needed, highest=1.0)
        return last

    def _request_at(
        self, rate: float, frame: Frame, visible: VisiblePatches, grid: SuperblockGrid
    ) -> tuple[Request, int]:
        """What the patches ask for at a rate, and the superblocks that it takes."""
        device, server = frame.scene.device, frame.server
        bias = int(np.clip(np.ceil(-STEPS * float(log2(rate))), 0, SIZES - 1))
        pixels = rate * float(power(2.0, bias / STEPS)) * server.pixels_per_tangent
        positions = frame.scene.triangles.positions
        sizes, histogram = measure_sides(device, visible, self.tables.points, positions, server.eye, pixels)
        return Request(sizes, bias), int(needed_superblocks(device, histogram, grid.top)[bias])
