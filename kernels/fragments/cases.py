"""Cases of fragment lists: a few layers of small triangles, and hundreds of layers and slivers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Floats, Ints
from shading_atlas_bench.kernels.case import Bound, Cost, Result, Trial, case, seeded
from shading_atlas_bench.kernels.fragments.blend import blend_layers, blend_lists, blend_twin, nearest_twin
from shading_atlas_bench.kernels.fragments.build import Builder, Fragments, build_twin
from shading_atlas_bench.kernels.fragments.inputs import glass_opacity
from shading_atlas_bench.kernels.fragments.layered import LayeredRasteriser, numbered
from shading_atlas_bench.kernels.fragments.layers import Layers, mark_layers_twin
from shading_atlas_bench.kernels.fragments.opacity import opacity_twin
from shading_atlas_bench.kernels.fragments.order import order_fragments, order_twin
from shading_atlas_bench.kernels.inputs.lists import random_rows
from shading_atlas_bench.kernels.raster.cases import PROJECTION, VIEW, camera, room
from shading_atlas_bench.kernels.raster.rasteriser import Rasteriser
from shading_atlas_bench.kernels.triangles import Triangles

if TYPE_CHECKING:
    from shading_atlas_bench.kernels.device import Device


def fragments_of(device: Device, kind: str, width: int) -> tuple[Triangles, Fragments]:
    """An A-buffer of 1000 triangles."""
    triangles = room(device, kind, 1000)
    builder = Builder(Rasteriser(device, triangles))
    return triangles, builder.build(
        *builder.bins(camera(width), "build"), device.upload(np.ones(triangles.count, np.uint8)), 1, "build"
    )


def host(fragments: Fragments) -> tuple[Ints, Ints, Floats, Ints]:
    """Offsets (pixels + 1), and triangle, depth and pixel (n) of every fragment, on the host."""
    n, samples = fragments.count, fragments.samples
    return fragments.offsets.get(), samples.triangle.get()[:n], fragments.depth.get()[:n], samples.texel.get()[:n]


BUILDING = {
    "build.draw_fragments": Cost("n", "4*pixels + 12*n + 52*t"),
    "build.place_fragments": Cost("n", "8*pixels + 24*n"),
    "build.mark_members": Cost("t", "6*t"),
}


# Triangles almost edge-on, whose corners' steps of 1/256 pixel are steps of depth.
@case(BUILDING, 480, 96, typical=Bound(6000, wrong=4e-3), adversarial=Bound(6000, wrong=3e-4))
def building(device: Device, kind: str, size: int) -> Trial:
    """Compares fragments that both have; the twin does not snap corners, so edges may differ by a pixel."""
    triangles, view = room(device, kind, 1000), camera(size)
    builder, nodes = Builder(Rasteriser(device, triangles)), device.zeros(triangles.count, np.uint8)
    everything = device.upload(np.arange(triangles.count, dtype=np.int32))

    def run() -> Fragments:
        members = builder.members(everything, triangles.count, nodes, "build")
        return builder.build(*builder.bins(view, "build"), members, 1, "build")

    def results() -> list[Result]:
        _, triangle, depth, pixel = host(run())
        offsets, other, expected = build_twin(triangles, view, np.ones(triangles.count), 1)
        places = np.repeat(np.arange(len(offsets) - 1), np.diff(offsets)) * triangles.count + other
        own = pixel.astype(np.int64) * triangles.count + triangle
        _, mine, twins = np.intersect1d(own, places, return_indices=True)
        present = np.zeros(len(own), np.int8)
        present[mine] = 1
        return [Result(present, np.ones(len(own))), Result(depth[mine], expected[twins])]

    return Trial({"n": run().count, "t": triangles.count, "pixels": view.width * view.height}, run, results)


# Each field of a sample read and written once, but no texel read.
@case({"order.order_fragments": Cost("n", "36*n + 4*pixels")}, 480, 96)
def ordering(device: Device, kind: str, size: int) -> Trial:
    """Compares the order, and each field of the samples in that order."""
    _, fragments = fragments_of(device, kind, size)
    before, n = fragments.samples, fragments.count

    def results() -> list[Result]:
        ordered = order_fragments(device, fragments, "order")
        offsets, triangle, _, _ = host(fragments)
        places = order_twin(offsets, triangle, fragments.width)
        fields = [
            (getattr(ordered, name).get()[:n], getattr(before, name).get()[:n][places].astype(np.float64))
            for name in ("triangle", "bary1", "bary2", "footprint")
        ]
        return [Result(ordered.texel.get()[:n], places), *(Result(*field) for field in fields)]

    counts = {"n": n, "pixels": fragments.pixels}
    return Trial(counts, lambda: order_fragments(device, fragments, "order"), results)


OPACITY = {
    "opacity.fragment_opacity": Cost("n", "(16 + 12 + 8 + 48 + 16 + 16 + 4)*n", "50*n"),
    "opacity.write_opacity": Cost("n", "12*n"),
}


@case(OPACITY, 480, 96)
def opacity(device: Device, kind: str, size: int) -> Trial:
    """Compares the opacities, 0..255, of the fragments of random glass."""
    triangles, fragments = fragments_of(device, kind, size)
    glass, _ = glass_opacity(device, seeded(kind), triangles)
    samples, n = numbered(device, fragments, "numbers").samples, fragments.count
    plane = device.zeros((1, max(n, 1), 4), np.uint8)

    def results() -> list[Result]:
        glass.write(samples, plane, "opacity")
        found = plane.get()[0, :n, 0].astype(np.int32)
        bary = np.stack([samples.bary1.get()[:n], samples.bary2.get()[:n]], axis=1).astype(np.float64)
        footprint = samples.footprint.get()[:n].astype(np.float64)
        return [Result(found, opacity_twin(glass, samples.triangle.get()[:n], bary, footprint))]

    return Trial({"n": n}, lambda: glass.write(samples, plane, "opacity"), results)


def most_layers(kind: str) -> int:
    """Longest list."""
    return 40 if kind == "adversarial" else 6


@case({"blend.blend_lists": Cost("n", "4*words*n + 12*pixels", "7*n")}, 480, 120, typical=Bound(wrong=6e-5))
def blending(device: Device, kind: str, size: int) -> Trial:
    """Compares blends of lists of random colours and opacities over a random picture, uint8 (pixels, 4)."""
    rng = seeded(kind)
    offsets, rows = random_rows(rng, size, size * 2 // 3, most_layers(kind))
    (count, words), pixels = rows.shape, len(offsets) - 1
    background = rng.integers(0, 256, (pixels, 4)).astype(np.uint8)
    lists = device.upload(offsets.astype(np.int32)), device.upload(rows), words
    uploaded, picture = device.upload(background), device.empty((pixels, 4), np.uint8)

    def run() -> None:
        blend_lists(device, pixels, *lists, uploaded, picture, "blend")

    def results() -> list[Result]:
        run()
        return [Result(picture.get(), blend_twin(offsets, rows[:, :1].copy().view(np.uint8), background))]

    return Trial({"n": count, "words": words, "pixels": pixels}, run, results)


LAYERING = {
    "layers.renumber": Cost("n + pixels", "12*(n + pixels)"),
    "layers.mark_layers": Cost("n", "13*n + 8*pixels"),
    "blend.blend_layers": Cost("n", "12*n + 12*pixels", "7*n"),
    "layers.count_up": Cost("n", "4*n"),
}


@case(LAYERING, 480, 96)
def layering(device: Device, kind: str, size: int) -> Trial:
    """Half of the triangles are see-through, in front of the others."""
    rng, whole = seeded(kind), room(device, kind, 1000)
    blended = rng.random(whole.count) < 0.5
    flags = (np.where(blended, Triangles.BLENDED, 0) | Triangles.DOUBLE_SIDED).astype(np.uint8)
    triangles = Triangles.upload(device, whole.host_positions, whole.host_indices, flags)
    glass, _ = glass_opacity(device, rng, triangles)
    layers, view = Layers(LayeredRasteriser(device, triangles), glass), camera(size)
    shape = (VIEW, PROJECTION, view.width, view.height)
    visible, fragments = layers.rasteriser.draw(*shape, "layers")
    n, opacity, marked = fragments.count, glass.of(fragments.samples, "layers"), device.zeros(triangles.count, np.uint8)
    colours = device.upload(rng.integers(0, 256, (max(n, 1), 4)).astype(np.uint8))
    background = rng.integers(0, 256, (view.height, view.width, 4)).astype(np.uint8)
    picture, before = device.upload(background), visible.triangle.get()
    nearest = device.upload(before)

    def run() -> None:
        layers.mark(*shape, marked, "layers")
        numbered(device, fragments, "layers")
        seen = (fragments.samples.triangle, picture, nearest)
        blend_layers(device, fragments, colours, opacity, *seen, "layers")

    def results() -> list[Result]:
        picture.set(background)
        nearest.set(before)
        device.fill(marked, 0)
        run()
        offsets, ids, _, _ = host(fragments)
        alphas = opacity.get()[:n]
        rgba = np.concatenate([colours.get()[:n, :3], alphas[:, None].astype(np.uint8)], axis=1)
        blend = blend_twin(offsets, rgba, background.reshape(-1, 4))
        return [
            Result(picture.get().reshape(-1, 4)[:, :3], blend[:, :3]),
            Result(nearest.get().ravel(), nearest_twin(offsets, alphas, ids, before.ravel())),
            Result(
                marked.get()[: triangles.count],
                mark_layers_twin(offsets, ids, alphas, before.ravel(), np.zeros(triangles.count, np.uint8)),
            ),
        ]

    return Trial({"n": n, "pixels": fragments.pixels}, run, results)
