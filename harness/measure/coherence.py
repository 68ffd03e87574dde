"""How full an atlas is, and how much of it stays as it was from one frame to the next."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Bytes, Ints

ROWS = 8  # of an atlas, at a time: they stay in the processor's cache


@dataclass(frozen=True)
class AtlasUse:
    """fill: owned / all texels. coherence and coherence_bytes as `AtlasHistory.update` says; None where undefined."""

    fill: float
    coherence: float | None
    coherence_bytes: float | None


class AtlasHistory:
    """Remembers one packer's last atlas, to compare the next with."""

    def __init__(self) -> None:
        self._owner: Ints | None = None
        self._plane: Bytes | None = None

    def update(self, owner: Ints, plane: Bytes) -> AtlasUse:
        """Compare a frame's atlas with the last one, and remember it; the arrays must not be changed afterwards.

        owner: int32 (H, W), triangle of each texel, -1 where none. plane: uint8 (H, W, C).

        coherence: of the texels owned in this frame, the share that had the same owner in the last frame.
        coherence_bytes: of all colour bytes of the plane (the first three channels), the share equal to the last
        frame's. Both None in the first frame and when the atlas changes its size; coherence also when nothing is owned.
        """
        owned = owner >= 0
        count = int(np.count_nonzero(owned))
        coherence = coherence_bytes = None
        if self._owner is not None and self._owner.shape == owner.shape:
            owned &= owner == self._owner
            coherence = int(np.count_nonzero(owned)) / count if count else None
        if self._plane is not None and self._plane.shape == plane.shape:
            coherence_bytes = _equal_colour_bytes(plane, self._plane) / (3 * plane.shape[0] * plane.shape[1])
        self._owner, self._plane = owner, plane
        return AtlasUse(count / owner.size, coherence, coherence_bytes)


def _equal_colour_bytes(plane: Bytes, last: Bytes) -> int:
    """Bytes of the first three channels that are equal."""
    height, width, channels = plane.shape
    colour = np.tile(np.arange(channels) < 3, ROWS * width)  # strides are slow
    found, equal = 0, np.empty((ROWS, width, channels), bool)
    for start in range(0, height, ROWS):
        rows = plane[start : start + ROWS]
        some = np.equal(rows, last[start : start + ROWS], out=equal[: len(rows)]).reshape(-1)
        found += int(np.count_nonzero(np.logical_and(some, colour[: len(some)], out=some)))
    return found
