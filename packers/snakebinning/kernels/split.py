"""A client's samples on sliced triangles: which piece each lies in."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.matrices import inverse
from shading_atlas_bench.kernels.samples import Samples

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic import arrays
    from shading_atlas_bench.arithmetic.arrays import Doubles
    from shading_atlas_bench.kernels.device import Device

HERE = Path(__file__).parent


def piece_maps(bary: arrays.Array) -> Doubles:
    """float64 (k, 6): what takes barycentrics 1 and 2 in the parent to those in pieces: o1 and o2 of the piece's corner
    0, then a, b of a (b1 - o1) + b (b2 - o2) for the piece's 1, then for its 2. bary: (k, 3, 2), those of the pieces'
    corners in the parent."""
    corners = bary.astype(np.float64)
    edges = (corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1)
    steps = inverse(edges)
    return np.concatenate([corners[:, 0], steps.reshape(-1, 4)], axis=1)


def split_samples(device: Device, samples: Samples, triangles: int, pieces: Array, maps: Array, stage: str) -> Samples:
    """The samples with their pieces in place of triangles that are sliced, and the barycentrics likewise.

    pieces: int32 (triangles, 2), first piece of each and how many. maps: float32 (k, 6), see piece_maps. Piece k
    becomes triangle `triangles` + k. A sample belongs to the piece in which its smallest weight is largest, of equals
    the first; its weights are kept inside the piece.
    """
    split = replace(Samples.allocate(device, samples.count), footprint=samples.footprint, texel=samples.texel)
    kernel = device.build(HERE / "split.cl").split_samples
    before, after = ((s.triangle, s.bary1, s.bary2) for s in (samples, split))
    device.launch(stage, kernel, samples.count, samples.count, triangles, pieces, maps, *before, *after)
    return split


def split_samples_twin(
    triangle: arrays.Array, bary: arrays.Array, pieces: arrays.Array, maps: arrays.Array
) -> tuple[arrays.Array, Doubles]:
    """The same for triangles (n) and barycentrics (n, 2), float64."""
    triangle, bary = triangle.copy(), bary.astype(np.float64)
    first, count = pieces[triangle].T
    sliced = np.flatnonzero(count)
    if not sliced.size:
        return triangle, bary
    first, count = first[sliced], count[sliced]
    start = np.cumsum(count) - count  # of each sample's candidates in the flat list of all of them
    piece = np.arange(count.sum()) - np.repeat(start - first, count)
    step = np.repeat(bary[sliced], count, axis=0) - maps[piece, :2]
    own = np.einsum("krc,kc->kr", maps[piece, 2:].reshape(-1, 2, 2), step)
    least = np.minimum(own.min(axis=1), 1 - own.sum(axis=1))
    candidates = np.flatnonzero(least == np.repeat(np.maximum.reduceat(least, start), count))
    best = candidates[np.searchsorted(candidates, start)]
    inside = np.maximum(own[best], 0)
    triangle[sliced] = len(pieces) + piece[best]
    bary[sliced] = inside / np.maximum(inside.sum(axis=1), 1)[:, None]
    return triangle, bary
