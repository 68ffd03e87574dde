"""What the display holds of one list view, as the server knows it: what changes of it are sent against."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING

from shading_atlas_bench.packers.ppll.kernels.lists import Lists

if TYPE_CHECKING:
    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.packers.interface import View


class HeldView(ABC):
    """Kept from frame to frame. view: its camera in the last one, None before the first. lists: each node's."""

    def __init__(self, device: Device) -> None:
        self.device = device
        self.view: View | None = None
        self.lists: list[Lists] = []

    def changes(self, fresh: Sequence[Lists], view: View) -> list[Lists]:
        """What is sent of each node's new lists; `lists` becomes what the display then holds."""
        if not self.lists:
            self.lists = [Lists.empty(self.device, part.width, part.height, part.words) for part in fresh]
        sent = [self._change(node, part, view) for node, part in enumerate(fresh)]
        self.view = view
        return sent

    @abstractmethod
    def _change(self, node: int, fresh: Lists, view: View) -> Lists:
        """What is sent of a node's new lists; puts into `lists` what the display then holds of it."""
