"""Textures with their mip chains in one device buffer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from shading_atlas_bench.arithmetic.arrays import Bytes, Floats, Ints
from shading_atlas_bench.kernels.runtime.opencl import DeviceError
from shading_atlas_bench.kernels.texture.mipmap import fill_hidden, linear_tables, linear_texels, look_up, mip_chain

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device

WRAP = {"repeat": 0, "clamp": 1, "mirror": 2}
TEXEL = 8  # bytes
POWERS = [1 << exponent for exponent in range(14)]  # that textures may be reduced to
FULL = 65535  # texels are uint16 in linear light: 8 bits of sRGB need 12 bits or more there


class TextureImage(Protocol):
    """What a texture has: uint8 (H, W, 4) texels, row 0 at v = 0, and how coordinates outside 0..1 wrap."""

    texels: Bytes
    srgb: bool
    wrap_s: str
    wrap_t: str


@dataclass(frozen=True)
class TextureBuffers:
    """Mip-mapped textures on the device; entry 0 is a white texel, so texture i of the scene is entry i + 1.

    textures: int32 (N + 1, 4) of first level, last level - first level, wrap_s + 4 * wrap_t, longest side.
    levels: int32 (L, 4) of first texel, width, height, 0.
    texels: uint16 (M, 4), linear light, 65535 = 1.
    wraps: whether any texture clamps or mirrors.
    host_textures, host_levels, host_texels: the same on the host, for the twin.
    """

    textures: Array
    levels: Array
    texels: Array
    wraps: bool
    host_textures: Ints
    host_levels: Ints

    @cached_property
    def host_texels(self) -> NDArray[np.uint16]:
        """uint16 (M, 4), fetched when asked for: a second copy of all texels is not kept otherwise."""
        return self.texels.get()

    def finest(self, device: Device) -> TextureBuffers:
        """The same textures as if they had no further level, so that every lookup is at the finest one."""
        table = self.host_textures * np.array([1, 0, 1, 1], np.int32)
        return replace(self, textures=device.upload(table), host_textures=table)

    @classmethod
    def upload(
        cls, device: Device, textures: Sequence[TextureImage], hidden: Mapping[int, float] | None = None
    ) -> TextureBuffers:
        """Build the mip chains and copy them to the device.

        hidden: for textures whose alpha makes parts of them invisible, the alpha (0..1) below which nothing is seen.
        There colours are those of what is seen around, and averages weigh by alpha, so that what a file has in its
        holes bleeds out neither at their edges, where an atlas or a codec blurs them, nor in the distance.
        Raises DeviceError if they do not fit one buffer.
        """
        _check_size(device, textures)
        hidden = hidden or {}
        table, levels, texels = [(0, 0, 0, 1)], [(0, 1, 1, 0)], [np.full((1, 4), FULL, np.uint16)]
        offset = 1
        for index, texture in enumerate(textures):
            first = len(levels)
            for level in _levels(texture, hidden.get(index)):
                height, width = level.shape[:2]
                levels.append((offset, width, height, 0))
                texels.append(level.reshape(-1, 4))
                offset += width * height
            wrap = WRAP[texture.wrap_s] + 4 * WRAP[texture.wrap_t]
            table.append((first, len(levels) - first - 1, wrap, max(texture.texels.shape[:2])))
        host_textures, host_levels = np.array(table, np.int32), np.array(levels, np.int32)
        return cls(
            device.upload(host_textures),
            device.upload(host_levels),
            device.upload(np.concatenate(texels)),
            any(row[2] for row in table),
            host_textures,
            host_levels,
        )


def _check_size(device: Device, textures: Sequence[TextureImage]) -> None:
    """Raise DeviceError where the mip chains do not fit one buffer, naming a size of textures that does."""
    sizes = [texture.texels.shape[:2] for texture in textures]
    longest = max((max(size) for size in sizes), default=1)
    needed = {most: TEXEL * sum(_chain(height, width, most) for height, width in sizes) for most in (longest, *POWERS)}
    room = device.device.max_mem_alloc_size
    if needed[longest] > room:
        fitting = max((most for most, size in needed.items() if size <= room), default=0)
        remedy = f"--max-texture {fitting} reduces them" if fitting else "the scene has too many"
        sentence = f"The textures need {needed[longest] >> 20} MB in one buffer, more than {device.name} gives"
        raise DeviceError(f"{sentence}: {remedy}.")


def _chain(height: int, width: int, most: int) -> int:
    """Texels of a mip chain, from the first level on whose longer side is at most so long."""
    texels = 0
    while True:
        texels += height * width if max(height, width) <= most else 0
        if height == width == 1:
            return texels
        height, width = max(1, height // 2), max(1, width // 2)


def _levels(texture: TextureImage, hidden: float | None) -> list[NDArray[np.uint16]]:
    """The mip chain in uint16, linear light."""
    linear = linear_texels(texture.texels, texture.srgb)
    if hidden is None:
        _, *coarser = mip_chain(linear)
        finest = look_up(texture.texels, *map(_quantised, linear_tables(texture.srgb)))
        return [finest, *map(_quantised, coarser)]
    linear[..., :3] = fill_hidden(linear[..., :3], linear[..., 3] >= hidden)
    # A trace of weight for invisible texels keeps a colour where nothing is visible at all.
    weight = linear[..., 3:] + np.float32(1e-3)
    chain = mip_chain(np.concatenate([linear[..., :3] * weight, linear[..., 3:], weight], axis=-1))
    return [_quantised(np.concatenate([level[..., :3] / level[..., 4:], level[..., 3:4]], axis=-1)) for level in chain]


def _quantised(level: Floats) -> NDArray[np.uint16]:
    scaled = np.clip(level, 0, 1)
    scaled *= FULL
    scaled += 0.5
    whole: NDArray[np.uint16] = scaled.astype(np.uint16)
    return whole
