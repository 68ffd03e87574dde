"""Cases of the rasteriser: a room of small triangles, and a soup of slivers, giants and triangles through the eye."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Ints
from shading_atlas_bench.kernels.case import Bound, Cost, Result, Trial, case, seeded
from shading_atlas_bench.kernels.inputs.soups import look_at, perspective, random_soup, soup
from shading_atlas_bench.kernels.raster.camera import Camera
from shading_atlas_bench.kernels.raster.clusters import EVER, NEVER, Clusters, boxes_twin, in_frustum_twin
from shading_atlas_bench.kernels.raster.mark import mark_visible, mark_visible_twin
from shading_atlas_bench.kernels.raster.rasteriser import CLUSTER, TILE, Rasteriser
from shading_atlas_bench.kernels.raster.render_target import RenderTarget
from shading_atlas_bench.kernels.raster.resolve import resolve, resolve_twin
from shading_atlas_bench.kernels.raster.setup import RECORD, Bins, Scratch, set_up, set_up_twin
from shading_atlas_bench.kernels.raster.tiles import draw_tiles, draw_tiles_twin
from shading_atlas_bench.kernels.samples import Samples
from shading_atlas_bench.kernels.triangles import Triangles

if TYPE_CHECKING:
    from shading_atlas_bench.kernels.device import Device

WIDTH, HEIGHT = 960, 540
VIEW, PROJECTION = look_at((1, 2, 9), (0, 0, 0)), perspective(80, WIDTH / HEIGHT)


def room(device: Device, kind: str, count: int) -> Triangles:
    """`count` triangles before the camera."""
    rng = seeded(kind)
    if kind == "adversarial":
        return random_soup(device, rng, count)
    centres = rng.normal(0, 3, (count, 1, 3)) * [1.5, 0.8, 1]
    reach = 4 / np.sqrt(count)
    return soup(device, centres + rng.normal(0, reach, (count, 3, 3)), Triangles.DOUBLE_SIDED)


def camera(width: int = WIDTH) -> Camera:
    """The cases' camera, of a 16:9 picture that is `width` pixels wide."""
    return Camera.of(VIEW, PROJECTION, width, width * HEIGHT // WIDTH)


def records_of(
    device: Device, triangles: Triangles, picture: RenderTarget, scratch: Scratch, clusters: Clusters
) -> tuple[Bins, Ints]:
    """The set-up of all clusters in view: the bins, and the records of all chunks, int32 (n, RECORD), on the host."""
    chosen, _ = clusters.cull_frustum(picture.camera, 0, EVER, "raster/cull")
    bins = set_up(device, clusters, chosen, picture, False, scratch, "raster")
    if not scratch.fits(bins.needed):
        return records_of(device, triangles, picture, scratch, clusters)
    records = bins.records.get()[: device.chunks * scratch.records * RECORD]
    chunks = records.reshape(device.chunks, scratch.records, RECORD)
    return bins, np.concatenate([c[:count] for c, count in zip(chunks, bins.needed.get()[:, 0], strict=True)])


@case({"clusters.build_clusters": Cost("n", "(12 + 36 + 1 + 36)*n", "18*n")}, 200_000)
def building(device: Device, kind: str, size: int) -> Trial:
    """Compares the bounds of the clusters."""
    triangles = room(device, kind, size)

    def results() -> list[Result]:
        boxes = Clusters.build(device, triangles, CLUSTER).boxes.get()
        return [Result(boxes[:, [0, 1, 2, 4, 5, 6]], boxes_twin(triangles, CLUSTER).reshape(-1, 6))]

    return Trial({"n": size}, lambda: Clusters.build(device, triangles, CLUSTER), results)


CULLING = {
    "clusters.choose_clusters": Cost("c", "(32 + 4 + 4)*c", "8*3*7*c"),
    "clusters.cull_occluded": Cost("c/2", "(32 + 4 + 4)*c/2", "8*3*7*c/2"),
    "clusters.note_seen": Cost("pixels/8", "4*pixels/8"),
}


@case(CULLING, 200_000)
def culling(device: Device, kind: str, size: int) -> Trial:
    """Two passes: half of the clusters were seen lately, the picture shows the first pass, the rest follows."""
    triangles, picture = room(device, kind, size), RenderTarget.allocate(device, camera(), TILE)
    clusters, scratch = Clusters.build(device, triangles, 8), Scratch(device, 4096, 16384)
    seen = np.where(np.arange(clusters.count) % 2, NEVER, 0).astype(np.int32)
    bins, _ = records_of(device, triangles, picture, scratch, clusters)
    draw_tiles(device, bins, picture, False, triangles, None, "raster/draw")

    def run() -> None:
        clusters.last_seen.set(seen)
        _, others = clusters.cull_frustum(picture.camera, 1, 3, "raster/cull")
        clusters.cull_occluded(others, picture, "raster/cull")
        clusters.note_seen(picture, 1, "raster/cull")

    def results() -> list[Result]:
        run()
        inside = in_frustum_twin(boxes_twin(triangles, clusters.size), picture.camera)
        chosen, _ = clusters.cull_frustum(picture.camera, 0, EVER, "raster/cull")
        found, expected = np.zeros((2, clusters.count), np.int8)
        found[chosen.numbers(clusters.count)] = expected[inside] = 1
        shown = picture.triangle.get()[1::8]  # the first draw looks at these rows
        after = seen.copy()
        after[np.unique(shown[shown >= 0]) // clusters.size] = 1
        return [Result(found, expected), Result(clusters.last_seen.get(), after)]

    return Trial({"c": clusters.count, "pixels": WIDTH * HEIGHT}, run, results)


DRAWING = {
    "setup.set_up": Cost("n", "37*n + 48*r + 12*r", "150*n"),
    "tiles.draw_tiles": Cost("pixels", "8*pixels + 52*r", "8*covered"),
}


@case(DRAWING, 100_000, 1500, typical=Bound(2))
def drawing(device: Device, kind: str, size: int) -> Trial:
    """Compares the triangle and depth of pixels with the twin's from the same records."""
    triangles, at = room(device, kind, size), camera(WIDTH if size > 2000 else 240)
    picture, scratch = RenderTarget.allocate(device, at, TILE), Scratch(device, 4096, 16384)
    clusters = Clusters.build(device, triangles, CLUSTER)
    _, records = records_of(device, triangles, picture, scratch, clusters)
    first, last = ((records[:, [k, k]] >> np.array([0, 16])) & 0xFFFF for k in (10, 11))

    def run() -> None:
        chosen, _ = clusters.cull_frustum(at, 0, EVER, "raster/cull")
        bins = set_up(device, clusters, chosen, picture, False, scratch, "raster")
        draw_tiles(device, bins, picture, False, triangles, None, "raster/draw")

    def results() -> list[Result]:
        run()
        expected, nearest = draw_tiles_twin(records, at.width, at.height)
        return [Result(picture.triangle.get(), expected), Result(picture.depth.get(), nearest)]

    covered = 0.5 * float((last - first + 1.0).prod(axis=1).sum())
    return Trial({"n": size, "r": len(records), "pixels": at.width * at.height, "covered": covered}, run, results)


# A corner close to the middle between two steps of 1/256 pixel may be rounded to the other one.
@case({}, 2000, typical=Bound(wrong=1.2e-3), adversarial=Bound(wrong=4e-3))
def setting_up(device: Device, kind: str, size: int) -> Trial:
    """The records of `drawing`, against the twin's in float64: corners in steps of 1/256 pixel."""
    triangles, at = room(device, kind, size), camera(240)
    picture, scratch = RenderTarget.allocate(device, at, TILE), Scratch(device, 4096, 16384)
    clusters = Clusters.build(device, triangles, CLUSTER)

    def results() -> list[Result]:
        _, found = records_of(device, triangles, picture, scratch, clusters)
        expected = set_up_twin(triangles, at)
        once = [dict(zip(*np.unique(records[:, 9], return_index=True), strict=True)) for records in (found, expected)]
        both = sorted(once[0].keys() & once[1].keys())
        rows = [
            records[[index[number] for number in both]] for records, index in zip((found, expected), once, strict=True)
        ]
        alone = np.array([len(once[0].keys() ^ once[1].keys())])
        return [Result(rows[0][:, :6], rows[1][:, :6]), Result(alone, 0 * alone)]

    def run() -> None:
        records_of(device, triangles, picture, scratch, clusters)

    return Trial({"n": size}, run, results)


RESOLVING = {
    "resolve.covered_per_row": Cost("pixels", "4*pixels"),
    "resolve.list_covered": Cost("pixels", "4*pixels + 8*n"),
    "resolve.sample_covered": Cost("n", "(8 + 48 + 12)*n", "120*n"),
}


# Slivers: their area is a difference of almost equal products.
@case(RESOLVING, WIDTH, 240, typical=Bound(1400), adversarial=Bound(30))
def resolving(device: Device, kind: str, size: int) -> Trial:
    """Compares every field of the samples of the covered pixels."""
    triangles, at = room(device, kind, 3000), camera(size)
    seen = Rasteriser(device, triangles).draw(VIEW, PROJECTION, at.width, at.height)

    def run() -> Samples:
        return resolve(device, triangles, seen, VIEW, PROJECTION)

    def results() -> list[Result]:
        samples, expected = run(), resolve_twin(triangles, seen.triangle.get(), VIEW, PROJECTION)
        return [Result(getattr(samples, name).get()[: samples.count], values) for name, values in expected.items()]

    covered = int((seen.triangle.get() >= 0).sum())
    return Trial({"n": covered, "pixels": at.width * at.height}, run, results)


@case({"mark.mark_visible": Cost("pixels", "5*pixels")}, WIDTH)
def marking(device: Device, kind: str, size: int) -> Trial:
    """Compares the flags of the triangles that a picture shows."""
    triangles, at = room(device, kind, 30_000), camera(size)
    seen = Rasteriser(device, triangles).draw(VIEW, PROJECTION, at.width, at.height)
    flags = device.zeros(triangles.count, np.uint8)

    def results() -> list[Result]:
        device.fill(flags, 0)
        mark_visible(device, seen, flags)
        return [Result(flags.get(), mark_visible_twin(seen.triangle.get(), np.zeros(triangles.count, np.uint8)))]

    return Trial({"pixels": at.width * at.height}, lambda: mark_visible(device, seen, flags), results)
