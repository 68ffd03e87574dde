"""Bilateral transformation (chapter 5): both ends move what is held to the new view, and only the rest is sent."""

from __future__ import annotations

from typing import TYPE_CHECKING

from shading_atlas_bench.packers.ppll.held import HeldView
from shading_atlas_bench.packers.ppll.kernels.lists import Lists
from shading_atlas_bench.packers.ppll.kernels.match import apply_differences, find_differences, move_lists, turning

if TYPE_CHECKING:
    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.packers.interface import View


class BilateralTransformation(HeldView):
    """Holds what an exact merge gives.

    threshold: share of a distance, and drift: of 255 of a colour channel, by which a moved fragment may differ from the
    new one that it stands for.

    What moves to rays of another view is removed here and inserted there, as if it were new.
    """

    def __init__(self, device: Device, threshold: float, drift: int) -> None:
        super().__init__(device)
        self.threshold, self.drift = threshold, drift

    def _change(self, node: int, fresh: Lists, view: View) -> Lists:
        device, before = self.device, self.view or view
        turn = turning(before.view, view.view)
        moved = move_lists(device, self.lists[node], turn, view.projection, "structs/transform")
        changes = find_differences(device, moved, fresh, self.threshold, self.drift, "structs/match")
        self.lists[node] = apply_differences(device, moved, changes, fresh, "structs/hold")
        return changes
