"""Blending fragment lists into a picture."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic import arrays
from shading_atlas_bench.arithmetic.arrays import Bytes, Doubles

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.kernels.fragments.build import Fragments


def blend_lists(
    device: Device, pixels: int, offsets: Array, rows: Array, words: int, background: Array, picture: Array, stage: str
) -> None:
    """Composite every pixel's fragments over `background` into `picture`, both uint8 (..., 4) of `pixels`, sRGB.

    offsets: int32 (pixels + 1) into rows, uint32 (n, words), RGBA bytes first, nearest first. background and picture
    may be the same. Alpha is how much is covered, 255 over an opaque background.
    """
    kernel = device.build("fragments/blend.cl").blend_lists
    device.launch(stage, kernel, pixels, pixels, offsets, rows, words, background, picture)


def blend_layers(
    device: Device,
    fragments: Fragments,
    colours: Array,
    opacity: Array,
    ids: Array,
    picture: Array,
    nearest: Array,
    stage: str,
) -> None:
    """Blend fragments over `picture`, uint8 (h, w, 4), sRGB, and write the nearest visible one's id into `nearest`.

    colours: uint8 (n, 4), not multiplied by opacity. opacity: int32 (n), 0..255; at 0 a fragment is not there.
    ids: int32 (n). nearest: int32 (h, w). Pixels without visible fragments stay as they are.
    """
    inputs = (fragments.offsets, colours, opacity, ids, picture, nearest)
    device.launch(stage, device.build("fragments/blend.cl").blend_layers, fragments.pixels, fragments.pixels, *inputs)


def blend_twin(offsets: arrays.Array, rgba: Bytes, background: Bytes) -> Doubles:
    """float64 (P, 4) of offsets (P + 1), rgba uint8 (n, 4) nearest first, and background uint8 (P, 4): from the
    farthest fragment to the nearest, eq. 1.1 of the thesis."""
    out = background.astype(np.float64)
    for pixel, (first, end) in enumerate(itertools.pairwise(offsets)):
        for r, g, b, a in rgba[first:end][::-1].astype(np.float64):
            alpha = a / 255
            out[pixel] = alpha * np.array([r, g, b, 255]) + (1 - alpha) * out[pixel]
    return out


def nearest_twin(offsets: arrays.Array, opacity: arrays.Array, ids: arrays.Array, behind: arrays.Array) -> arrays.Array:
    """What `blend_layers` notes, int (P), of offsets (P + 1), opacity and ids (n), and what was there before, (P)."""
    out = behind.copy()
    for pixel, (first, end) in enumerate(itertools.pairwise(offsets)):
        visible = np.flatnonzero(opacity[first:end] > 0)
        if len(visible):
            out[pixel] = ids[first + visible[0]]
    return out
