"""Per-pixel linked lists: every fragment of the server's view is streamed, not texels of an atlas.

See README.md in this folder for what is as published and what is ours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.kernels.fragments.blend import blend_lists
from shading_atlas_bench.packers.interface import (
    ClientScene,
    Frame,
    Packer,
    Paper,
    Parameter,
    Payload,
    ServerScene,
    View,
)
from shading_atlas_bench.packers.ppll.client import ListClient
from shading_atlas_bench.packers.ppll.kernels.limit import EVERY_LAYER, NO_THRESHOLD
from shading_atlas_bench.packers.ppll.kernels.lists import (
    Lists,
    changed_colours,
    changed_lists,
    count_deleted,
    splice_lists,
)
from shading_atlas_bench.packers.ppll.kernels.match import apply_differences, find_differences, move_lists, turning
from shading_atlas_bench.packers.ppll.kernels.wire import LAYOUTS, write_lists
from shading_atlas_bench.packers.ppll.server import Depth, ListRenderer, NodeLists
from shading_atlas_bench.packers.ppll.wire import MERGES, MODES, MOST_NODES, Head, decode, encode

if TYPE_CHECKING:
    from pyopencl.array import Array

DEPTH_SHARE = 1e-4  # of a depth: less than this is no change of a list


@dataclass
class Held:
    """What the display holds of one view: its camera, None before the first frame, and each node's lists.

    shown: by node, what blending the lists gives, where differences are of colours.
    """

    view: View | None = None
    lists: list[Lists] = field(default_factory=list)
    shown: dict[int, Array] = field(default_factory=dict)


class PerPixelLinkedLists(Packer):
    """Streams the fragment lists of the server's view; see the module."""

    name = "ppll"
    paper = Paper("Using Per-Pixel Linked Lists for Transparency Effects in Remote-Rendering", 2014, "")
    atlas = False
    parameters = {  # noqa: RUF012
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
        self.held: list[Held] = []

    @property
    def holds(self) -> str:
        """Which of its fragments the display holds."""
        kinds = {"full": "every", "depth-limited": "nearest", "difference": "alike", "bilateral": "moved"}
        return "blended" if self.preblend and self.mode != "difference" else kinds[self.mode]

    def settled(self) -> bool:
        """Whole lists depend on the frame alone; differences on what was sent before."""
        return self.mode in ("full", "depth-limited")

    def pack(self, frame: Frame) -> Payload:
        """The lists of the frame's set in the list views, as far as the display does not hold them."""
        views, device = list_views(frame), self.renderer.device
        rendered = self.renderer.render(views, frame.pvs_device, len(frame.pvs), self.mode == "bilateral")
        if len(self.held) != len(views):
            self.held = [Held() for _ in views]
        encoders = {"difference": self._changed, "bilateral": self._unmatched}
        parts, heads = [], []
        for view, nodes, held in zip(views, rendered, self.held, strict=True):
            lists = [node.lists for node in nodes]
            sent = encoders[self.mode](lists, view, held) if self.mode in encoders else lists
            held.view = view
            heads.append(self._head(view, sent))
            parts += sent
        written = device.download(write_lists(device, parts, self.layout, "structs/wire"))
        deleted = sum(count_deleted(device, part, "structs/count") for part in parts) if self.mode in encoders else 0
        nodes = [node for nodes in rendered for node in nodes]
        return Payload(
            planes={},
            blobs={"head": encode(heads, written)},
            geometry=b"",
            sample_count=sum(node.lists.count for node in nodes),
            statistics=statistics(nodes, heads, deleted),
            lists={"lists": written},
            raw_bytes=sum(head.raw_bytes for head in heads),
        )

    def _head(self, view: View, sent: list[Lists]) -> Head:
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

    def details(self, payload: Payload) -> dict[str, np.ndarray]:
        """What was sent: `header` uint32 (h, w, 2), offset and count, and `fragments` uint32 (n, words), of node 0.

        Those of further nodes have its number behind their name, and those of further views `_view1`, `_view2` behind
        that. `list_view` and `list_projection` float64 (4, 4) are the lists' camera.
        """
        arrays = {}
        for number, message in enumerate(decode(payload.blobs["head"], payload.lists["lists"])):
            behind = f"_view{number}" if number else ""
            arrays |= {f"list_view{behind}": message.view, f"list_projection{behind}": message.projection}
            for node, (offsets, rows) in enumerate(message.nodes):
                header = np.stack([offsets[:-1], np.diff(offsets)], axis=1).astype(np.uint32)
                arrays[f"header{node or ''}{behind}"] = header.reshape(message.height, message.width, 2)
                arrays[f"fragments{node or ''}{behind}"] = rows
        return arrays

    def _fill(self, held: Held, lists: list[Lists]) -> None:
        """Before the first frame the display holds empty lists."""
        device = self.renderer.device
        held.lists = held.lists or [Lists.empty(device, part.width, part.height, part.words) for part in lists]

    def _unmatched(self, lists: list[Lists], view: View, held: Held) -> list[Lists]:
        """What moving a view's lists held does not give of each node's; `held` becomes what an exact merge gives.

        What moves to rays of another view is removed here and inserted there, as if it were new.
        """
        self._fill(held, lists)
        device, sent = self.renderer.device, []
        turn = turning(held.view.view if held.view else view.view, view.view)
        for node, part in enumerate(lists):
            moved = move_lists(device, held.lists[node], turn, view.projection, "structs/transform")
            changes = find_differences(device, moved, part, self.threshold, self.drift, "structs/match")
            held.lists[node] = apply_differences(device, moved, changes, part, "structs/hold")
            sent.append(changes)
        return sent

    def _changed(self, lists: list[Lists], view: View, held: Held) -> list[Lists]:
        """What changed of each node's lists of a view; `held` becomes what the display then holds."""
        self._fill(held, lists)
        device, sent = self.renderer.device, []
        still = held.view is not None and np.array_equal(held.view.matrix, view.matrix)
        tolerance = 0 if still else self.tolerance
        for node, part in enumerate(lists):
            before = held.lists[node]
            if self.detect == "list":
                changed = changed_lists(device, part, before, tolerance, DEPTH_SHARE, "structs/difference")
            else:
                if node not in held.shown:
                    held.shown[node] = self._picture(before)
                pictures = (held.shown[node], self._picture(part))
                changed = changed_colours(device, part, *pictures, tolerance, "structs/difference")
            held.lists[node] = splice_lists(device, before, changed, "structs/hold")
            sent.append(changed)
        return sent

    def _picture(self, lists: Lists):
        """What a node sees of its lists, over nothing."""
        device = self.renderer.device
        picture = device.recycled((lists.pixels, 4), np.uint8)
        device.fill(picture, 0, "structs/blend")
        blended = (lists.pixels, lists.offsets, lists.rows, lists.words, picture, picture)
        blend_lists(device, *blended, "structs/blend")
        return picture

    def client(self, scene: ClientScene) -> ListClient:
        """A client that holds nothing yet."""
        return ListClient(scene)


def list_views(frame: Frame) -> tuple[View, ...]:
    """The views that lists belong to: the cell's. One alone is widened by less than two pixels so that its pixels are
    the client's when the client has not moved; not without a predicted client view."""
    server = frame.server
    if len(frame.cell_views) > 1 or not frame.predicted:
        return frame.cell_views
    client = frame.predicted[0]
    width = client.width + 2 * max(0, -(-(server.width - client.width) // 2))
    height = client.height + 2 * max(0, -(-(server.height - client.height) // 2))
    projection = server.projection.copy()
    projection[0, 0] = client.projection[0, 0] * client.width / width
    projection[1, 1] = client.projection[1, 1] * client.height / height
    return (View(server.view, projection, width, height),)


def statistics(nodes: list[NodeLists], heads: Sequence[Head], deleted: int) -> dict[str, float]:
    """What the report shows of a frame's lists, over all views and nodes."""
    built, sent = sum(node.built for node in nodes), sum(sum(head.counts) for head in heads)
    header_bytes = sum(head.header_bytes for head in heads)
    longest = max(len(node.pixels_by_layers) for node in nodes)
    histogram = sum(np.pad(node.pixels_by_layers, (0, longest - len(node.pixels_by_layers))) for node in nodes)
    layers = {f"pixels_of_{k}_layers": int(n) for k, n in enumerate(histogram[:16])}
    return layers | {
        "pixels_of_more_layers": int(histogram[16:].sum()),
        "most_layers": longest - 1,
        "fragments_built": built,
        "fragments_kept": sum(node.lists.count for node in nodes),
        "fragments_sent": sent,
        "fragments_deleted": deleted,
        "share_saved": 1 - sent / built if built else 0.0,
        "header_bytes": header_bytes,
        "list_bytes": sum(head.raw_bytes for head in heads) - header_bytes,
        "padded_bytes": sum(head.padded_bytes for head in heads),
    }
