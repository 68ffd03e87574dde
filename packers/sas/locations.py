"""The location words of a frame as they are sent: what changed since the last ones; blocks that stay are zeros."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.packers.geometry import shuffle, unshuffle

if TYPE_CHECKING:
    from shading_atlas_bench.arithmetic.arrays import Ints, Words


class Locations:
    """What a client knows, kept from frame to frame by both ends. words: uint32 (P), 0 for a patch without a block."""

    def __init__(self, patches: int = 0) -> None:
        self.words: Words = np.zeros(patches, np.uint32)

    def encode(self, patches: Ints, words: Words) -> bytes:
        """The message that gives these patches of the set, int32 (n), these words, uint32 (n)."""
        message = shuffle(words ^ self.words[patches])
        self.words[patches] = words
        return message

    def decode(self, patches: Ints, message: bytes) -> None:
        """Take the words of these patches of the set, int32 (n), of which there may be new ones."""
        if len(patches) and patches.max() >= len(self.words):
            more = int(patches.max() * 1.25) + 1 - len(self.words)
            self.words = np.concatenate([self.words, np.zeros(more, np.uint32)])
        self.words[patches] ^= unshuffle(message, np.uint32, len(patches))
