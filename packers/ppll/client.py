"""The display: it holds each node's lists, merges what arrives, and draws them from where the client is."""

from __future__ import annotations

import numpy as np

from kernels.ppll.lists import Lists, splice_lists
from kernels.ppll.match import merge_differences, move_lists, turning
from kernels.ppll.rows import COLOUR_WORDS
from kernels.ppll.splat import draw_lists
from packers.interface import Client, ClientScene, Decoded, HeldLists, Image, View
from packers.ppll.wire import Message, WireError, decode


class ListClient(Client):
    """Draws the lists it holds over the sky."""

    def __init__(self, scene: ClientScene) -> None:
        self.device = scene.device
        self.sky = scene.sky
        self.nodes: list[Lists] = []

    def receive(self, payload: Decoded) -> None:
        """Take a frame's lists: all of them, or what changed."""
        message = decode(payload.blobs["head"], payload.lists["lists"])
        size = (message.width, message.height)
        arrived = [Lists.upload(self.device, *size, *node) for node in message.nodes]
        if self.nodes and message.mode in ("difference", "bilateral"):
            if size != (self.nodes[0].width, self.nodes[0].height) or len(arrived) != len(self.nodes):
                raise WireError("The differences are to lists of another size, or of other nodes, than those held.")
            held = zip(self.nodes, arrived, strict=True)
            merge = self._moved_and_merged if message.mode == "bilateral" else self._spliced
            arrived = [merge(old, new, message) for old, new in held]
        self.nodes = arrived
        self.taken = (message.view, message.projection)

    def _spliced(self, held: Lists, changes: Lists, message: Message) -> Lists:
        return splice_lists(self.device, held, changes, "client/merge")

    def _moved_and_merged(self, held: Lists, changes: Lists, message: Message) -> Lists:
        moved = move_lists(
            self.device, held, turning(self.taken[0], message.view), message.projection, "client/transform"
        )
        accepting = message.threshold if message.merge == "paper" else None
        return merge_differences(self.device, moved, changes, accepting, "client/merge")

    def draw(self, view: View) -> Image:
        """The view: sky, and over it all nodes' fragments, merged by depth."""
        rgb = self.device.empty((view.height, view.width, 4), np.uint8)
        self.sky(view.view, view.projection, rgb, stage="client/sky")
        depth = self.device.empty((view.height, view.width), np.float32)
        draw_lists(self.device, self.nodes, self.taken, (view.view, view.projection), rgb, depth, "client")
        return Image(rgb, None, depth)

    def fragments(self) -> tuple[HeldLists, ...]:
        """Each node's lists."""
        return tuple(self._neutral(lists) for lists in self.nodes)

    def _neutral(self, lists: Lists) -> HeldLists:
        offsets, rows = lists.host()
        view = View(*self.taken, lists.width, lists.height)
        rgba = np.ascontiguousarray(rows[:, 0]).view(np.uint8).reshape(-1, 4)
        last = np.ascontiguousarray(rows[:, -1]).view(np.float32)
        if lists.words == COLOUR_WORDS:
            return HeldLists(view, offsets.astype(np.int64), rgba, last)
        depth = np.float32(view.projection[2, 3]) / np.maximum(last, np.finfo(np.float32).tiny)
        return HeldLists(view, offsets.astype(np.int64), rgba, depth, normals=True)
