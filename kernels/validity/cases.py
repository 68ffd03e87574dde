"""Cases of the screens: what nothing is wrong with passes, and what could be is marked."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.kernels.case import Cost, Result, Trial, case, seeded
from shading_atlas_bench.kernels.validity.lists import (
    Surfaces,
    WalkedLists,
    compare_nearest,
    compare_nearest_twin,
    walk_lists,
    walk_lists_twin,
)
from shading_atlas_bench.kernels.validity.lookups import (
    Limits,
    Lookups,
    LookupScreen,
    Screened,
    TriangleTable,
    screen_lookups_twin,
)
from shading_atlas_bench.kernels.validity.samples import (
    PlacedSamples,
    SampleList,
    choose_samples_twin,
    place_samples,
    sample_plane_twin,
)
from shading_atlas_bench.kernels.validity.texels import compare_alpha, compare_alpha_twin

if TYPE_CHECKING:
    from shading_atlas_bench.arithmetic.arrays import Bytes, Doubles, Floats, Ints, Longs
    from shading_atlas_bench.kernels.device import Device

CELL = 16  # texels along the side of the square in which a triangle lies
TRIANGLES = 400
LIMITS = {"typical": Limits(1 / 512, None, 1 / 3, 3.0), "adversarial": Limits(1 / 512, 0.49, 1 / 3, 3.0)}
# Weights that decide something, or are none.
ODD = np.array([np.nan, np.inf, -np.inf, 3e38, -1, np.nextafter(-1, -2), -1e-4, 1.0001, 2, 0], np.float32)
DEPTHS = np.array([np.nan, np.inf, -np.inf, -1, 0, 1e-45, 0.5], np.float32)  # nearly all of them none


def cells(size: int) -> tuple[Longs, Ints, Floats, int]:
    """Samples of triangles in square cells: texel (n), triangle (n), bary (n, 2), and the atlas' side."""
    across = max(1, round(np.sqrt(size) / CELL))
    row, column = np.indices((across * CELL, across * CELL)).reshape(2, -1)
    triangle = (row // CELL * across + column // CELL).astype(np.int32)
    bary = np.stack([column % CELL, row % CELL], axis=1) / (CELL - 1)
    return np.arange(len(row)), triangle % TRIANGLES, bary.astype(np.float32), across * CELL


def broken(rng: np.random.Generator, bary: Floats) -> Floats:
    """Every seventh weight of bary (n, 2) is an odd one."""
    odd = rng.random(bary.shape) < 1 / 7
    return np.where(odd, rng.choice(ODD, bary.shape), bary)


@case({"samples.place_samples": Cost("n", "20*n + 4*n + 2*n")}, 1 << 21, 1 << 16)
def samples(device: Device, kind: str, size: int) -> Trial:
    """Every third triangle has its turn. Adversarial: odd weights, and a tenth of the samples lies outside."""
    rng, hard = seeded(kind), kind == "adversarial"
    texel, triangle, bary, side = cells(size)
    if hard:
        bary = broken(rng, bary)
        outside = rng.random(len(texel)) < 0.1
        beyond = rng.choice([-1, -(1 << 40), side * side, (1 << 32) + 5, 1 << 62], len(texel))
        texel = np.where(outside, beyond, rng.permutation(texel))
    has_turn = np.arange(TRIANGLES) % 3 == 1
    listed = SampleList.lent(device, texel, triangle, bary)

    def run() -> PlacedSamples:
        return place_samples(device, listed, side, side, has_turn, "check")

    def results() -> list[Result]:
        placed, (chosen, far) = run(), choose_samples_twin(triangle, bary, has_turn)
        counts = np.array([placed.outside, placed.distant])
        expected = np.array([((texel < 0) | (texel >= side * side)).sum(), far.sum()])
        return [
            Result(placed.plane.get(), sample_plane_twin(texel, side, side)),
            Result(placed.chosen.get()[: len(chosen)], chosen),
            Result(placed.far.get()[: len(far)], far),
            Result(counts, expected),
        ]

    return Trial({"n": len(texel)}, run, results)


@case({"texels.compare_alpha": Cost("n", "8*n")}, 1 << 22, 1 << 16)
def texels(device: Device, kind: str, size: int) -> Trial:
    """A third is owned. Adversarial: alphas of 0, 1, 254 and 255."""
    rng, hard = seeded(kind), kind == "adversarial"
    side = max(1, round(np.sqrt(size)))
    plane = np.where(rng.random((side, side)) < 1 / 3, rng.integers(0, 1 << 30, (side, side)), -1).astype(np.int32)
    colours: Bytes = rng.integers(0, 256, (side, side, 4), dtype=np.uint8)
    colours[..., 3] = rng.choice([0, 1, 254, 255], (side, side)) if hard else np.where(plane >= 0, 255, 0)
    uploaded, numbers = device.upload(colours), device.upload(plane)

    def run() -> tuple[int, int]:
        return compare_alpha(device, uploaded, numbers, "check")

    def results() -> list[Result]:
        return [Result(np.array(run()), np.array(compare_alpha_twin(colours, plane)))]

    return Trial({"n": side * side}, run, results)


def table_of(rng: np.random.Generator, every: int) -> TriangleTable:
    """Triangles that fill half of their cells; of `every` one is in no row."""
    row = np.full(TRIANGLES, -1, np.int32)
    listed = np.flatnonzero(np.arange(TRIANGLES) % every > 0)
    row[listed] = np.arange(len(listed))
    jacobian = np.zeros((2, len(listed), 2))
    jacobian[0, :, 0] = jacobian[1, :, 1] = CELL - 1
    corners = rng.normal(size=(len(listed), 3, 3)).astype(np.float32).astype(np.float64)
    return TriangleTable(row, jacobian, rng.uniform(0, 1, len(listed)), corners)


def points_of(rng: np.random.Generator, triangle: Ints, bary: Floats, side: int, size: int) -> Lookups:
    """Points of the triangles of samples, triangle (n) and bary (n, 2), looked up where they are."""
    some = rng.integers(0, len(triangle), size)
    texel: Doubles = np.stack([some % side, some // side], axis=1, dtype=np.float64) + 0.5
    off = rng.uniform(-0.5, 0.5, (size, 2))
    return Lookups(triangle[some], (bary[some] + off / (CELL - 1)).astype(np.float32), texel + off)


@case({"lookups.screen_lookups": Cost("n", "28*n + 4*4*n + n", "60*n")}, 1 << 17, 1 << 13)
def lookups(device: Device, kind: str, size: int) -> Trial:
    """Points of triangles that own nearly all that they touch. Adversarial: with declared gaps, and beside odd weights,
    texels that others own or nobody, and points looked up elsewhere, outside and nowhere."""
    rng, hard = seeded(kind), kind == "adversarial"
    _, triangle, bary, side = cells(8 * size)
    plane = np.arange(side * side, dtype=np.int32).reshape(side, side)
    points, table = points_of(rng, triangle, bary, side, size), table_of(rng, 5 if hard else TRIANGLES)
    if hard:
        plane[rng.random(plane.shape) < 0.1] = -1
        triangle = np.where(rng.random(len(triangle)) < 0.1, rng.integers(0, TRIANGLES, len(triangle)), triangle)
        place = points.place + np.where(rng.random((size, 1)) < 0.1, rng.uniform(-2, 2, (size, 2)), 0)
        place = np.where(rng.random((size, 1)) < 0.1, rng.choice([np.nan, np.inf, -np.inf, -1e9, 1e300, side]), place)
        place[rng.random(size) < 0.1, 1] = np.nan
        bary, triangle = broken(rng, bary), triangle.astype(np.int32)
        points = Lookups(points.triangle, broken(rng, points.bary), place, only_known=True)
    listed, uploaded = SampleList.lent(device, np.arange(len(triangle)), triangle, bary), device.upload(plane)
    screen = LookupScreen(device, listed, uploaded, table, LIMITS[kind], "check")

    def run() -> Screened:
        return screen.screen(points)

    def results() -> list[Result]:
        found, expected = run(), screen_lookups_twin((triangle, bary), plane, table, LIMITS[kind], points)
        marks = [np.isin(np.arange(size), of.marked) for of in (found, expected)]
        counts = [np.array([of.touched, of.missing]) for of in (found, expected)]
        return [Result(*marks), Result(*counts)]

    return Trial({"n": size}, run, results)


def lists_of(rng: np.random.Generator, pixels: int, hard: bool) -> tuple[Longs, Bytes, Floats]:
    """Lists of 0 to 3 fragments, nearest first, as HeldLists has them: offsets (pixels + 1), rgba (n, 4), depth (n)."""
    offsets = np.concatenate([[0], np.cumsum(rng.integers(0, 4, pixels))])
    pixel = np.repeat(np.arange(pixels), np.diff(offsets))
    depth = rng.uniform(0.1, 1, len(pixel)).astype(np.float32)
    depth = depth[np.lexsort((-depth, pixel))]
    rgba = rng.integers(1, 256, (len(pixel), 4), dtype=np.uint8)
    if hard:
        rgba[rng.random(len(pixel)) < 0.3, 3] = 0
        some = rng.random(len(pixel)) < 0.1
        depth = np.where(some, rng.choice(DEPTHS, len(pixel)), depth)
        some = rng.random(len(offsets)) < 0.01
        offsets = np.where(some, rng.choice([0, -1, len(pixel), len(pixel) + 1, 1 << 40], len(offsets)), offsets)
    return offsets, rgba, depth


@case({"lists.walk_lists": Cost("n", "12*n + 1.5*8*n")}, 1 << 20, 1 << 14)
def walking(device: Device, kind: str, size: int) -> Trial:
    """Adversarial: fragments that are not there, without a depth and out of order, and lists that end anywhere."""
    offsets, rgba, depth = lists_of(seeded(kind), size, kind == "adversarial")

    def run() -> WalkedLists:
        return walk_lists(device, offsets, rgba, depth, "check")

    def results() -> list[Result]:
        found, (nearest, *counts) = run(), walk_lists_twin(offsets, rgba, depth)
        walked = found.nearest.get()[:size]
        counted = Result(np.array([found.visible, found.broken]), np.array(counts))
        return [Result(walked.view(np.int32), nearest.view(np.int32)), counted]

    return Trial({"n": size}, run, results)


@case({"lists.compare_nearest": Cost("n", "13*n")}, 1 << 20, 1 << 14)
def nearest(device: Device, kind: str, size: int) -> Trial:
    """A tenth lies elsewhere. Adversarial: by as much as is allowed, and depths that are none."""
    rng, hard = seeded(kind), kind == "adversarial"
    depth = rng.uniform(0.1, 1, size).astype(np.float32)
    found = np.where(rng.random(size) < 0.1, rng.uniform(0, 1, size), depth).astype(np.float32)
    if hard:
        found = np.where(rng.random(size) < 0.5, depth * np.float32(1 + 1e-4), found)
        depth, found = (np.where(rng.random(size) < 0.1, rng.choice(DEPTHS, size), of) for of in (depth, found))
    triangle = rng.integers(-1, TRIANGLES, size).astype(np.int32)
    known, owned = rng.random(TRIANGLES) < 0.7, rng.random(size) < 0.9
    surfaces, uploaded = Surfaces(device.upload(depth), device.upload(triangle)), device.upload(found)

    def run() -> int:
        return compare_nearest(device, surfaces, known, owned, uploaded, 1e-4, "check")

    def results() -> list[Result]:
        expected = compare_nearest_twin(depth, triangle, known, owned, found, 1e-4)
        return [Result(np.array([run()]), np.array([np.count_nonzero(expected)]))]

    return Trial({"n": size}, run, results)
