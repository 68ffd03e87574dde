"""A client's picture: bilinear lookups of each pixel's surface point in the atlas."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Bytes, Doubles
from shading_atlas_bench.kernels.samples import Samples

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device


def look_up(
    device: Device, samples: Samples, places: Array, ids: Array, plane: Array, rgb: Array, drawn: Array, stage: str
) -> None:
    """Colour the pixels of `samples`.

    places: float32 (2, room), column and row in the atlas of each sample's surface point, where texel (0, 0) has its
    centre at (0, 0); NaN for one without a place, whose pixel is left alone. The room is a multiple of 8, as that of
    `locate` is, because 8 are read at a time; what lies beyond the count changes nothing. ids: int32 (n), what `drawn`
    calls the triangles. plane: uint8 (H, W, 4).
    rgb: uint8 (h, w, 4), drawn: int32 (h, w); both written where there is a sample. Bytes are interpolated as they are
    (sRGB, not linear light), as texture units do without an sRGB format: the decoded video is such a texture.
    Raises ValueError for a room that is too small or no multiple of 8.
    """
    if samples.count == 0:
        return
    room = places.shape[1]
    if room < samples.count or room % 8:
        raise ValueError(f"places has room for {room} samples: give it a multiple of 8, at least {samples.count}.")
    height, width = plane.shape[:2]
    arrays = (samples.triangle, samples.texel, places, ids, plane)
    kernel = device.build("atlas/lookup.cl").look_up
    items = -(-samples.count // 8)
    device.launch(stage, kernel, items, samples.count, room, *arrays, width, height, rgb, drawn)


def look_up_twin(places: Doubles, plane: Bytes) -> Doubles:
    """Colours float64 (n, 3), not rounded, of n lookups at columns and rows (n, 2); NaN without a place."""
    placed = np.all(np.isfinite(places), axis=1)
    position = np.where(placed[:, None], places, 0)
    base = np.floor(position)
    fraction = position - base
    colour = np.zeros((len(places), 3))
    for dx in (0, 1):
        for dy in (0, 1):
            weight = np.where([dx, dy], fraction, 1 - fraction).prod(axis=1)
            column = np.clip(base[:, 0] + dx, 0, plane.shape[1] - 1).astype(int)
            row = np.clip(base[:, 1] + dy, 0, plane.shape[0] - 1).astype(int)
            colour += weight[:, None] * plane[row, column, :3]
    colour[~placed] = np.nan
    return colour
