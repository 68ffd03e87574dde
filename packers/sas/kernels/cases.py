"""Cases of Shading Atlas Streaming: patches of all sizes, and those that allocation and emission find hardest."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.kernels.case import Bound, Cost, Result, Trial, case, seeded
from shading_atlas_bench.packers.sas.kernels.allocate import Allocator, AllocatorTwin, SuperblockGrid
from shading_atlas_bench.packers.sas.kernels.bias import Request, needed_superblocks, needed_superblocks_twin
from shading_atlas_bench.packers.sas.kernels.corners import locate_corners, locate_corners_twin
from shading_atlas_bench.packers.sas.kernels.emit import (
    count_asked,
    count_asked_twin,
    emit_samples,
    emit_samples_twin,
    without_texel_twin,
)
from shading_atlas_bench.packers.sas.kernels.footprint import SIZES, STEPS, measure_sides, measure_sides_twin
from shading_atlas_bench.packers.sas.kernels.inputs import all_visible, random_masks, random_patches, words_in_rows
from shading_atlas_bench.packers.sas.kernels.layout import pack_location
from shading_atlas_bench.packers.sas.kernels.visible import (
    Marks,
    VisiblePatches,
    visible_patches,
    visible_patches_twin,
)

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic.arrays import Words
    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.kernels.samples import Samples


@case({"footprint.measure_sides": Cost("n", "(4 + 20 + 60 + 4)*n", "120*n")}, 8000)
def sides(device: Device, kind: str, size: int) -> Trial:
    """Compares with the twin's steps rounded up. Adversarial: 1e6 from the origin, the eye among the vertices."""
    soup, offset = random_patches(seeded(kind), size), 1e6 * (kind == "adversarial")
    positions = (soup.positions + offset).astype(np.float32)
    eye, patches = np.array([0.1, -0.2, 0.3]) + offset, np.arange(size, dtype=np.int32)
    visible, points = all_visible(device, np.ones(size, np.uint8)), device.upload(soup.points)
    uploaded = device.upload(positions)

    def run() -> tuple[Array, Array]:
        return measure_sides(device, visible, points, uploaded, eye, 700.0)

    def results() -> list[Result]:
        steps = STEPS * measure_sides_twin(patches, soup.points, positions, eye, 700.0)
        found = run()[0].get()[:size]
        return [Result(np.stack([found & 0xFF, found >> 8], axis=1), np.ceil(steps))]

    return Trial({"n": size}, run, results)


VISIBLE = {
    "visible.mark_triangles": Cost("t", "8*t"),
    "visible.find_first": Cost("t", "(4 + 4 + 12 + 12 + 4)*t"),
    "visible.list_patches": Cost("t", "(4 + 4 + 4)*t + 17*n"),
}


@case(VISIBLE, 8000)
def visibility(device: Device, kind: str, size: int) -> Trial:
    """Adversarial: every triangle is visible, and numbered at random."""
    rng = seeded(kind)
    soup = random_patches(rng, size)
    share = 1 if kind == "adversarial" else 0.2
    pvs = np.flatnonzero(rng.random(len(soup.of_triangle)) < share).astype(np.int32)
    marks, tables, uploaded = Marks.none(device, len(soup.of_triangle)), soup.upload(device), device.upload(pvs)

    def run() -> VisiblePatches:
        return visible_patches(device, uploaded, len(pvs), tables, marks)

    def results() -> list[Result]:
        found = run()
        patches, masks = visible_patches_twin(pvs, soup.of_triangle, soup.members)
        return [Result(found.patches.get()[: found.count], patches), Result(found.masks.get()[: found.count], masks)]

    return Trial({"n": size * share, "t": len(pvs)}, run, results)


BIAS = {
    "bias.sum_rows": Cost(f"{SIZES**2}", f"8*{SIZES**2}", f"{SIZES**2}"),
    "bias.sum_columns": Cost(f"{SIZES**2}", f"8*{SIZES**2}", f"{SIZES**2}"),
    "bias.needed_superblocks": Cost(f"{SIZES}*81", f"16*{SIZES}*81", f"4*{SIZES}*81"),
}


@case(BIAS, 1_000_000)
def bias(device: Device, kind: str, size: int) -> Trial:
    """Adversarial: all patches of one size."""
    w, h = np.full((2, size), 77) if kind == "adversarial" else seeded(kind).integers(0, SIZES, (2, size))
    histogram = np.zeros((SIZES, SIZES), np.int32)
    np.add.at(histogram, (h, w), 1)
    uploaded = device.upload(histogram)

    def results() -> list[Result]:
        found = needed_superblocks(device, device.upload(histogram), 8)
        return [Result(found, needed_superblocks_twin(histogram, 8))]

    return Trial({"n": size}, lambda: needed_superblocks(device, uploaded, 8), results)


ALLOCATION = {
    "allocate.request": Cost("3*n", "(4 + 4 + 4 + 8)*3*n"),
    "allocate.release_hidden": Cost("2*n", "(4 + 12 + 4 + 4)*2*n"),
    "allocate.provision": Cost("3*c", "24*3*c"),
    "allocate.assign": Cost("3*n", "(12 + 8 + 4)*3*n"),
    "allocate.carry_pool": Cost("4*c", "16*4*c"),
    "allocate.recycle": Cost("4*n", "(12 + 8)*4*n"),
    "allocate.read_words": Cost("n", "12*n"),
}


@case(ALLOCATION, 20_000, 2000)
def allocation(device: Device, kind: str, size: int) -> Trial:
    """Three frames that reuse blocks. Adversarial: every size changes, and the atlas overflows."""
    rng, hard = seeded(kind), kind == "adversarial"
    grid = SuperblockGrid(8, 4, 4) if hard else SuperblockGrid(8, 16, 16)
    frames = (
        [rng.integers(0, 64 if hard else 32, (size, 2)) for _ in range(3)]
        if hard
        else 3 * [rng.integers(0, 32, (size, 2))]
    )
    sizes = [(pair[:, 0] | pair[:, 1] << 8).astype(np.int32) for pair in frames]
    patches, members = np.arange(size, dtype=np.int32), np.full((size, 3), -1, np.int32)
    members[:, 0] = patches
    visible, marks = all_visible(device, np.ones(size, np.uint8)), Marks(device.upload(np.ones(size, np.int32)), 1)
    uploaded, requests = device.upload(members), [Request(device.upload(asked), 0) for asked in sizes]

    def run() -> Words:
        allocator = Allocator(device, grid, size, reuse=True)
        for request in requests:
            allocator.allocate(visible, request, uploaded, marks)
        return allocator.read(visible)

    def results() -> list[Result]:
        twin = AllocatorTwin(grid, size, reuse=True)
        for asked in sizes:
            twin.allocate(patches, asked, 0)
        return [Result(run(), twin.words)]

    return Trial({"n": size, "c": grid.classes}, run, results)


@case({"corners.locate_corners": Cost("n", "(4 + 1 + 4 + 24)*n", "12*n")}, 1 << 18)
def corners(device: Device, kind: str, size: int) -> Trial:
    """Adversarial: blocks of one texel's width, and patches without a block."""
    rng, hard = seeded(kind), kind == "adversarial"
    w, h = rng.integers(0, 1 if hard else 9, size), rng.integers(0, 9, size)
    words = pack_location(rng.integers(0, 8192 >> w) << w, rng.integers(0, 8192 >> h) << h, w, h)
    words[:: 2 if hard else size] = 0
    patches, codes = rng.integers(0, size, size).astype(np.int32), rng.integers(0, 15, size).astype(np.uint8)
    of_triangle, roles, places = device.upload(patches), device.upload(codes), device.upload(words)

    def run() -> Array:
        return locate_corners(device, of_triangle, roles, size, places, "corners")

    return Trial({"n": size}, run, lambda: [Result(run().get(), locate_corners_twin(patches, codes, words))])


@case({"emit.ask_in_corner": Cost("n", "(4 + 4 + 4)*n")}, 1 << 14, 400)
def budget(device: Device, kind: str, size: int) -> Trial:
    """How many samples patches ask for. Adversarial: sides beyond a superblock's, and one triangle of each visible."""
    rng, hard = seeded(kind), kind == "adversarial"
    soup, top, bias = random_patches(rng, size), 4, 3
    w, h = rng.integers(0, SIZES if hard else 40, (2, size))
    sizes = (w | h << 8).astype(np.int32)
    masks = np.ones(size, np.uint8) if hard else random_masks(rng, soup)
    visible, request, tables = all_visible(device, masks), Request(device.upload(sizes), bias), soup.upload(device)

    def run() -> int:
        return count_asked(device, visible, request, top, tables, False)

    def results() -> list[Result]:
        return [Result(np.array([run()]), np.array([count_asked_twin(masks, sizes, bias, top, soup)]))]

    return Trial({"n": size}, run, results)


EMISSION = {
    "emit.count_samples": Cost("p", "9*p"),
    "emit.texel_derivatives": Cost("p", "(12 + 3 + 36 + 108 + 24)*p", "60*p"),
    "emit.emit_samples": Cost("n", "20*n", "12*n"),
}


@case(EMISSION, 256, 81, typical=Bound(5))
def emission(device: Device, kind: str, size: int) -> Trial:
    """Adversarial: blocks of one texel's height and large fans, of which one triangle is visible."""
    rng, hard = seeded(kind), kind == "adversarial"
    levels = [(k % 9, 0) for k in range(size)] if hard else [(k % 9, k // 9 % 9) for k in range(size)]
    soup = random_patches(rng, size, 3 if hard else None)
    masks = np.full(size, 2, np.uint8) if hard else random_masks(rng, soup)
    words, patches = words_in_rows(levels), np.arange(size, dtype=np.int32)
    visible, uploaded = all_visible(device, masks), device.upload(words)

    def run() -> tuple[Samples, int]:
        return emit_samples(device, visible, uploaded, soup.upload(device), 4096, False)

    def results() -> list[Result]:
        samples, without = run()
        expected = emit_samples_twin(patches, masks, words, soup, 4096, False)
        found = [Result(getattr(samples, name).get()[: samples.count], values) for name, values in expected.items()]
        bare = without_texel_twin(patches, masks, words, soup.members, expected["triangle"])
        return [*found, Result(np.array([without]), np.array([bare]))]

    return Trial({"n": run()[0].count, "p": size}, run, results)
