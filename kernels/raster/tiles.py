"""Drawing: coverage and depth, tile by tile."""

from __future__ import annotations

from typing import TYPE_CHECKING

from kernels.raster.picture import Picture
from kernels.raster.setup import Bins

if TYPE_CHECKING:
    from kernels.device import Device


def draw_tiles(device: Device, bins: Bins, picture: Picture, resumes: bool, stage: str) -> None:
    """Draw the bins into the picture, over what it shows if it `resumes`, otherwise over nothing."""
    kernel = device.build("raster/tiles.cl", TILE=picture.tile).draw_tiles
    size = (picture.tiles, picture.tiles_x, picture.camera.width, picture.camera.height, device.chunks, resumes)
    images = (picture.triangle, picture.depth, picture.block_depth, picture.tile_depth)
    arguments = (*size, bins.ends, bins.entries, bins.records, *images)
    device.launch(stage, kernel, picture.tiles, *arguments, local=1)
