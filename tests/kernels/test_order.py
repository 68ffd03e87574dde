"""The order in which fragments are shaded: a permutation, by tile and triangle, that changes no colour."""

import numpy as np
import pytest

from shading_atlas_bench.kernels.fragments.build import Fragments
from shading_atlas_bench.kernels.fragments.layered import numbered
from shading_atlas_bench.kernels.fragments.layers import shade_fragments
from shading_atlas_bench.kernels.fragments.order import BUCKETS, TILE, order_fragments, order_twin
from shading_atlas_bench.kernels.samples import Samples
from shading_atlas_bench.kernels.shade.inputs import CASES, EYE, TRIANGLES, make_shader


def fragments_with(device, counts, triangle, seed=0):
    """Fragments of a picture, counts int (h, w), of these triangles, with random surface points."""
    height, width = counts.shape
    offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    rng, n = np.random.default_rng(seed), len(triangle)
    pixel = np.repeat(np.arange(width * height), counts.ravel())
    b1, b2, footprint = (rng.random(n).astype(np.float32) / 2 for _ in range(3))
    samples = Samples.upload(device, triangle.astype(np.int32), b1, b2, footprint, pixel.astype(np.int32))
    return Fragments(width, height, samples, device.zeros(n, np.float32), device.upload(offsets))


def one_pixel(height, width):
    """All fragments in the last pixel: more layers than a tile has pixels."""
    counts = np.zeros((height, width), int)
    counts[-1, -1] = 3 * TILE * TILE
    return counts


SIZE = (2 * TILE + 5, 3 * TILE - 1)  # rows and columns that end within a tile
COUNTS = {
    "some empty": lambda rng: rng.integers(0, 6, SIZE) * (rng.random(SIZE) < 0.6),
    "one layer": lambda rng: np.ones(SIZE, int),
    "nothing": lambda rng: np.zeros(SIZE, int),
    "one pixel with all": lambda rng: one_pixel(*SIZE),
    "more layers than pixels": lambda rng: np.array([[700, 0, 900]]),
    "empty tiles": lambda rng: np.pad(rng.integers(0, 3, (TILE, TILE)), ((TILE, 5), (0, TILE))),
}
NUMBERS = {
    "one": lambda rng, n: np.zeros(n, int),
    "a few": lambda rng, n: rng.integers(0, 9, n),
    "many": lambda rng, n: rng.integers(0, 2**31 - 1, n),
    "all of one bucket": lambda rng, n: rng.integers(0, 50, n) * BUCKETS + BUCKETS - 1,
}


@pytest.mark.parametrize("numbers", NUMBERS)
@pytest.mark.parametrize("counts", COUNTS)
def test_every_fragment_comes_once_where_the_twin_puts_it(device, counts, numbers):
    rng = np.random.default_rng(7)
    shape = COUNTS[counts](rng)
    triangle = NUMBERS[numbers](rng, int(shape.sum()))
    fragments = fragments_with(device, shape, triangle)
    ordered, n = order_fragments(device, fragments, "order"), fragments.count
    places = order_twin(fragments.offsets.get(), triangle, fragments.width)
    assert ordered.count == n
    np.testing.assert_array_equal(np.sort(places), np.arange(n))
    np.testing.assert_array_equal(ordered.texel.get()[:n], places)
    for name in ("triangle", "bary1", "bary2", "footprint"):
        found, before = (getattr(samples, name).get()[:n] for samples in (ordered, fragments.samples))
        np.testing.assert_array_equal(found, before[places])


def test_a_tile_comes_after_the_other_and_its_triangles_in_turn(device):
    """A wall of four columns' triangles behind two panes, worked out by hand: in each tile one run per triangle."""
    counts = np.full((TILE, 2 * TILE), 3)
    wall = np.arange(2 * TILE) * 4 // (2 * TILE)
    triangle = np.stack([np.full(2 * TILE, 9), np.full(2 * TILE, 7), wall], axis=1)[None].repeat(TILE, axis=0).ravel()
    ordered = order_fragments(device, fragments_with(device, counts, triangle), "order")
    area = TILE * TILE
    runs = [(0, area // 2), (1, area // 2), (7, area), (9, area), (2, area // 2), (3, area // 2), (7, area), (9, area)]
    np.testing.assert_array_equal(ordered.triangle.get()[: 6 * area], np.repeat(*np.transpose(runs)))


def test_work_group_size_changes_no_byte(device, monkeypatch):
    rng = np.random.default_rng(8)
    counts = rng.integers(0, 4, SIZE)
    fragments = fragments_with(device, counts, rng.integers(0, 40, counts.sum()))
    expected = order_fragments(device, fragments, "order").texel.get()[: fragments.count].tobytes()
    monkeypatch.setattr(device, "local_size", 7)
    assert order_fragments(device, fragments, "order").texel.get()[: fragments.count].tobytes() == expected


@pytest.mark.parametrize("case", CASES)
def test_colours_are_those_of_list_order_to_the_byte(device, case):
    """Where eight samples of as many triangles are shaded at once, and where eight of one triangle are."""
    materials, lights, features = CASES[case]
    shader, rng = make_shader(device, materials, lights, **features), np.random.default_rng(9)
    counts = rng.integers(0, 6, (40, 50))
    triangle = rng.integers(0, min(TRIANGLES, 20), counts.sum())
    fragments = fragments_with(device, counts, triangle)
    expected = device.zeros((1, fragments.count, 4), np.uint8)
    shader.shade(numbered(device, fragments, "numbers").samples, EYE, expected)
    found = shade_fragments(shader, fragments, EYE, "shade").get()
    assert found.tobytes() == expected.get().tobytes()
    assert len(np.unique(found[0], axis=0)) > 20
