"""Records of triangles and pieces as they are sent: where a client finds them in the atlas (section 3.9)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.packers.geometry import shuffle, unshuffle

if TYPE_CHECKING:
    from shading_atlas_bench.arithmetic.arrays import Bools, Floats, Ints, Words
    from shading_atlas_bench.packers.snakebinning.slicing import Items, Slicing

PIECE_BYTES = 4 + 24 + 16
FIELDS = 4  # place, before | after << 16, height, weights and roles: see packers.snakebinning.kernels.place


class Records:
    """What a client knows of triangles, kept from frame to frame by both ends. words: uint32 (T, 4), zeros for one
    without a place."""

    def __init__(self, triangles: int = 0) -> None:
        self.words: Words = np.zeros((triangles, FIELDS), np.uint32)

    def encode(self, pvs: Ints, words: Words) -> bytes:
        """The message that gives the triangles of a set, pvs int32 (n), these words, uint32 (n, 4)."""
        message = encode_records(words, self.words[pvs])
        self.words[pvs] = words
        return message

    def decode(self, pvs: Ints, message: bytes) -> None:
        """Take the words of the triangles of a set, int32 (n), ascending, of which there may be new ones."""
        if len(pvs) and pvs[-1] >= len(self.words):
            more = int(pvs[-1] * 1.25) + 1 - len(self.words)
            self.words = np.concatenate([self.words, np.zeros((more, FIELDS), np.uint32)])
        self.words[pvs] ^= decode_records(message, len(pvs))


def encode_records(records: Words, before: Words) -> bytes:
    """Records, uint32 (n, 4), as what changed since `before`: triangles that stay as they are become zeros.

    14 bytes each: the height takes 16 bits.
    """
    changes = records ^ before
    columns = [changes[:, 0], changes[:, 1], changes[:, 2].astype(np.uint16), changes[:, 3]]
    return b"".join(shuffle(column) for column in columns)


def decode_records(data: bytes, count: int) -> Words:
    """The changes, uint32 (n, 4), that `encode_records` wrote."""
    changes = np.empty((count, FIELDS), np.uint32)
    offset = 0
    for column, size in enumerate((4, 4, 2, 4)):
        changes[:, column] = unshuffle(data, np.dtype(f"u{size}"), count, offset)
        offset += count * size
    return changes


@dataclass(frozen=True)
class PieceRecords:
    """Pieces of sliced triangles.

    parents: int32 (k), those of one together. bary: float32 (k, 3, 2), barycentrics 1 and 2 of the corners in the
    parent. words: uint32 (k, 4), records.
    """

    parents: Ints
    bary: Floats
    words: Words

    def encode(self) -> bytes:
        """No bytes for none."""
        arrays = (self.parents.astype("<i4"), self.bary.astype("<f4"), self.words.astype("<u4"))
        return b"".join(array.tobytes() for array in arrays)

    @classmethod
    def decode(cls, data: bytes) -> PieceRecords:
        """What `encode` wrote."""
        count = len(data) // PIECE_BYTES
        bary = np.frombuffer(data, "<f4", 6 * count, 4 * count).reshape(count, 3, 2)
        words = np.frombuffer(data, "<u4", FIELDS * count, 28 * count).reshape(count, FIELDS)
        return cls(np.frombuffer(data, "<i4", count), bary, words)


@dataclass(frozen=True)
class SetRecords:
    """What is sent of a frame's set.

    words: uint32 (n, 4), zeros for triangles without a place and for sliced ones. pieces: of those of which all have a
    place. is_sliced: bool (n). missing: int32 (m), the triangles without a place.
    """

    words: Words
    pieces: PieceRecords
    is_sliced: Bools
    missing: Ints

    @classmethod
    def of(cls, pvs: Ints, items: Items, slicing: Slicing, left_out: Bools, listed: Words) -> SetRecords:
        """Those of a set, pvs int32 (n), of which some are left out.

        left_out: bool (T + MOST), see Filling. listed: uint32 (m, 4), records of the items.
        """
        slices = slicing.slices
        parents = slices.parents[items.shown]
        is_sliced = np.isin(pvs, parents)
        is_listed = ~is_sliced & ~left_out[pvs]
        whole = np.count_nonzero(is_listed)
        words, of_pieces = (np.zeros((count, FIELDS), np.uint32) for count in (len(pvs), len(parents)))
        words[is_listed] = listed[:whole]
        of_pieces[~left_out[slicing.first + items.shown]] = listed[whole:]
        lost = np.unique(parents[of_pieces[:, 0] == 0])  # a triangle is there as a whole, or not at all
        sent = ~np.isin(parents, lost)
        bary = slices.bary[items.shown][sent][:, :, 1:].astype(np.float32)
        pieces = PieceRecords(parents[sent], bary, of_pieces[sent])
        return cls(words, pieces, is_sliced, np.concatenate([pvs[~is_sliced & (words[:, 0] == 0)], lost]))
