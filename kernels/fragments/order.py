"""Fragments in the order in which they are shaded fastest: tile by tile, and in a tile triangle by triangle."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic import arrays
from shading_atlas_bench.kernels.samples import Samples

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.kernels.fragments.build import Fragments

TILE = 32  # pixels
BUCKETS = 256  # triangles whose numbers differ by a multiple of this are not told apart; a power of two


def order_fragments(device: Device, fragments: Fragments, stage: str) -> Samples:
    """The fragments' samples by tile and triangle; their texels are the fragments' places in the lists, as in a picture
    of one row with all of them."""
    ordered = Samples.allocate(device, fragments.count)
    columns, rows = -(-fragments.width // TILE), -(-fragments.height // TILE)
    size = (columns * rows, columns, fragments.width, fragments.height)
    kernel = device.build("fragments/order.cl", TILE=TILE, BUCKETS=BUCKETS).order_fragments
    arrays = (*_arrays(fragments.samples), *_arrays(ordered), ordered.texel)
    device.launch(stage, kernel, size[0], *size, fragments.offsets, *arrays, local=1)
    return ordered


def _arrays(samples: Samples) -> tuple[Array, Array, Array, Array]:
    return samples.triangle, samples.bary1, samples.bary2, samples.footprint


def order_twin(offsets: arrays.Array, triangle: arrays.Array, width: int) -> arrays.Array:
    """int64 (n), which fragment comes where: offsets int (P + 1) and triangle int (n) of lists in rows of `width`."""
    pixel = np.repeat(np.arange(len(offsets) - 1), np.diff(offsets))
    row, column = pixel // width, pixel % width
    return np.lexsort((triangle % BUCKETS, column // TILE, row // TILE))
