"""Slots of triangles: bins, strips of bins in superblocks, and ranks in strips (sections 3.2 to 3.5)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.packers.snakebinning.kernels.place import Placement, find_new, place_triangles

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.packers.skips import Skips
    from shading_atlas_bench.packers.snakebinning.kernels.bins import HeightBins
    from shading_atlas_bench.packers.snakebinning.kernels.count import BinCounts
    from shading_atlas_bench.packers.snakebinning.kernels.pieces import TriangleList
    from shading_atlas_bench.packers.snakebinning.kernels.superblocks import Atlas, Superblocks
    from shading_atlas_bench.packers.snakebinning.mapping import BinMapping


class Slots:
    """Gives measured triangles slots, which are kept from frame to frame.

    frames: packed so far; slots are dated with them. made_at: the frame since which slots count. bins_before_mapping:
    that were in use then.
    """

    def __init__(
        self, device: Device, bins: BinCounts, mapping: BinMapping, placement: Placement, heights: HeightBins
    ) -> None:
        self.device, self.bins, self.mapping, self.placement = device, bins, mapping, placement
        self.tops = device.upload(heights.tops())
        self.frames = self.made_at = self.bins_before_mapping = 0

    @property
    def superblocks(self) -> Superblocks:
        """Those that the strips are in."""
        return self.placement.superblocks

    def empty(self, atlas: Atlas) -> None:
        """Remove all strips and superblocks, and map and place others by the rules of `atlas`."""
        self.mapping.reset(self.frames)
        self.superblocks.reset(atlas)

    def make(self, listed: TriangleList, skips: Skips) -> bool:
        """Slots for all triangles of a frame, in primitive order; False if the atlas has no room for some."""
        self.made_at = self.frames
        is_new = self.device.recycled(listed.count, np.uint8)  # all strips move, so it says nothing
        if not self._place(listed, listed, is_new, False, skips):
            return False
        self.bins_before_mapping = self.bins.used.count
        return True

    def find_new(self, listed: TriangleList) -> Array:
        """Which triangles have no valid slot: uint8 (n) on the device."""
        return find_new(self.device, listed, self.made_at, self.placement)

    def extend(self, listed: TriangleList, is_new: Array, new: TriangleList, skips: Skips) -> bool:
        """Slots for the new ones of a frame's triangles, while nothing moves; False if the atlas has no room for some.

        is_new: as from `find_new`; new: those for which it says so.
        """
        return self._place(listed, new, is_new, True, skips)

    def _place(self, listed: TriangleList, binned: TriangleList, is_new: Array, frozen: bool, skips: Skips) -> bool:
        measured = self.placement.footprints
        used = self.bins.count(binned, measured.bins, measured.lengths)
        self.mapping.update(used, skips)
        if not self.superblocks.update(self.frames, used, self.mapping.targets, self.tops, frozen):
            return False
        place_triangles(self.device, self.frames, listed, is_new, self.mapping.targets, self.placement)
        return True
