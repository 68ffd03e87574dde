"""Mip chains: each level is the area average of the one before, in linear light."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from shading_atlas_bench.arithmetic.arrays import Array, Bools, Bytes, Doubles, Floats
from shading_atlas_bench.arithmetic.functions import power

Number = TypeVar("Number", np.float32, np.uint16)


def srgb_to_linear(encoded: Array) -> Doubles:
    """Linear values, float64, of sRGB-encoded values in 0..1, of any shape (IEC 61966-2-1)."""
    encoded = np.asarray(encoded, np.float64)
    return np.where(encoded <= 0.04045, encoded / 12.92, power((encoded + 0.055) / 1.055, 2.4))


def linear_texels(texels: Bytes, srgb: bool) -> Floats:
    """float32 (H, W, 4) in 0..1: colour in linear light, alpha as it is, of uint8 (H, W, 4)."""
    colour, alpha = linear_tables(srgb)
    return look_up(texels, colour, alpha)


def linear_tables(srgb: bool) -> tuple[Floats, Floats]:
    """What each byte of a colour and of an alpha is in linear light, 0..1: float32 (256) and float32 (256)."""
    byte = np.arange(256) / 255
    return (srgb_to_linear(byte) if srgb else byte).astype(np.float32), byte.astype(np.float32)


def look_up(texels: Bytes, colour: NDArray[Number], alpha: NDArray[Number]) -> NDArray[Number]:
    """The tables' entries, float32 or uint16 (H, W, 4), for each byte of texels, uint8 (H, W, 4).

    colour, alpha: float32 or uint16 (256).
    """
    found = np.take(colour, texels, mode="clip")
    found[..., 3] = np.take(alpha, texels[..., 3], mode="clip")
    return found


def mip_chain(level: Floats) -> Iterator[Floats]:
    """All levels, from the given (H, W, ...) down to 1x1; sides are halved and rounded down."""
    yield level
    while max(level.shape[:2]) > 1:
        level = _halved(_halved(level, 0), 1)
        yield level


def _halved(level: Floats, axis: int) -> Floats:
    """Area average onto half as many texels along one axis.

    An odd side of 2m + 1 texels has output texels of (2m + 1) / m input texels each, so three inputs share in one.
    """
    count = level.shape[axis]
    if count == 1:
        return level
    level = np.moveaxis(level, axis, 0)
    half = count // 2
    if count % 2 == 0:
        out = level[0::2] + level[1::2]
        out *= level.dtype.type(0.5)
    else:
        i = np.arange(half, dtype=level.dtype).reshape(-1, *[1] * (level.ndim - 1))
        out = ((half - i) * level[0:-1:2] + half * level[1::2] + (i + 1) * level[2::2]) / level.dtype.type(count)
    return np.moveaxis(out, 0, axis)


def fill_hidden(level: Floats, seen: Bools) -> Floats:
    """The level (H, W, C) with the colour of what is seen nearby in place of what is not: that of the finest texel
    of the mip chain that holds any of it. seen: bool (H, W); where nothing is, all stays as it is."""
    if seen.all() or not seen.any():
        return level
    weight = seen[..., None].astype(np.float32)
    *finer, coarsest = mip_chain(np.concatenate([level * weight, weight], axis=-1))
    colour = coarsest[..., :-1] / coarsest[..., -1:]
    for fine in reversed(finer):
        rows, columns = (
            np.minimum(np.arange(n) * m // n, m - 1) for n, m in zip(fine.shape[:2], colour.shape[:2], strict=True)
        )
        share = fine[..., -1:]
        colour = np.where(share > 0, fine[..., :-1] / np.where(share > 0, share, 1), colour[rows][:, columns])
    return np.where(seen[..., None], level, colour).astype(level.dtype)
