"""Packers that write to what they share with others, or are interrupted: the documentation's example, but for that."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from shading_atlas_bench.harness.errors import StopAsked
from shading_atlas_bench.packers.example.grid import Grid


class Rounding(Grid):
    """Takes the scene's positions for an array of its own, from a frame on."""

    name, first = "rounding", 0

    def pack(self, frame):
        if frame.index >= self.first:
            positions = frame.scene.triangles.positions
            positions.set(np.round(positions.get() * 4) / 4)
        return super().pack(frame)


class RoundingLater(Rounding):
    name, first = "rounding-later", 2


class Sorting(Grid):
    """Takes the list of visible triangles on the device for its own."""

    name = "sorting"

    def pack(self, frame):
        frame.pvs_device.set(frame.pvs[::-1].copy())
        return super().pack(frame)


@cache
def buffer(device, shape):
    return device.empty(shape, np.int32)


class Remembering(Grid):
    """Its clients draw into one buffer for all, which those of the last one overwrite."""

    name = "remembering"

    def client(self, scene):
        client: Any = super().client(scene)
        draw = client.draw

        def draw_into_the_buffer(view):
            image = draw(view)
            one = buffer(scene.device, image.triangle.shape)
            one.set(image.triangle.get() if type(self) is Remembering else np.full(one.shape, -1, np.int32))
            return replace(image, triangle=one)

        client.draw = draw_into_the_buffer
        return client


class RememberingNothing(Remembering):
    name = "remembering-nothing"


class Stopped(Grid):
    """Is interrupted in frame 2, once."""

    name = "stopped"
    interrupted = False

    def pack(self, frame):
        self.seen.add(frame.index)
        if self.seen >= {0, 1, 2} and not type(self).interrupted:  # while warming up it sees one frame only
            type(self).interrupted = True
            raise StopAsked
        return super().pack(frame)

    def prepare(self, scene):
        super().prepare(scene)
        self.seen = set()


class Fickle(Stopped):
    """Leaves out more triangles after the interruption."""

    name = "fickle"

    def pack(self, frame):
        few = frame.pvs[: len(frame.pvs) // 2]
        return super().pack(replace(frame, pvs=few) if self.interrupted else frame)


class Late(Stopped):
    """Says something by a name that earlier frames do not have."""

    name = "late"

    def pack(self, frame):
        made = super().pack(frame)
        if frame.index >= 2:
            made.blobs["late"] = b""
        return made
