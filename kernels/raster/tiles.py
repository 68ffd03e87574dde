"""Drawing: coverage and depth, tile by tile."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Doubles, Ints
from shading_atlas_bench.kernels.raster.camera import SUBPIXELS
from shading_atlas_bench.kernels.raster.coverage import covers_twin
from shading_atlas_bench.kernels.raster.render_target import RenderTarget
from shading_atlas_bench.kernels.raster.setup import MASK_BIT, Bins
from shading_atlas_bench.kernels.texture.mask import mask_defines
from shading_atlas_bench.kernels.triangles import Triangles

if TYPE_CHECKING:
    from pyopencl.typing import KernelArg

    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.kernels.texture.mask import AlphaMask


def draw_tiles(
    device: Device,
    bins: Bins,
    picture: RenderTarget,
    resumes: bool,
    triangles: Triangles,
    mask: AlphaMask | None,
    stage: str,
) -> None:
    """Draw the bins into the picture, over what it shows if it `resumes`, otherwise over nothing.

    Triangles with Triangles.MASKED are tested against `mask` at each pixel's centre.
    """
    kernel = device.build("raster/tiles.cl", TILE=picture.tile, **mask_defines(mask)).draw_tiles
    size = (picture.tiles, picture.tiles_x, picture.camera.width, picture.camera.height, device.chunks, resumes)
    images = (picture.triangle, picture.depth, picture.block_depth, picture.tile_depth)
    arguments: tuple[KernelArg, ...] = (*size, bins.bins, bins.entries, bins.records, *images)
    if mask:
        arguments += (*picture.camera.arguments(), triangles.positions, triangles.indices, *mask.arguments)
    device.launch(stage, kernel, picture.tiles, *arguments, local=1)


def draw_tiles_twin(records: Ints, width: int, height: int) -> tuple[Ints, Doubles]:
    """The nearest triangle, int32, and its depth, float64 (height, width), of records int32 (n, RECORD), without masks.

    Of equal depths the lowest triangle; -1 and 0 where there is nothing.
    """
    triangle, nearest = np.full((height, width), -1, np.int32), np.zeros((height, width))
    for record in records:
        corners, depths = record[:6].reshape(3, 2).astype(np.int64), record[6:9].view(np.float32).astype(np.float64)
        (left, right), (top, bottom) = record[10:12] & 0xFFFF, record[10:12] >> 16
        rows, columns = np.mgrid[top : bottom + 1, left : right + 1]
        slopes = np.linalg.solve((corners[1:] - corners[0]).astype(np.float64), depths[1:] - depths[0])
        x, y = columns * SUBPIXELS + SUBPIXELS // 2 - corners[0, 0], rows * SUBPIXELS + SUBPIXELS // 2 - corners[0, 1]
        depth = np.clip(depths[0] + slopes[0] * x + slopes[1] * y, depths.min(), depths.max())
        identity, box = record[9] & ~MASK_BIT, (slice(top, bottom + 1), slice(left, right + 1))
        nearer = (depth > nearest[box]) | ((depth == nearest[box]) & (identity < triangle[box]))
        wins = covers_twin(corners, columns, rows) & nearer
        triangle[box][wins], nearest[box][wins] = identity, depth[wins]
    return triangle, nearest
