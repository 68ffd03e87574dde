"""Blending fragment lists into a picture."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from pyopencl.array import Array

    from kernels.device import Device


def blend_lists(
    device: Device, pixels: int, offsets: Array, rows: Array, words: int, background: Array, picture: Array, stage: str
) -> None:
    """Composite every pixel's fragments over `background` into `picture`, both uint8 (..., 4) of `pixels`, sRGB.

    offsets: int32 (pixels + 1) into rows, uint32 (n, words), RGBA bytes first, nearest first. background and picture
    may be the same. Alpha is how much is covered, 255 over an opaque background.
    """
    kernel = device.build("ppll/blend.cl").blend_lists
    device.launch(stage, kernel, pixels, pixels, offsets, rows, words, background, picture)


def blend_twin(offsets: np.ndarray, rgba: np.ndarray, background: np.ndarray) -> np.ndarray:
    """float64 (P, 4) of offsets (P + 1), rgba uint8 (n, 4) nearest first, and background uint8 (P, 4): from the
    farthest fragment to the nearest, eq. 1.1 of the thesis."""
    out = background.astype(np.float64)
    for pixel, (first, end) in enumerate(itertools.pairwise(offsets)):
        for r, g, b, a in rgba[first:end][::-1].astype(np.float64):
            alpha = a / 255
            out[pixel] = alpha * np.array([r, g, b, 255]) + (1 - alpha) * out[pixel]
    return out
