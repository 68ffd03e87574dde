"""The client of Shading Atlas Streaming: location words to atlas coordinates."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.packers.atlas_client import AtlasClient
from shading_atlas_bench.packers.geometry import shuffle, unshuffle
from shading_atlas_bench.packers.interface import ClientScene
from shading_atlas_bench.packers.sas.kernels.corners import locate_corners

if TYPE_CHECKING:
    from pyopencl.array import Array

ATTRIBUTES = {"patch": np.int32, "code": np.uint8}


def encode_words(words: np.ndarray, before: np.ndarray) -> bytes:
    """Location words, uint32 (n), as what changed since `before`: blocks that stay become zeros."""
    return shuffle(words ^ before)


class ShadingAtlasClient(AtlasClient):
    """Keeps the location word of every patch; draws as every atlas client."""

    attributes = ATTRIBUTES

    def __init__(self, scene: ClientScene) -> None:
        super().__init__(scene)
        self.words = np.empty(0, np.uint32)

    def read(self, blobs: Mapping[str, bytes]) -> None:
        """Update the words of the current patches, which come in the order of their first triangle in the set."""
        self.patches, self.codes = self.geometry.current("patch"), self.geometry.current("code")
        ids, first = np.unique(self.patches, return_index=True)
        ids = ids[np.argsort(first)]
        if len(ids) and ids.max() >= len(self.words):
            self.words = np.concatenate([self.words, np.zeros(int(ids.max() * 1.25) + 1 - len(self.words), np.uint32)])
        self.words[ids] ^= unshuffle(blobs["locations"], np.uint32, len(ids))
        self.uploaded = [self.device.upload(values) for values in (self.patches, self.codes, self.words)]

    def corner_texels(self) -> Array:
        """The corners of each triangle in its patch's block."""
        patches, codes, words = self.uploaded
        return locate_corners(self.device, patches, codes, len(self.patches), words, "client/decode")
