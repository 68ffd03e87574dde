"""The metadata of a frame: what tells the client where each primitive lies.

camera        float32 (21) the server's camera, see packers.tss.kernels.footprint, and texels per pixel
pieces        uint32 (n) rows of the triangles that are cut into pieces, as differences, and uint8 (n) into how many
              along an edge
strategies    a bit per primitive: 1 for Oversampling
lpacking      uint32 per L or single texel: level | rank in the level's bin << 7
oversampling  4 uint32 per primitive: two places; texels before | after the foot << 16; height | first corner << 16
regions       int32 (65, 6) where the bins of the levels lie, see packers.tss.kernels.layout
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from shading_atlas_bench.packers.geometry import shuffle, unshuffle
from shading_atlas_bench.packers.tss.kernels.bins import Bins
from shading_atlas_bench.packers.tss.kernels.forms import OVERSAMPLED
from shading_atlas_bench.packers.tss.kernels.layout import REGION, place_items_twin
from shading_atlas_bench.packers.tss.kernels.locate import UNPLACED
from shading_atlas_bench.packers.tss.kernels.pattern import LEVELS
from shading_atlas_bench.packers.tss.placement import Placement

if TYPE_CHECKING:
    from shading_atlas_bench.arithmetic.arrays import Floats, Ints, Words

LOST = (1 << 25) - 1  # as a rank: no place
CAMERA = 22


@dataclass(frozen=True)
class Records:
    """What the client knows of a frame: camera float32 (21), scale, pieces and starts int32 (rows), and records int32
    (m, 4) as packers.tss.kernels.locate reads them."""

    camera: Floats
    scale: float
    pieces: Ints
    starts: Ints
    records: Ints


def encode(placement: Placement, bins: Bins) -> dict[str, bytes]:
    """The blobs of a frame."""
    forms, places = placement.forms, placement.places
    halves = forms[:, 0] == OVERSAMPLED
    cut = np.flatnonzero(placement.pieces > 1)
    ranks = np.where(places[:, 0] >= 0, placement.ranks, LOST).astype(np.uint32)
    words = forms[:, 0].astype(np.uint32) | ranks << 7
    height, before, after = forms[halves, 1:].T
    quads = [*places[halves].T, before | after << 16, height | placement.firsts[halves] << 16]
    return {
        "camera": np.append(placement.camera, np.float32(placement.scale)).astype("<f4").tobytes(),
        "pieces": shuffle(np.diff(cut, prepend=0).astype(np.uint32)) + placement.pieces[cut].astype(np.uint8).tobytes(),
        "strategies": np.packbits(halves).tobytes(),
        "lpacking": shuffle(words[~halves]),
        "oversampling": shuffle(np.stack(quads, axis=1).astype(np.int32).astype(np.uint32)),
        "regions": shuffle(placement.regions[bins.of_level].astype(np.int32)),
    }


def decode(blobs: Mapping[str, bytes], rows: int, bins: Bins) -> Records:
    """What `encode` said, for a client with `rows` triangles."""
    camera = np.frombuffer(blobs["camera"], "<f4", CAMERA)
    cut = len(blobs["pieces"]) // 5
    pieces = np.ones(rows, np.int32)
    at = np.cumsum(unshuffle(blobs["pieces"], np.uint32, cut).astype(np.int64))
    pieces[at] = np.frombuffer(blobs["pieces"], np.uint8, cut, 4 * cut)
    ends = np.cumsum(np.square(pieces, dtype=np.int64))
    count = int(ends[-1]) if rows else 0
    halves = np.unpackbits(np.frombuffer(blobs["strategies"], np.uint8), count=count).astype(bool)
    records = np.zeros((count, 4), np.int32)
    regions = unshuffle(blobs["regions"], np.int32, (LEVELS + 1) * REGION).reshape(-1, REGION)
    words = unshuffle(blobs["lpacking"], np.uint32, count - int(halves.sum()))
    records[~halves] = _decode_l(words, regions, bins)
    quads = unshuffle(blobs["oversampling"], np.uint32, 4 * int(halves.sum())).view(np.int32).reshape(-1, 4)
    records[halves] = _decode_halves(quads)
    starts = (ends - pieces * pieces).astype(np.int32)
    return Records(camera[:-1], float(camera[-1]), pieces, starts, records)


def _decode_l(words: Words, regions: Ints, bins: Bins) -> Ints:
    level, rank = (words & 127).astype(np.int32), (words >> 7).astype(np.int64)
    sizes = bins.width[bins.of_level], bins.height[bins.of_level]
    lost = rank == LOST
    places = place_items_twin(level, np.where(lost, 0, rank), *sizes, regions, 1 << 15)
    records = np.zeros((len(words), 4), np.int32)
    records[:, 0], records[:, 1] = np.where(lost, UNPLACED, level), places
    return records


def _decode_halves(quads: Ints) -> NDArray[np.integer[Any]]:
    before, after = quads[:, 2] & 0xFFFF, quads[:, 2] >> 16
    height, first = quads[:, 3] & 0xFFFF, quads[:, 3] >> 16
    lost = (quads[:, 0] < 0) & (quads[:, 1] < 0)
    size = before | after << 10 | height << 20
    return np.stack([np.where(lost, UNPLACED, -1 - first), quads[:, 0], quads[:, 1], size], axis=1)
