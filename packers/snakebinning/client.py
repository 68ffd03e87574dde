"""The client of SnakeBinning: records of places, shapes and weights to atlas coordinates."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from kernels.snakebinning.corners import locate_corners
from packers.atlas_client import AtlasClient
from packers.geometry import shuffle, unshuffle
from packers.interface import ServerScene

if TYPE_CHECKING:
    from pyopencl.array import Array

FIELDS = 4  # place, before | after << 16, height, weights and roles: see kernels.snakebinning.place


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


class SnakeBinningClient(AtlasClient):
    """Keeps the record of every triangle it was ever sent; draws as every atlas client, in perspective."""

    def __init__(self, scene: ServerScene) -> None:
        super().__init__(scene)
        self.records = np.zeros((0, FIELDS), np.uint32)

    def read(self, blobs: Mapping[str, bytes]) -> None:
        """Update the records of the current triangles, which come in their order."""
        pvs = self.geometry.pvs
        if len(pvs) and pvs[-1] >= len(self.records):
            more = np.zeros((int(pvs[-1] * 1.25) + 1 - len(self.records), FIELDS), np.uint32)
            self.records = np.concatenate([self.records, more])
        self.records[pvs] ^= decode_records(blobs["places"], len(pvs))
        place, sides, height, word = self.records[pvs].T
        drawn = np.stack([sides & 0xFFFF, sides >> 16, height, 0 * height], axis=1).astype(np.uint16)
        self.uploaded = [self.device.upload(values) for values in (place, drawn, word)]

    def corner_texels(self) -> Array:
        """The corners of each triangle in its slot, homogeneous."""
        return locate_corners(self.device, *self.uploaded, len(self.geometry.pvs), "client/decode")
