"""Visual difference (chapter 4): the lists of pixels that changed are sent whole, and replace those held."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.kernels.fragments.blend import blend_lists
from shading_atlas_bench.packers.ppll.held import HeldView
from shading_atlas_bench.packers.ppll.kernels.lists import Lists, changed_colours, changed_lists, splice_lists

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.packers.interface import View

DEPTH_SHARE = 1e-4  # of a depth: less than this is no change of a list


class VisualDifference(HeldView):
    """Holds each node's lists with the changed ones in place.

    by_fragments: whether any change of a fragment changes a list, rather than one of the pixel's blended colour.
    tolerance: change of a colour channel, of 255, that is not sent while the camera moves.
    """

    def __init__(self, device: Device, by_fragments: bool, tolerance: int) -> None:
        super().__init__(device)
        self.by_fragments, self.tolerance = by_fragments, tolerance
        self.shown: dict[int, Array] = {}  # by node, what blending its lists gives

    def _change(self, node: int, fresh: Lists, view: View) -> Lists:
        device, held = self.device, self.lists[node]
        still = self.view is not None and np.array_equal(self.view.matrix, view.matrix)
        tolerance = 0 if still else self.tolerance
        if self.by_fragments:
            changed = changed_lists(device, fresh, held, tolerance, DEPTH_SHARE, "structs/difference")
        else:
            if node not in self.shown:
                self.shown[node] = self._blended(held)
            now = self._blended(fresh)
            changed = changed_colours(device, fresh, self.shown[node], now, tolerance, "structs/difference")
        self.lists[node] = splice_lists(device, held, changed, "structs/hold")
        return changed

    def _blended(self, lists: Lists) -> Array:
        """uint8 (P, 4): what a node sees of its lists, over nothing."""
        picture = self.device.recycled((lists.pixels, 4), np.uint8)
        self.device.fill(picture, 0, "structs/blend")
        blended = (lists.pixels, lists.offsets, lists.rows, lists.words)
        blend_lists(self.device, *blended, picture, picture, "structs/blend")
        return picture
