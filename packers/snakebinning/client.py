"""The client of SnakeBinning (section 3.9): records of places, shapes and weights to atlas coordinates."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.packers.atlas_client import AtlasClient
from shading_atlas_bench.packers.interface import ClientScene
from shading_atlas_bench.packers.snakebinning.kernels.corners import locate_corners
from shading_atlas_bench.packers.snakebinning.kernels.split import piece_maps, split_samples
from shading_atlas_bench.packers.snakebinning.records import PieceRecords, Records

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.samples import Samples


class SnakeBinningClient(AtlasClient):
    """Keeps the record of every triangle it was ever sent; draws as every atlas client, in perspective."""

    def __init__(self, scene: ClientScene) -> None:
        super().__init__(scene)
        self.records = Records()

    def read(self, blobs: Mapping[str, bytes]) -> None:
        """Update the records of the current triangles, which come in their order."""
        pvs, pieces = self.geometry.pvs, PieceRecords.decode(blobs["pieces"])
        self.records.decode(pvs, blobs["places"])
        place, sides, height, word = np.concatenate([self.records.words[pvs], pieces.words]).T
        self.maps = piece_maps(pieces.bary)
        self.pieces = np.zeros((len(pvs), 2), np.int32)
        found, first, count = np.unique(pieces.parents, return_index=True, return_counts=True)
        self.pieces[np.searchsorted(pvs, found)] = np.stack([first, count], axis=1)
        drawn = np.stack([sides & 0xFFFF, sides >> 16, height, 0 * height], axis=1).astype(np.uint16)
        self.places, self.drawn, self.words = (self.device.upload(values) for values in (place, drawn, word))

    def corner_texels(self) -> Array:
        """The corners of each triangle in its slot, homogeneous."""
        count = len(self.geometry.pvs) + len(self.maps)
        return locate_corners(self.device, self.places, self.drawn, self.words, count, "client/decode")

    def place(self, samples: Samples) -> Array:
        """Where the samples lie in their slots; those of sliced triangles in the slot of the piece they lie in."""
        if len(self.maps):
            pieces, maps = self.device.upload(self.pieces), self.device.upload(self.maps.astype(np.float32))
            samples = split_samples(self.device, samples, len(self.pieces), pieces, maps, "client/split")
        return super().place(samples)
