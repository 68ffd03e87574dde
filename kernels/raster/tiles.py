"""Drawing: coverage and depth, tile by tile."""

from __future__ import annotations

from typing import TYPE_CHECKING

from kernels.raster.picture import Picture
from kernels.raster.setup import Bins
from kernels.triangles import Triangles

if TYPE_CHECKING:
    from kernels.device import Device
    from kernels.texture.mask import AlphaMask


def draw_tiles(
    device: Device,
    bins: Bins,
    picture: Picture,
    resumes: bool,
    triangles: Triangles,
    mask: AlphaMask | None,
    stage: str,
) -> None:
    """Draw the bins into the picture, over what it shows if it `resumes`, otherwise over nothing.

    Triangles with Triangles.MASKED are tested against `mask` at each pixel's centre.
    """
    kernel = device.build("raster/tiles.cl", TILE=picture.tile, MASKED=int(mask is not None)).draw_tiles
    size = (picture.tiles, picture.tiles_x, picture.camera.width, picture.camera.height, device.chunks, resumes)
    images = (picture.triangle, picture.depth, picture.block_depth, picture.tile_depth)
    arguments = (*size, bins.ends, bins.entries, bins.records, *images)
    if mask:
        arguments += (*picture.camera.arguments(), triangles.positions, triangles.indices, *mask.arguments)
    device.launch(stage, kernel, picture.tiles, *arguments, local=1)
