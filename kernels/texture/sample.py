"""Twins of the texture lookups of sample.cl, in float64."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Array, Doubles, Longs

if TYPE_CHECKING:
    from shading_atlas_bench.kernels.texture.buffers import TextureBuffers


def neighbours(u: Doubles, size: Array, mode: Array) -> tuple[Longs, Longs, Doubles]:
    """The two texels that a bilinear lookup at `u` blends along an axis of `size` texels, and the second's weight.

    u: (n). size, mode: int (n). Returns int64 (n) twice, and float64 (n).
    mode: 0 repeat, 1 clamp, 2 mirror. Coordinates beyond 1e6, where float32 has no texels left, count as 0, and so does
    what is not a number.
    """
    u = np.where(np.abs(u) < 1e6, u, 0)
    folded = 1 - np.abs(1 - np.mod(u, 2))
    u = np.select([mode == 0, mode == 1], [np.mod(u, 1), np.clip(u, 0, 1)], folded)
    x = u * size - 0.5
    low = np.floor(x).astype(np.int64)
    first = np.where(mode == 0, np.mod(low, size), np.clip(low, 0, size - 1))
    second = np.where(mode == 0, np.mod(low + 1, size), np.clip(low + 1, 0, size - 1))
    return first, second, x - low


def bilinear(textures: TextureBuffers, level: Array, u: Doubles, v: Doubles, wrap: Array) -> Doubles:
    """Linear RGBA (n, 4) of rows `level`, int (n), of the level table at u, v (n); wrap, int (n), as in the texture
    table."""
    offset, width, height = textures.host_levels[level, :3].T.astype(np.int64)
    x0, x1, fx = neighbours(u, width, wrap & 3)
    y0, y1, fy = neighbours(v, height, wrap >> 2)

    def at(x: Array, y: Array) -> Doubles:
        texels: Doubles = textures.host_texels[offset + y * width + x] / 65535
        return texels

    fx, fy = fx[:, None], fy[:, None]
    return (at(x0, y0) * (1 - fx) + at(x1, y0) * fx) * (1 - fy) + (at(x0, y1) * (1 - fx) + at(x1, y1) * fx) * fy


def trilinear(textures: TextureBuffers, texture: Array, u: Doubles, v: Doubles, footprint: Doubles) -> Doubles:
    """Linear RGBA (n, 4) of entries `texture`, int (n), of the texture table at u, v (n).

    footprint (n): the sample's side in texture space, 1 = the whole texture; level = log2(footprint * longest side).
    """
    first, last, wrap, size = textures.host_textures[texture].T
    across = np.where(np.isnan(footprint), 0, footprint) * size
    level = np.clip(np.log2(np.maximum(across, 1)), 0, last)
    fine = np.floor(level).astype(np.int64)
    blend = (level - fine)[:, None]
    near = bilinear(textures, first + fine, u, v, wrap)
    far = bilinear(textures, first + np.minimum(fine + 1, last), u, v, wrap)
    blended: Doubles = near * (1 - blend) + far * blend
    return blended
