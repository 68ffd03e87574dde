"""A picture in float64: what a view shows when nothing is rounded, for judging what float32 and snapping change.

Slow (a pass over the pixels of each triangle's box) and meant for small pictures of few thousand triangles.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Bools, Bytes, Doubles, Ints
from shading_atlas_bench.kernels.raster.camera import Camera
from shading_atlas_bench.kernels.raster.rasteriser import ScreenTriangles
from shading_atlas_bench.kernels.shade.shade import shade_twin
from shading_atlas_bench.kernels.shade.sky import paint_sky_twin
from shading_atlas_bench.kernels.triangles import Triangles
from shading_atlas_bench.packers.interface import ServerScene, View

if TYPE_CHECKING:
    from collections.abc import Iterator

SHIFT = 1 / 256  # pixels; half of it along each axis by snapping, the rest for the float32 transform
TIED = 1 + 1e-11  # depths closer than this are equal: rounding of float64 decides no tie
DEPTH = 2e-6  # relative error of a float32 depth


@dataclass(frozen=True)
class ExactPicture:
    """What a view shows, in float64.

    rgb: uint8 (h, w, 3), sRGB, the sky where nothing is drawn. triangle: int32 (h, w), -1 where empty.
    bary: float64 (h, w, 2), weights of vertices 1 and 2. screen: what decided coverage and depth.
    """

    rgb: Bytes
    triangle: Ints
    bary: Doubles
    screen: ScreenTriangles

    def wrong(self, triangle: Ints) -> Bools:
        """bool (h, w): pixels whose id in another picture differs by more than rounding can explain.

        Explained is what moving corners by SHIFT, or a depth by DEPTH, can change: another triangle that comes as near
        to the pixel's centre, at a depth as near as the one expected.
        """
        wrong = np.zeros(triangle.shape, bool)
        for row, column in np.argwhere(triangle != self.triangle):
            wrong[row, column] = not self._explained(row, column, int(triangle[row, column]))
        return wrong

    def holes(self, drawn: Bools) -> Bools:
        """bool (h, w): pixels that are not `drawn` (bool) and lie well inside what is seen."""
        holes = np.zeros(drawn.shape, bool)
        for row, column in np.argwhere(~drawn & (self.triangle >= 0)):
            holes[row, column] = not self._explained(row, column, -1)
        return holes

    def _explained(self, row: int, column: int, mine: int) -> bool:
        centre = np.array([column + 0.5, row + 0.5, 1])
        best = int(self.triangle[row, column])
        nearest = 0.0
        if mine >= 0:
            if not (self._margins(mine, centre) >= -SHIFT).all():
                return False
            nearest = self._depths(mine, centre)[1]
        if best < 0:
            return True
        robust = (self._margins(best, centre) > SHIFT).all() and self._depths(best, centre)[1] < 1
        return not robust or self._depths(best, centre)[0] <= nearest

    def _margins(self, number: int, centre: Doubles) -> Doubles:
        """Pixels to each edge, positive inside; NaN (no margin) for a triangle without area on screen."""
        edges = self.screen.edges[number]
        length = np.hypot(edges[:, 0], edges[:, 1])
        margins: Doubles = edges @ centre / np.where(length > 0, length, np.nan)
        return margins

    def _depths(self, number: int, centre: Doubles) -> tuple[float, float]:
        plane = self.screen.depth[number]
        depth = float(plane @ centre)
        reach = float(np.hypot(plane[0], plane[1])) * SHIFT + DEPTH * abs(depth)
        return depth - reach, depth + reach


def draw_exact(scene: ServerScene, view: View, eye: Doubles) -> ExactPicture:
    """The picture of `view`, shaded for highlights seen from `eye` (float64 (3)): every number float64.

    Opaque scenes without masks only. Levels of textures are the finest.
    """
    triangle, bary, screen = _visible(scene.triangles, Camera.of(view.view, view.projection, view.width, view.height))
    shader = scene.shader
    rgb = paint_sky_twin(view.view, view.projection, view.width, view.height, shader.tables.environment)
    seen = triangle >= 0
    if seen.any():
        maps, faces = shader.shadows.maps.get(), shader.faces.get()
        footprint = np.zeros(np.count_nonzero(seen))
        with np.errstate(all="ignore"):  # a corner in a light or without a normal
            rgb[seen] = shade_twin(
                shader.tables, faces, shader.textures, maps, triangle[seen], bary[seen], footprint, eye
            )
    return ExactPicture(np.ascontiguousarray(rgb[..., :3]), triangle, bary, screen)


def _visible(triangles: Triangles, camera: Camera) -> tuple[Ints, Doubles, ScreenTriangles]:
    """Ids int32 (h, w) and barycentrics float64 (h, w, 2) of what is nearest; of equal depths the lowest id."""
    screen = ScreenTriangles.of(triangles, camera)
    rows, columns = np.mgrid[: camera.height, : camera.width] + 0.5
    centres = np.stack([columns, rows, np.ones_like(rows)], axis=-1)
    triangle: Ints = np.full(rows.shape, -1, np.int32)
    nearest: Doubles = np.zeros(rows.shape)
    bary: Doubles = np.zeros((*rows.shape, 2))
    for number, box in _boxes(triangles, camera, screen):
        at = centres[box]
        depth, edges = at @ screen.depth[number], at @ screen.edges[number].T
        inside = (edges >= 0).all(axis=-1) & (edges.sum(axis=-1) > 0)  # a triangle seen as a point covers nothing
        wins = inside & (depth > nearest[box] * TIED) & (depth <= 1)
        if wins.any():
            triangle[box][wins], nearest[box][wins] = number, depth[wins]
            bary[box][wins] = edges[wins][:, 1:] / edges[wins].sum(axis=-1)[:, None]
    return triangle, bary, screen


def _boxes(triangles: Triangles, camera: Camera, screen: ScreenTriangles) -> Iterator[tuple[int, tuple[slice, slice]]]:
    """Drawn triangles in order, with the rows and columns that they can cover."""
    corners = camera.project(triangles.host_positions[triangles.host_indices])
    size = np.array([camera.width, camera.height])
    before_eye: Bools = np.all(corners[..., 3] > 0, axis=1)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        place = corners[..., :2] / corners[..., 3:] / 256 + size / 2
        lowest = np.where(before_eye[:, None], np.clip(np.floor(place.min(axis=1) - 1), 0, size), 0)
        highest = np.where(before_eye[:, None], np.clip(np.ceil(place.max(axis=1) + 1), 0, size), size)
    low, high = lowest.astype(int), highest.astype(int)
    for number in np.flatnonzero(screen.drawn & (low < high).all(axis=1)):
        (left, top), (right, bottom) = low[number].tolist(), high[number].tolist()
        yield int(number), (slice(top, bottom), slice(left, right))
