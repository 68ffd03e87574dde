"""The tiled rasteriser: which triangle is nearest at each pixel, and at which depth.

A picture is drawn in stages, each in the files of its name: `clusters` (runs of triangles with boxes: which may be in
view), `setup` (8 triangles at a time: project, clip, snap to 1/256 pixel, drop what covers no sample, sort the rest
into tiles) and `tiles` (coverage in exact integers, depth, hierarchical Z of 8 x 8 blocks). Depth is a plane evaluated
from a double-precision value at each block's corner, so neither tiles nor clusters can change a bit of it.
`README.md` says what was tried for speed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Bools, Doubles, Ints
from shading_atlas_bench.kernels.raster.camera import SUBPIXELS, Camera
from shading_atlas_bench.kernels.raster.clusters import EVER, Chosen, Clusters
from shading_atlas_bench.kernels.raster.render_target import BLOCK, RenderTarget
from shading_atlas_bench.kernels.raster.setup import Scratch, set_up
from shading_atlas_bench.kernels.raster.tiles import draw_tiles
from shading_atlas_bench.kernels.triangles import Triangles

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.kernels.texture.mask import AlphaMask

# Speed only; any others give the same picture.
CLUSTER = 64  # triangles, a multiple of 8
TILE = 64  # pixels, a multiple of 8; the largest that the kernels allow
TWO_PASSES_FROM = 500_000  # triangles; below, looking for hidden clusters costs more than drawing them
MAX_AGE = 8  # draws; how long a cluster that was seen is taken for visible


@dataclass(frozen=True)
class Visibility:
    """What is nearest at each pixel, on the device, image row 0 on top.

    triangle: int32 (height, width), -1 where there is nothing. depth: float32 (height, width), near / distance for a
    perspective view, 1 at the near and 0 at the far end for an orthographic one, 0 where there is nothing.
    """

    width: int
    height: int
    triangle: Array
    depth: Array


class Rasteriser:
    """Draws one set of triangles from any camera.

    OpaqueLayer faces are counter-clockwise as seen; back faces are drawn only with Triangles.DOUBLE_SIDED. Corners are
    snapped to 1/256 pixel once; from there coverage is exact: a pixel belongs to a triangle if its centre lies inside,
    or on a top or left edge. Of equal depths the lowest triangle wins. Triangles with Triangles.MASKED have the holes
    of `mask`; without one they have none. Large scenes are drawn in two passes, what was seen lately and then what that
    does not hide. `cluster` (triangles), `tile` (pixels), `two_passes_from` (triangles) and `cull` (whether clusters
    outside the view are left out) change the speed only.
    Raises ValueError where a triangle has a corner that is not finite.
    """

    def __init__(
        self,
        device: Device,
        triangles: Triangles,
        mask: AlphaMask | None = None,
        *,
        cluster: int = CLUSTER,
        tile: int = TILE,
        two_passes_from: int = TWO_PASSES_FROM,
        cull: bool = True,
    ) -> None:
        if cluster % BLOCK or tile % BLOCK or min(cluster, tile) < BLOCK:
            raise ValueError(f"The cluster size {cluster} and the tile size {tile} must be multiples of {BLOCK}.")
        if tile > BLOCK * 8:
            raise ValueError(f"The tile size is {tile} pixels; it must be at most {BLOCK * 8}.")
        self.device = device
        self.triangles = triangles
        self.mask = mask
        self.tile = tile
        self.two_passes = cull and triangles.count >= two_passes_from
        self.clusters = Clusters.build(device, triangles, cluster, culls=cull)
        # All of a small scene's triangles have room at once; a large scene starts small.
        room = max(256, min(2 * -(-triangles.count // device.chunks), 8192))
        self._scratch = Scratch(device, room, 4 * room)
        self._draws = 0

    def in_frustum(self, view: Doubles, projection: Doubles) -> Ints:
        """The clusters of consecutive triangles that may have a part in the frustum, int32 (n), ascending.

        view, projection: float64 (4, 4).
        """
        chosen, _ = self.clusters.cull_frustum(Camera.of(view, projection, 1, 1), self._draws, EVER, "raster/cull")
        return chosen.numbers(self.clusters.count)

    def draw(self, view: Doubles, projection: Doubles, width: int, height: int, stage: str = "raster") -> Visibility:
        """Draw from a camera: view and projection float64 (4, 4), sizes in pixels, up to 8192.

        The projection has reversed depth: clip z = near and clip w = distance, or an orthographic one from 1 at the
        near to 0 at the far end. Raises ValueError for other sizes and for matrices that are not finite.
        """
        picture = RenderTarget.allocate(self.device, Camera.of(view, projection, width, height), self.tile)
        two_passes = self.two_passes and self._draws > 0
        self._draws += 1
        while not self._scratch.fits(*self._draw(picture, two_passes, stage)):
            pass
        return Visibility(width, height, picture.triangle, picture.depth)

    def _draw(self, picture: RenderTarget, two_passes: bool, stage: str) -> list[Array]:
        """Launch all of it; returns what the set-ups will have needed."""
        cull = f"{stage}/cull"
        recent, others = self.clusters.cull_frustum(picture.camera, self._draws, MAX_AGE if two_passes else EVER, cull)
        needed = [self._draw_clusters(recent, picture, False, stage)]
        if two_passes:
            self.clusters.cull_occluded(others, picture, cull)
            needed.append(self._draw_clusters(others, picture, True, stage))
        if self.two_passes:
            self.clusters.note_seen(picture, self._draws, cull)
        return needed

    def _draw_clusters(self, chosen: Chosen, picture: RenderTarget, resumes: bool, stage: str) -> Array:
        bins = set_up(self.device, self.clusters, chosen, picture, resumes, self._scratch, stage)
        draw_tiles(self.device, bins, picture, resumes, self.triangles, self.mask, f"{stage}/draw")
        return bins.needed


@dataclass(frozen=True)
class ScreenTriangles:
    """What decides coverage and depth, unsnapped and unclipped, for the twin and for judging differences from it.

    edges: float64 (T, 3, 3): edge i at (column, row, 1), in pixels, is the weight of corner i up to a factor; all
        three are >= 0 inside. depth: float64 (T, 3): depth at (column, row, 1). drawn: bool (T), false for back faces
        and for triangles without area.
    """

    edges: Doubles
    depth: Doubles
    drawn: Bools

    @classmethod
    def of(cls, triangles: Triangles, camera: Camera) -> ScreenTriangles:
        """By homogeneous rasterisation (Olano and Greer 1997), which needs no clipping."""
        x, y, z, w = np.moveaxis(camera.project(triangles.host_positions[triangles.host_indices]), -1, 0)
        x, y = x / SUBPIXELS + w * camera.width / 2, y / SUBPIXELS + w * camera.height / 2
        homogeneous = np.stack([x, y, w], axis=-1)
        edges = np.cross(np.roll(homogeneous, -1, axis=1), np.roll(homogeneous, -2, axis=1))
        volume = (edges[:, 0] * homogeneous[:, 0]).sum(axis=1)
        drawn = (volume < 0) | ((volume > 0) & (triangles.host_flags & Triangles.DOUBLE_SIDED > 0))
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = (z[..., None] * edges).sum(axis=1) / volume[:, None]
        return cls(edges * np.sign(volume)[:, None, None], depth, drawn)


def draw_twin(
    triangles: Triangles, view: Doubles, projection: Doubles, width: int, height: int
) -> tuple[Ints, Doubles]:
    """Triangle int32 and depth float64 (height, width), as `Rasteriser.draw` without masks, but without snapping.

    The kernels' may differ where moving a corner by 1/256 pixel moves an edge over the pixel's centre or changes which
    depth is greater.
    """
    screen = ScreenTriangles.of(triangles, Camera.of(view, projection, width, height))
    rows, columns = np.mgrid[:height, :width] + 0.5
    centres = np.stack([columns, rows, np.ones_like(rows)], axis=-1)
    triangle, nearest = np.full((height, width), -1, np.int32), np.zeros((height, width))
    for number in np.flatnonzero(screen.drawn):
        depth = centres @ screen.depth[number]
        inside = (centres @ screen.edges[number].T >= 0).all(axis=-1)
        wins = inside & (depth > nearest) & (depth <= 1)
        triangle[wins], nearest[wins] = number, depth[wins]
    return triangle, nearest
