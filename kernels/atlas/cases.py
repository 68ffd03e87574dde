"""Cases of lookups in an atlas."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.kernels.atlas.locate import locate, locate_twin
from shading_atlas_bench.kernels.atlas.lookup import look_up, look_up_twin
from shading_atlas_bench.kernels.atlas.opacity import fragment_opacity, fragment_opacity_twin
from shading_atlas_bench.kernels.case import Bound, Cost, Result, Trial, case, seeded
from shading_atlas_bench.kernels.fragments.opacity import VARIES
from shading_atlas_bench.kernels.samples import WIDTH, Samples

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device

SIDE, TRIANGLES = 2048, 5000


@case(
    {"locate.locate": Cost("n", "12*n + 24*n + 8*n", "13*n")},
    1 << 19,
    1 << 16,
    typical=Bound(2),
    adversarial=Bound(1200),  # corners whose weights are up to 10^6 times those of the point: they cancel
)
def location(device: Device, kind: str, size: int) -> Trial:
    """Adversarial: perspective-correct, with weights that almost vanish, and without a place."""
    rng, hard = seeded(kind), kind == "adversarial"
    exact = rng.uniform(0.5, SIDE - 0.5, (TRIANGLES, 1, 2)) + rng.normal(size=(TRIANGLES, 3, 2)) * 8
    if hard:
        weight = 10.0 ** rng.uniform(-6, 0, (TRIANGLES, 3, 1))
        exact = np.concatenate([exact * weight, weight], axis=2)
        exact[::50] = np.nan
    corners = exact.astype(np.float32)
    triangle = np.sort(rng.integers(0, TRIANGLES, size))
    bary = rng.dirichlet(np.ones(3), size)[:, 1:].astype(np.float32)
    samples = Samples.upload(device, triangle, bary[:, 0], bary[:, 1], np.zeros(size), np.arange(size))
    uploaded = device.upload(corners)

    def run() -> Array:
        return locate(device, samples, uploaded, "locate")

    def results() -> list[Result]:
        found, expected = run().get()[:, :size].T, locate_twin(corners, triangle, bary)
        placed = np.isfinite(expected[:, 0])
        return [Result(found[placed], expected[placed]), Result(np.isnan(found), np.isnan(expected))]

    return Trial({"n": size}, run, results)


@case({"lookup.look_up": Cost("n", "8*n + 16*n + 16*n + 8*n", "21*n")}, 1 << 19, 1 << 16)
def lookup(device: Device, kind: str, size: int) -> Trial:
    """Adversarial: at texel centres, beyond the edges and without a place."""
    rng, hard = seeded(kind), kind == "adversarial"
    plane = rng.integers(0, 256, (SIDE, SIDE, 4), dtype=np.uint8)
    room = -(-size // WIDTH) * WIDTH
    places = rng.uniform(0, SIDE - 1, (2, room)).astype(np.float32)
    if hard:
        places[:, ::3] = np.round(places[:, ::3])
        places[:, 1::7] += SIDE // 2
        places[:, ::50] = np.nan
    triangle = np.sort(rng.integers(0, TRIANGLES, size))
    nothing = np.zeros(size)
    samples = Samples.upload(device, triangle, nothing, nothing, nothing, np.arange(size))
    uploaded, ids = device.upload(places), device.upload(np.arange(TRIANGLES, dtype=np.int32))
    atlas = device.upload(plane)
    rgb, drawn = device.zeros((1, size, 4), np.uint8), device.zeros((1, size), np.int32)

    def run() -> None:
        look_up(device, samples, uploaded, ids, atlas, rgb, drawn, "lookup")

    def results() -> list[Result]:
        run()
        expected = look_up_twin(places[:, :size].T.astype(np.float64), plane)
        placed = np.isfinite(expected[:, 0])
        colours = Result(rgb.get()[0, placed, :3], expected[placed])
        return [colours, Result(drawn.get()[0], np.where(placed, triangle, 0))]

    return Trial({"n": size}, run, results)


@case({"opacity.fragment_opacity": Cost("n", "20*n")}, 1 << 19, 1 << 16)
def opacity(device: Device, kind: str, size: int) -> Trial:
    """A quarter of the triangles have theirs in the alpha plane. Adversarial: all of them, and half have no place."""
    rng, hard = seeded(kind), kind == "adversarial"
    triangle = np.sort(rng.integers(0, TRIANGLES, size)).astype(np.int32)
    drawn = rng.integers(-1 if hard else 0, 1, size).astype(np.int32)
    constants = np.where(rng.random(TRIANGLES) < (1 if hard else 0.25), VARIES, 128).astype(np.int32)
    alphas = rng.integers(0, 256, (size, 4), np.uint8)
    ids, placed, listed, plane = (device.upload(array) for array in (triangle, drawn, constants, alphas))

    def run() -> Array:
        return fragment_opacity(device, size, ids, placed, listed, plane, "opacity")

    def results() -> list[Result]:
        return [Result(run().get(), fragment_opacity_twin(triangle, drawn, constants, alphas[:, 0]))]

    return Trial({"n": size}, run, results)
