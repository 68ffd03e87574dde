"""What is being drawn: a picture in tiles, with the hierarchy of its depth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.kernels.raster.camera import Camera

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device

BLOCK = 8  # pixels; the hierarchical Z's block and the width of a row in the kernels


@dataclass(frozen=True)
class RenderTarget:
    """triangle int32 and depth float32 (height, width); block_depth and tile_depth float32, the farthest depth of each
    8 x 8 block and of each tile, as far as drawn."""

    camera: Camera
    tile: int
    tiles_x: int
    tiles: int
    triangle: Array
    depth: Array
    block_depth: Array
    tile_depth: Array

    @classmethod
    def allocate(cls, device: Device, camera: Camera, tile: int) -> RenderTarget:
        """An uninitialised picture; `tile` is its tiles' side in pixels, a multiple of 8."""
        tiles_x, tiles_y = -(-camera.width // tile), -(-camera.height // tile)
        tiles, shape = tiles_x * tiles_y, (camera.height, camera.width)
        images = (device.recycled(shape, np.int32), device.recycled(shape, np.float32))
        blocks = device.recycled(tiles * (tile // BLOCK) * (tile // BLOCK), np.float32)
        return cls(camera, tile, tiles_x, tiles, *images, blocks, device.recycled(tiles, np.float32))
