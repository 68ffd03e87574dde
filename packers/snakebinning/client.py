"""The client of SnakeBinning: records of places, shapes and weights to atlas coordinates."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.packers.atlas_client import AtlasClient
from shading_atlas_bench.packers.geometry import shuffle, unshuffle
from shading_atlas_bench.packers.interface import ClientScene
from shading_atlas_bench.packers.snakebinning.kernels.corners import locate_corners
from shading_atlas_bench.packers.snakebinning.kernels.split import piece_maps, split_samples

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.samples import Samples

PIECE_BYTES = 4 + 24 + 16
FIELDS = 4  # place, before | after << 16, height, weights and roles: see packers.snakebinning.kernels.place


def encode_records(records: np.ndarray, before: np.ndarray) -> bytes:
    """Records, uint32 (n, 4), as what changed since `before`: triangles that stay as they are become zeros.

    14 bytes each: the height takes 16 bits.
    """
    changes = records ^ before
    columns = [changes[:, 0], changes[:, 1], changes[:, 2].astype(np.uint16), changes[:, 3]]
    return b"".join(shuffle(column) for column in columns)


def decode_records(data: bytes, count: int) -> np.ndarray:
    """The changes, uint32 (n, 4), that `encode_records` wrote."""
    changes = np.empty((count, FIELDS), np.uint32)
    offset = 0
    for column, dtype in enumerate((np.uint32, np.uint32, np.uint16, np.uint32)):
        changes[:, column] = unshuffle(data, dtype, count, offset)
        offset += count * np.dtype(dtype).itemsize
    return changes


def encode_pieces(parents: np.ndarray, bary: np.ndarray, records: np.ndarray) -> bytes:
    """Pieces of sliced triangles: parents int32 (k), those of one together; barycentrics 1 and 2 of the corners in the
    parent (k, 3, 2), as float32; records uint32 (k, 4). No bytes for none."""
    return parents.astype("<i4").tobytes() + bary.astype("<f4").tobytes() + records.astype("<u4").tobytes()


def decode_pieces(data: bytes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What `encode_pieces` wrote; barycentrics float32."""
    count = len(data) // PIECE_BYTES
    parents = np.frombuffer(data, "<i4", count)
    bary = np.frombuffer(data, "<f4", 6 * count, 4 * count).reshape(count, 3, 2)
    return parents, bary, np.frombuffer(data, "<u4", FIELDS * count, 28 * count).reshape(count, FIELDS)


class SnakeBinningClient(AtlasClient):
    """Keeps the record of every triangle it was ever sent; draws as every atlas client, in perspective."""

    def __init__(self, scene: ClientScene) -> None:
        super().__init__(scene)
        self.records = np.zeros((0, FIELDS), np.uint32)

    def read(self, blobs: Mapping[str, bytes]) -> None:
        """Update the records of the current triangles, which come in their order."""
        pvs = self.geometry.pvs
        if len(pvs) and pvs[-1] >= len(self.records):
            more = np.zeros((int(pvs[-1] * 1.25) + 1 - len(self.records), FIELDS), np.uint32)
            self.records = np.concatenate([self.records, more])
        self.records[pvs] ^= decode_records(blobs["places"], len(pvs))
        parents, bary, pieces = decode_pieces(blobs["pieces"])
        place, sides, height, word = np.concatenate([self.records[pvs], pieces]).T
        self.maps = piece_maps(bary)
        self.pieces = np.zeros((len(pvs), 2), np.int32)
        found, first, count = np.unique(parents, return_index=True, return_counts=True)
        self.pieces[np.searchsorted(pvs, found)] = np.stack([first, count], axis=1)
        drawn = np.stack([sides & 0xFFFF, sides >> 16, height, 0 * height], axis=1).astype(np.uint16)
        self.uploaded = [self.device.upload(values) for values in (place, drawn, word)]

    def corner_texels(self) -> Array:
        """The corners of each triangle in its slot, homogeneous."""
        return locate_corners(self.device, *self.uploaded, len(self.geometry.pvs) + len(self.maps), "client/decode")

    def place(self, samples: Samples) -> Array:
        """Where the samples lie in their slots; those of sliced triangles in the slot of the piece they lie in."""
        if len(self.maps):
            pieces, maps = self.device.upload(self.pieces), self.device.upload(self.maps.astype(np.float32))
            samples = split_samples(self.device, samples, len(self.pieces), pieces, maps, "client/split")
        return super().place(samples)
