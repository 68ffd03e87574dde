"""The A-buffer: every fragment of every pixel, pixel after pixel, nearest first."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic import arrays
from shading_atlas_bench.arithmetic.arrays import Doubles, Ints, Longs
from shading_atlas_bench.kernels.common.scan import exclusive_scan
from shading_atlas_bench.kernels.raster.camera import Camera
from shading_atlas_bench.kernels.raster.clusters import EVER
from shading_atlas_bench.kernels.raster.rasteriser import Rasteriser, ScreenTriangles, Visibility
from shading_atlas_bench.kernels.raster.render_target import RenderTarget
from shading_atlas_bench.kernels.raster.resolve import locate_samples
from shading_atlas_bench.kernels.raster.setup import Bins, Scratch, set_up
from shading_atlas_bench.kernels.samples import Samples
from shading_atlas_bench.kernels.texture.mask import mask_defines
from shading_atlas_bench.kernels.triangles import Triangles

if TYPE_CHECKING:
    from pyopencl.array import Array
    from pyopencl.typing import KernelArg

    from shading_atlas_bench.kernels.device import Kernels
    from shading_atlas_bench.kernels.texture.mask import AlphaMask


TILE = 64  # pixels
PAGE = 2048  # fragments that a tile takes from the pool at a time; speed only


@dataclass(frozen=True)
class Fragments:
    """Fragments of a width x height picture; those of pixel p are offsets[p] to offsets[p + 1], nearest first.

    samples: their triangles and surface points; texel is the pixel, row * width + column.
    depth: float32 (n), as in Visibility. offsets: int32 (width * height + 1).
    """

    width: int
    height: int
    samples: Samples
    depth: Array
    offsets: Array

    @property
    def count(self) -> int:
        return self.samples.count

    @property
    def pixels(self) -> int:
        return self.width * self.height


@dataclass(frozen=True)
class OpaqueLayer:
    """A picture that hides fragments behind it, of other triangles.

    numbers: int32 (T), what the picture would call the triangles of the fragments: of equal depths the lower is nearer.
    """

    visibility: Visibility
    numbers: Array


class Builder:
    """Builds A-buffers from a rasteriser's set-up records and tile lists.

    Tiles draw once, into pages that they take from a pool as they need them; from there fragments go where their counts
    say. Which pages a tile gets decides nothing, so the lists are the same in every run.
    """

    def __init__(self, rasteriser: Rasteriser) -> None:
        self.rasteriser, self.device = rasteriser, rasteriser.device
        self._scratch = Scratch(self.device, 8192, 32768)
        self._pages = 0  # of the pool

    def members(self, pvs: Array, count: int, nodes: Array, stage: str) -> Array:
        """uint8 (T): 0, or 1 + the node (uint8 (T) in `nodes`) of each of the `count` triangles listed in `pvs`."""
        members = self.device.recycled(self.rasteriser.triangles.count, np.uint8)
        self.device.fill(members, 0, stage)
        self.device.launch(stage, self._kernels(None, 0).mark_members, count, count, pvs, nodes, members)
        return members

    def bins(self, camera: Camera, stage: str) -> tuple[Bins, RenderTarget]:
        """The tile lists of everything in the frustum; they serve all nodes until the next call."""
        picture = RenderTarget.allocate(self.device, camera, TILE)
        clusters = self.rasteriser.clusters
        chosen, _ = clusters.cull_frustum(camera, 0, EVER, f"{stage}/cull")
        while True:
            bins = set_up(self.device, clusters, chosen, picture, False, self._scratch, stage)
            if self._scratch.fits(bins.needed):
                return bins, picture

    def build(
        self,
        bins: Bins,
        picture: RenderTarget,
        members: Array,
        member: int,
        stage: str,
        front: OpaqueLayer | None = None,
    ) -> Fragments:
        """Fragments of the triangles whose entry in `members`, uint8 (T), is `member`, as far as `front` shows them."""
        device, camera, triangles = self.device, picture.camera, self.rasteriser.triangles
        pixels = camera.width * camera.height
        offsets = device.recycled(pixels + 1, np.int32)
        drawn, starts, total = self._draw(bins, picture, members, member, front, stage)
        samples = Samples.allocate(device, total)
        depth = device.recycled(len(samples.texel), np.float32)
        device.fill(offsets[pixels:], total, f"{stage}/place")
        size = (picture.tiles, picture.tiles_x, camera.width, camera.height)
        results = (offsets, samples.triangle, samples.texel, depth)
        kernel = self._kernels(None, 0).place_fragments
        device.launch(f"{stage}/place", kernel, picture.tiles, *size, *drawn, starts, *results, local=1)
        locate_samples(device, triangles, samples, camera, f"{stage}/locate")
        return Fragments(camera.width, camera.height, samples, depth, offsets)

    def _draw(
        self, bins: Bins, picture: RenderTarget, members: Array, member: int, front: OpaqueLayer | None, stage: str
    ) -> tuple[tuple[Array, ...], Array, int]:
        """Pages of fragments with what place_fragments needs to read them, where each tile's row of them begins in the
        lists, and their number. Where the pool has too few pages, it grows and all is drawn again."""
        device, camera, scratch = self.device, picture.camera, self._scratch
        mask, triangles, tiles = self.rasteriser.mask, self.rasteriser.triangles, picture.tiles
        alpha: tuple[KernelArg, ...] = ()
        if mask:
            alpha += (*camera.arguments(), triangles.positions, triangles.indices, *mask.arguments)
        if front:
            alpha += (front.visibility.triangle, front.visibility.depth, front.numbers)
        kernel = self._kernels(mask, int(front is not None)).draw_fragments
        size = (tiles, picture.tiles_x, camera.width, camera.height)
        listed = (device.chunks, bins.bins, bins.entries, bins.records, members, member)
        rows = camera.height * picture.tiles_x
        runs, taken = scratch.ints("runs", rows), scratch.ints("taken", 1)
        firsts = scratch.ints("firsts", tiles)
        self._pages = max(self._pages, 2 * tiles)
        while True:
            pool = (scratch.ints("pages", self._pages * 3 * PAGE), scratch.ints("links", self._pages * 2))
            device.fill(taken, 0, f"{stage}/draw")
            results = (self._pages, *pool, taken, firsts, runs)
            device.launch(f"{stage}/draw", kernel, tiles, *size, *listed, *results, *alpha, local=1)
            starts, total = exclusive_scan(device, runs, rows, f"{stage}/scan")
            needed = int(taken.get()[0])
            if needed <= self._pages:
                return (*pool, firsts), starts, total
            self._pages = needed + needed // 8

    def _kernels(self, mask: AlphaMask | None, front: int) -> Kernels:
        return self.device.build("fragments/build.cl", TILE=TILE, PAGE=PAGE, FRONT=front, **mask_defines(mask))


def build_twin(triangles: Triangles, camera: Camera, members: arrays.Array, member: int) -> tuple[Longs, Ints, Doubles]:
    """Offsets int64 (pixels + 1), triangle int32 (n) and depth float64 (n), as `Builder.build` without masks, but
    without snapping: the kernels' may differ where an edge passes within 1/256 pixel of a pixel's centre."""
    screen = ScreenTriangles.of(triangles, camera)
    rows, columns = np.mgrid[: camera.height, : camera.width] + 0.5
    centres = np.stack([columns, rows, np.ones_like(rows)], axis=-1).reshape(-1, 3)
    pixels: list[Longs] = [np.zeros(0, np.int64)]
    numbers: list[Longs] = [np.zeros(0, np.int64)]
    depths: list[Doubles] = [np.zeros(0)]
    for number in np.flatnonzero(screen.drawn & (members == member)):
        depth = centres @ screen.depth[number]
        inside = (centres @ screen.edges[number].T >= 0).all(axis=-1) & (depth > 0) & (depth <= 1)
        covered = np.flatnonzero(inside).astype(np.int64)
        pixels.append(covered)
        numbers.append(np.full(len(covered), number, np.int64))
        depths.append(depth[covered])
    pixel, triangle, every_depth = np.concatenate(pixels), np.concatenate(numbers), np.concatenate(depths)
    order = np.lexsort((triangle, -every_depth, pixel))
    counts = np.bincount(pixel, minlength=len(centres))
    offsets = np.concatenate([[0], np.cumsum(counts)])
    return offsets, triangle[order].astype(np.int32), every_depth[order]
