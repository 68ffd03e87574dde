"""Packers with one planted fault each: the documentation's example, but for one thing."""

import time
from typing import Any

import numpy as np

from shading_atlas_bench.packers.example.grid import Grid


class WrongTexel(Grid):
    """One texel has another colour than its sample."""

    name = "wrong-texel"

    def pack(self, frame):
        payload = super().pack(frame)
        if payload.sample_count:
            plane = payload.planes["atlas"].get()
            row, column = np.argwhere(plane[..., 3])[0]
            plane[row, column, :3] ^= 128
            payload.planes["atlas"].set(plane)
        return payload


class UnwrittenTexel(Grid):
    """One sample is left out."""

    name = "unwritten-texel"

    def pack(self, frame):
        payload = super().pack(frame)
        if payload.sample_count:
            samples, plane = payload.samples, payload.planes["atlas"].get()
            assert samples
            samples.count -= 1
            row, column = divmod(int(samples.texel.get()[samples.count]), plane.shape[1])
            plane[row, column] = 0
            payload.planes["atlas"].set(plane)
            payload.sample_count -= 1
        return payload


class Unsteady(Grid):
    """Other bytes every time."""

    name = "nondeterministic"
    packed = 0

    def pack(self, frame):
        payload = super().pack(frame)
        Unsteady.packed += 1
        payload.blobs["noise"] = Unsteady.packed.to_bytes(4, "little")
        return payload


class Crashing(Grid):
    """Cannot stand an empty set, and says so in its own words."""

    name = "crashing"

    def pack(self, frame):
        if not len(frame.pvs):
            raise IndexError("there is no first triangle")
        return super().pack(frame)


class Hanging(Grid):
    """Never ends."""

    name = "hanging"

    def pack(self, frame):
        while True:
            time.sleep(0.01)


class NotANumber(Grid):
    """A statistic that is not a number."""

    name = "not-a-number"

    def pack(self, frame):
        payload = super().pack(frame)
        payload.statistics["waste"] = float("nan")
        return payload


class Silent(Grid):
    """Does not say which triangles it left out."""

    name = "silent"

    def pack(self, frame):
        payload = super().pack(frame)
        payload.unplaced.clear()
        return payload


class Elsewhere(Grid):
    """Its client draws from one texel beside the right one."""

    name = "elsewhere"

    def client(self, scene):
        client: Any = super().client(scene)
        corners = client.corner_texels
        client.corner_texels = lambda: client.device.upload(corners().get() + np.float32(1))
        return client
