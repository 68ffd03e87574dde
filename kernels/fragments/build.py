"""The A-buffer: every fragment of every pixel, pixel after pixel, nearest first."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from kernels.common.scan import exclusive_scan
from kernels.raster.camera import Camera
from kernels.raster.picture import Picture
from kernels.raster.rasteriser import Rasteriser, ScreenTriangles, Visibility
from kernels.raster.resolve import locate_samples
from kernels.raster.setup import Bins, Scratch, set_up
from kernels.samples import Samples
from kernels.triangles import Triangles

if TYPE_CHECKING:
    from pyopencl.array import Array


TILE = 64  # pixels


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
class Front:
    """A picture that hides fragments behind it, of other triangles.

    numbers: int32 (T), what the picture would call the triangles of the fragments: of equal depths the lower is nearer.
    """

    visibility: Visibility
    numbers: Array


class Builder:
    """Builds A-buffers from a rasteriser's set-up records and tile lists.

    No links and no atomics: fragments are counted per pixel, scanned, and written where they belong, so the list is as
    long as it must be, and the same in every run.
    """

    def __init__(self, rasteriser: Rasteriser) -> None:
        self.rasteriser, self.device = rasteriser, rasteriser.device
        self._scratch = Scratch(self.device, 8192)

    def members(self, pvs: Array, count: int, nodes: Array, stage: str) -> Array:
        """uint8 (T): 0, or 1 + the node (uint8 (T) in `nodes`) of each of the `count` triangles listed in `pvs`."""
        members = self.device.recycled(self.rasteriser.triangles.count, np.uint8)
        self.device.fill(members, 0, stage)
        kernel = self.device.build("fragments/build.cl", TILE=TILE, MASKED=0, FRONT=0).mark_members
        self.device.launch(stage, kernel, count, count, pvs, nodes, members)
        return members

    def bins(self, camera: Camera, stage: str) -> tuple[Bins | None, Picture]:
        """The tile lists of everything in the frustum; they serve all nodes until the next call."""
        picture = Picture.allocate(self.device, camera, TILE)
        clusters = self.rasteriser.clusters
        chosen, count = clusters.seen_lately(camera, 0, np.iinfo(np.int32).max, f"{stage}/cull")
        if not count:
            return None, picture
        return set_up(self.device, clusters, chosen, count, picture, False, self._scratch, stage), picture

    def build(
        self, bins: Bins | None, picture: Picture, members: Array, member: int, stage: str, front: Front | None = None
    ) -> Fragments:
        """Fragments of the triangles whose entry in `members`, uint8 (T), is `member`, as far as `front` shows them."""
        device, camera = self.device, picture.camera
        pixels = camera.width * camera.height
        counts = device.recycled(pixels + 1, np.int32)
        device.fill(counts, 0, f"{stage}/count")
        inputs = (picture.tiles, picture.tiles_x, camera.width, camera.height, device.chunks)
        mask, triangles = self.rasteriser.mask, self.rasteriser.triangles
        defines = {"MASKED": int(mask is not None), "FRONT": int(front is not None)}
        kernels = device.build("fragments/build.cl", TILE=TILE, **defines)
        alpha = (*camera.arguments(), triangles.positions, triangles.indices, *mask.arguments) if mask else ()
        alpha += (front.visibility.triangle, front.visibility.depth, front.numbers) if front else ()
        if bins:
            inputs += (bins.ends, bins.entries, bins.records, members, member)
            count = (f"{stage}/count", kernels.count_fragments, picture.tiles)
            device.launch(*count, *inputs, counts, *alpha, local=1)
        offsets, total = exclusive_scan(device, counts, pixels + 1, f"{stage}/scan")
        samples = Samples.allocate(device, total)
        depth = device.recycled(len(samples.texel), np.float32)
        if total:
            results = (offsets, samples.triangle, depth)
            write = (f"{stage}/write", kernels.write_fragments, picture.tiles)
            device.launch(*write, *inputs, *results, *alpha, local=1)
            lists = (offsets, samples.triangle, samples.texel, depth)
            device.launch(f"{stage}/sort", kernels.sort_fragments, pixels, pixels, *lists)
        locate_samples(device, triangles, samples, camera, f"{stage}/locate")
        return Fragments(camera.width, camera.height, samples, depth, offsets)


def build_twin(
    triangles: Triangles, camera: Camera, members: np.ndarray, member: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Offsets int64 (pixels + 1), triangle int32 (n) and depth float64 (n), as `Builder.build` without masks, but
    without snapping: the kernels' may differ where an edge passes within 1/256 pixel of a pixel's centre."""
    screen = ScreenTriangles.of(triangles, camera)
    rows, columns = np.mgrid[: camera.height, : camera.width] + 0.5
    centres = np.stack([columns, rows, np.ones_like(rows)], axis=-1).reshape(-1, 3)
    found = []
    for number in np.flatnonzero(screen.drawn & (members == member)):
        depth = centres @ screen.depth[number]
        inside = (centres @ screen.edges[number].T >= 0).all(axis=-1) & (depth > 0) & (depth <= 1)
        pixel = np.flatnonzero(inside)
        found.append((pixel, np.full(len(pixel), number), depth[pixel]))
    pixel, triangle, depth = (np.concatenate(part) for part in zip(*found, strict=True)) if found else np.zeros((3, 0))
    order = np.lexsort((triangle, -depth, pixel))
    counts = np.bincount(pixel.astype(np.int64), minlength=len(centres))
    offsets = np.concatenate([[0], np.cumsum(counts)])
    return offsets, triangle[order].astype(np.int32), depth[order]
