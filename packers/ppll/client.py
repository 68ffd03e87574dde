"""The display: it holds each view's and node's lists, merges what arrives, and draws them from where the client is."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.packers.interface import Client, ClientScene, Decoded, HeldLists, Image, View
from shading_atlas_bench.packers.ppll.kernels.lists import Lists, ListView, splice_lists
from shading_atlas_bench.packers.ppll.kernels.match import merge_differences, move_lists, turning
from shading_atlas_bench.packers.ppll.kernels.rows import COLOUR_WORDS
from shading_atlas_bench.packers.ppll.kernels.splat import draw_lists
from shading_atlas_bench.packers.ppll.wire import DIFFERENCES, Message, WireError, decode

if TYPE_CHECKING:
    from shading_atlas_bench.arithmetic.arrays import Floats


class ListClient(Client):
    """Draws the lists it holds over the sky."""

    def __init__(self, scene: ClientScene) -> None:
        self.device = scene.device
        self.sky = scene.sky
        self.held: list[ListView] = []

    def receive(self, payload: Decoded) -> None:
        """Take a frame's lists: all of them, or what changed."""
        messages = decode(payload.blobs["head"], payload.lists["lists"])
        arrived = [self._upload(message) for message in messages]
        if self.held and messages[0].mode in DIFFERENCES:
            if _sizes(arrived) != _sizes(self.held):
                raise WireError("The differences are to lists of another size, views or nodes than those held.")
            pairs = zip(messages, self.held, arrived, strict=True)
            arrived = [self._merged(message, held, changes) for message, held, changes in pairs]
        self.held = arrived

    def _upload(self, message: Message) -> ListView:
        size = (message.width, message.height)
        lists = [Lists.upload(self.device, *size, *node) for node in message.nodes]
        return ListView(View(message.view, message.projection, *size), lists)

    def _merged(self, message: Message, held: ListView, changes: ListView) -> ListView:
        """A view's lists, of which `changes` arrived."""
        device, view = self.device, changes.view
        pairs = zip(held.lists, changes.lists, strict=True)
        if message.mode == "difference":
            return ListView(view, [splice_lists(device, old, new, "client/merge") for old, new in pairs])
        turn, accepting = turning(held.view.view, view.view), message.threshold if message.merge == "paper" else None
        moved = ((move_lists(device, old, turn, view.projection, "client/transform"), new) for old, new in pairs)
        return ListView(view, [merge_differences(device, old, new, accepting, "client/merge") for old, new in moved])

    def draw(self, view: View) -> Image:
        """The view: sky, and over it all views' and nodes' fragments, merged by depth."""
        rgb = self.device.empty((view.height, view.width, 4), np.uint8)
        self.sky(view.view, view.projection, rgb, stage="client/sky")
        depth = self.device.empty((view.height, view.width), np.float32)
        draw_lists(self.device, self.held, view, rgb, depth, "client")
        return Image(rgb, None, depth)

    def fragments(self) -> tuple[HeldLists, ...]:
        """Each view's and node's lists."""
        return tuple(_neutral(view, part) for view, lists in self.held for part in lists)


def _sizes(held: list[ListView]) -> list[list[tuple[int, int]]]:
    return [[(part.width, part.height) for part in lists] for _, lists in held]


def _neutral(view: View, lists: Lists) -> HeldLists:
    offsets, rows = lists.host()
    rgba = np.ascontiguousarray(rows[:, 0]).view(np.uint8).reshape(-1, 4)
    last = np.ascontiguousarray(rows[:, -1]).view(np.float32)
    if lists.words == COLOUR_WORDS:
        return HeldLists(view, offsets.astype(np.int64), rgba, last)
    near = np.float32(view.projection[2, 3])
    depth: Floats = np.divide(near, np.maximum(last, np.finfo(np.float32).tiny))
    return HeldLists(view, offsets.astype(np.int64), rgba, depth, normals=True)
