"""A client's picture: bilinear lookups of each pixel's surface point in the atlas."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kernels.samples import Samples

if TYPE_CHECKING:
    from pyopencl.array import Array

    from kernels.device import Device


def look_up(
    device: Device, samples: Samples, corners: Array, ids: Array, plane: Array, rgb: Array, drawn: Array, stage: str
) -> None:
    """Colour the pixels of `samples`.

    corners: float32 (n, 3, 2), column and row in the atlas of each triangle's corners, or float32 (n, 3, 3), column
    times w, row times w, and w, for perspective-correct lookups; NaN for a triangle without a place, whose pixels are
    left alone. ids: int32 (n), what `drawn` calls the triangles. plane: uint8 (H, W, 4).
    rgb: uint8 (h, w, 4), drawn: int32 (h, w); both written where there is a sample. Bytes are interpolated as they are
    (sRGB, not linear light), as texture units do without an sRGB format: the decoded video is such a texture.
    """
    if samples.count == 0:
        return
    height, width = plane.shape[:2]
    arrays = (samples.triangle, samples.bary1, samples.bary2, samples.texel, corners, ids, plane)
    kernel = device.build("atlas/lookup.cl", CORNER=corners.shape[-1]).look_up
    device.launch(stage, kernel, -(-samples.count // 8), samples.count, *arrays, width, height, rgb, drawn)


def look_up_twin(corners: np.ndarray, triangle: np.ndarray, bary: np.ndarray, plane: np.ndarray) -> np.ndarray:
    """Colours float64 (n, 3), not rounded, of n lookups; NaN for triangles without a place.

    triangle: int (n). bary: (n, 2), weights of corners 1 and 2.
    """
    weights = np.concatenate([1 - bary.sum(axis=1, keepdims=True), bary], axis=1)
    position = np.einsum("nk,nkc->nc", weights, corners[triangle].astype(np.float64))
    if corners.shape[-1] == 3:
        position = position[:, :2] / position[:, 2:]
    position -= 0.5
    placed = np.isfinite(position).all(axis=1)
    position[~placed] = 0
    base = np.floor(position)
    fraction = position - base
    colour = np.zeros((len(bary), 3))
    for dx in (0, 1):
        for dy in (0, 1):
            weight = np.where([dx, dy], fraction, 1 - fraction).prod(axis=1)
            column = np.clip(base[:, 0] + dx, 0, plane.shape[1] - 1).astype(int)
            row = np.clip(base[:, 1] + dy, 0, plane.shape[0] - 1).astype(int)
            colour += weight[:, None] * plane[row, column, :3]
    colour[~placed] = np.nan
    return colour
