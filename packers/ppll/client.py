"""The display: it holds each node's lists, merges what arrives, and draws them from where the client is."""

from __future__ import annotations

import numpy as np

from kernels.ppll.lists import Lists, splice_lists
from kernels.ppll.match import merge_differences, move_lists, turning
from kernels.ppll.splat import draw_lists
from packers.interface import Client, Decoded, Image, ServerScene, View
from packers.ppll.wire import Message, WireError, decode


class ListClient(Client):
    """Draws the lists it holds over the sky. From the scene it uses the device and the sky behind everything."""

    def __init__(self, scene: ServerScene) -> None:
        self.device = scene.device
        self.sky = scene.shader.sky
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
        drawn = self.device.empty((view.height, view.width), np.int32)
        draw_lists(self.device, self.nodes, self.taken, (view.view, view.projection), rgb, drawn, "client")
        return Image(rgb, drawn)
