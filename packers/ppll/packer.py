"""Per-pixel linked lists: every fragment of the server's view is streamed, not texels of an atlas.

See README.md in this folder for what is as published and what is ours.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from shading_atlas_bench.packers.interface import (
    ClientScene,
    Frame,
    Holds,
    Packer,
    Paper,
    Parameter,
    Payload,
    ServerScene,
    View,
)
from shading_atlas_bench.packers.ppll.bilateral import BilateralTransformation
from shading_atlas_bench.packers.ppll.client import ListClient
from shading_atlas_bench.packers.ppll.difference import VisualDifference
from shading_atlas_bench.packers.ppll.held import HeldView
from shading_atlas_bench.packers.ppll.kernels.limit import EVERY_LAYER, NO_THRESHOLD, Depth
from shading_atlas_bench.packers.ppll.kernels.lists import Lists, count_deleted
from shading_atlas_bench.packers.ppll.kernels.wire import LAYOUTS, write_lists
from shading_atlas_bench.packers.ppll.server import ListRenderer
from shading_atlas_bench.packers.ppll.statistics import describe
from shading_atlas_bench.packers.ppll.views import list_views
from shading_atlas_bench.packers.ppll.wire import DIFFERENCES, MERGES, MODES, MOST_NODES, Head, decode, encode

if TYPE_CHECKING:
    from shading_atlas_bench.arithmetic import arrays


class PerPixelLinkedLists(Packer):
    """Streams the fragment lists of the server's view; see the module."""

    name = "ppll"
    paper = Paper("Using Per-Pixel Linked Lists for Transparency Effects in Remote-Rendering", 2014, "")
    atlas = False
    mode: str
    layers: int
    opacity: float
    detect: str
    tolerance: int
    merge: str
    threshold: float
    drift: int
    nodes: int
    preblend: bool
    layout: str
    parameters: ClassVar[dict[str, Parameter]] = {
        "mode": Parameter(
            "depth-limited",
            MODES,
            "which fragments are sent: all, the nearest, the lists of pixels that changed, or those that moving the "
            "last frame's does not give",
            "",
            "chapters 2 to 5",
        ),
        "layers": Parameter(
            0,
            (0, 1, 2, 4, 6, 10),
            "most fragments per pixel; 0: 6 for depth-limited, no limit for others",
            "fragments",
            "chapter 3; 6: section 6.1",
        ),
        "opacity": Parameter(
            1.0,
            (0.9, 0.99, 1.0, 2.0),
            "depth-limited lists end where opacity reaches this; above 1: never",
            "1",
            "chapter 3; 1: ours",
        ),
        "detect": Parameter(
            "colour",
            ("colour", "list"),
            "what makes a list a changed one: the pixel's blended colour, or any of its fragments' colours and depths",
            "",
            "colour: chapter 4; list: ours",
        ),
        "tolerance": Parameter(
            0,
            (0, 2, 4, 8),
            "change of a colour channel that is not sent while the camera moves",
            "of 255",
            "chapter 7; 0: chapter 4",
        ),
        "merge": Parameter(
            "exact",
            MERGES,
            "how the display applies bilateral differences: as published, or removing exactly what is meant",
            "",
            "paper: chapter 5; exact: chapter 7",
            published="paper",
        ),
        "threshold": Parameter(
            0.005,
            (0.001, 0.005, 0.02, 0.1),
            "largest difference of a moved fragment's distance from the new one's it stands for",
            "of the distance",
            "chapter 5, which gives no value: ours",
        ),
        "drift": Parameter(
            16,
            (4, 16, 64),
            "largest difference of a moved fragment's colour channels from the new one's it stands for",
            "of 255",
            "ours: the thesis' display lights its fragments anew",
        ),
        "nodes": Parameter(
            1, (1, 2, 4), "render nodes that the scene's objects are dealt to", "nodes", "chapters 1 and 7"
        ),
        "preblend": Parameter(
            False, (False, True), "whether a node sends one blended fragment per pixel", "", "algorithm A.2"
        ),
        "layout": Parameter(
            "paper", LAYOUTS, "order of the bytes that LZ4 packs: as published, or field by field", "", "shuffled: ours"
        ),
    }

    def prepare(self, scene: ServerScene) -> None:
        """Deal the objects to the nodes. Raises ValueError for parameters out of range."""
        if not 1 <= self.nodes <= MOST_NODES:
            raise ValueError(f"ppll: nodes must be 1 to {MOST_NODES}, not {self.nodes}.")
        if self.layers < 0 or self.tolerance < 0 or not self.opacity > 0:
            raise ValueError("ppll: layers and tolerance must not be negative, and opacity must be above 0.")
        if not 0 <= self.threshold <= 1 or self.drift < 0:
            raise ValueError("ppll: threshold must be 0 to 1, and drift must not be negative.")
        if self.preblend and self.mode == "bilateral":
            raise ValueError("ppll: preblend and mode=bilateral exclude each other: blended fragments cannot be moved.")
        limited = self.mode == "depth-limited"
        layers = self.layers or (6 if limited else EVERY_LAYER)
        depth = Depth(layers, self.opacity if limited else NO_THRESHOLD)
        self.renderer = ListRenderer(scene, self.nodes, depth, self.preblend)
        self.held: list[HeldView] = []  # where differences are sent

    @property
    def holds(self) -> Holds:
        """Which of its fragments the display holds."""
        if self.preblend and self.mode != "difference":
            return "blended"
        kinds: dict[str, Holds] = {"full": "every", "depth-limited": "nearest", "difference": "alike"}
        return kinds.get(self.mode, "moved")

    def settled(self) -> bool:
        """Whole lists depend on the frame alone; differences on what was sent before."""
        return self.mode not in DIFFERENCES

    def pack(self, frame: Frame) -> Payload:
        """The lists of the frame's set in the list views, as far as the display does not hold them."""
        views, device = list_views(frame), self.renderer.device
        rendered = self.renderer.render(views, frame.pvs_device, len(frame.pvs), self.mode == "bilateral")
        sent = [[node.lists for node in nodes] for nodes in rendered]
        if self.mode in DIFFERENCES:
            sent = self._changes(views, sent)
        heads, parts = list(map(self._head, views, sent)), [part for lists in sent for part in lists]
        written = device.download(write_lists(device, parts, self.layout, "structs/wire"))
        deleted = 0
        if self.mode in DIFFERENCES:
            deleted = sum(count_deleted(device, part, "structs/count") for part in parts)
        nodes = [node for nodes in rendered for node in nodes]
        return Payload(
            planes={},
            blobs={"head": encode(heads, written)},
            geometry=b"",
            sample_count=sum(node.lists.count for node in nodes),
            statistics=describe(nodes, heads, deleted),
            lists={"lists": written},
            raw_bytes=sum(head.raw_bytes for head in heads),
        )

    def _changes(self, views: Sequence[View], lists: Sequence[Sequence[Lists]]) -> list[list[Lists]]:
        """What changed of each view's and node's lists since what the display holds."""
        if len(self.held) != len(views):
            self.held = [self._nothing_held() for _ in views]
        return [held.changes(nodes, view) for held, view, nodes in zip(self.held, views, lists, strict=True)]

    def _nothing_held(self) -> HeldView:
        device = self.renderer.device
        if self.mode == "difference":
            return VisualDifference(device, self.detect == "list", self.tolerance)
        return BilateralTransformation(device, self.threshold, self.drift)

    def _head(self, view: View, sent: Sequence[Lists]) -> Head:
        """What is said of one view's lists, a part for each node."""
        return Head(
            mode=self.mode,
            layout=self.layout,
            width=view.width,
            height=view.height,
            view=view.view,
            projection=view.projection,
            words=sent[0].words,
            counts=tuple(part.count for part in sent),
            merge=self.merge,
            threshold=self.threshold,
        )

    def details(self, payload: Payload) -> dict[str, arrays.Array]:
        """What was sent: `header` uint32 (h, w, 2), offset and count, and `fragments` uint32 (n, words), of node 0.

        Those of further nodes have its number behind their name, and those of further views `_view1`, `_view2` behind
        that. `list_view` and `list_projection` float64 (4, 4) are the lists' camera.
        """
        found: dict[str, arrays.Array] = {}
        for number, message in enumerate(decode(payload.blobs["head"], payload.lists["lists"])):
            behind = f"_view{number}" if number else ""
            found |= {f"list_view{behind}": message.view, f"list_projection{behind}": message.projection}
            for node, (offsets, rows) in enumerate(message.nodes):
                header = np.stack([offsets[:-1], np.diff(offsets)], axis=1).astype(np.uint32)
                found[f"header{node or ''}{behind}"] = header.reshape(message.height, message.width, 2)
                found[f"fragments{node or ''}{behind}"] = rows
        return found

    def client(self, scene: ClientScene) -> ListClient:
        """A client that holds nothing yet."""
        return ListClient(scene)
