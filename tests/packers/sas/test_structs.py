"""Structures of Shading Atlas Streaming against their twins: visible patches, sizes, bias, ranks, locations."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shading_atlas_bench.kernels.common.rank import rank_by_class, rank_by_class_twin
from shading_atlas_bench.packers.sas.kernels.bias import levels_at, needed_superblocks, needed_superblocks_twin
from shading_atlas_bench.packers.sas.kernels.corners import locate_corners, locate_corners_twin
from shading_atlas_bench.packers.sas.kernels.footprint import SIZES, STEPS, measure_sides, measure_sides_twin
from shading_atlas_bench.packers.sas.kernels.inputs import all_visible, random_patches
from shading_atlas_bench.packers.sas.kernels.layout import (
    POINTS,
    ROLE_POINTS,
    ROLE_WEIGHTS,
    corner_points,
    pack_location,
    unpack_location,
)
from shading_atlas_bench.packers.sas.kernels.visible import (
    Marks,
    VisiblePatches,
    visible_patches,
    visible_patches_twin,
)


def test_roles_tile_the_square_without_flips():
    def area(role: int) -> float:
        a, b, c = POINTS[ROLE_POINTS[role]]
        return float(np.cross([*(b - a), 0], [*(c - a), 0])[2]) / 2

    assert [area(role) for role in range(5)] == [0.5, 0.5, 0.5, 0.25, 0.25]


def test_role_weights_are_one_at_their_corner():
    basis = np.concatenate([np.ones((5, 1)), POINTS], axis=1)
    for role in range(5):
        np.testing.assert_allclose(ROLE_WEIGHTS[role] @ basis[ROLE_POINTS[role]].T, np.eye(3), atol=1e-12)


@given(w=st.integers(0, 8), h=st.integers(0, 8), column=st.integers(0, 31), row=st.integers(0, 31))
def test_location_words_keep_place_and_size(w, h, column, row):
    x, y = column << w, row << h
    word = pack_location(np.array([x]), np.array([y]), np.array([w]), np.array([h]))
    assert word[0] != 0
    assert [int(value[0]) for value in unpack_location(word)] == [x, y, w, h]


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000), count=st.integers(0, 500), share=st.floats(0, 1))
def test_visible_patches_match_their_twin(device, seed, count, share):
    rng = np.random.default_rng(seed)
    soup = random_patches(rng, count)
    pvs = np.flatnonzero(rng.random(len(soup.of_triangle)) < share).astype(np.int32)
    marks, tables = Marks.none(device, len(soup.of_triangle)), soup.upload(device)
    for chosen in (pvs[::2], pvs[1::2], pvs):  # what an earlier set marked does not count
        found = visible_patches(device, device.upload(chosen), len(chosen), tables, marks)
        patches, masks = visible_patches_twin(chosen, soup.of_triangle, soup.members)
        np.testing.assert_array_equal(found.patches.get()[: found.count], patches)
        np.testing.assert_array_equal(found.masks.get()[: found.count], masks)


@pytest.mark.parametrize(("offset", "eye_offset"), [(0, 0), (1e4, 0.37), (1e6, 0.25)])
def test_sides_match_their_twin_within_a_step(device, offset, eye_offset):
    """At most 1e-3 of an eighth apart before rounding up, also far from the origin."""
    rng = np.random.default_rng(3)
    soup = random_patches(rng, 800)
    positions = (soup.positions + offset).astype(np.float32)
    eye = np.array([0.1, -0.2, 0.3]) + offset + eye_offset
    patches = rng.permutation(len(soup.members)).astype(np.int32)
    visible = VisiblePatches(len(patches), device.upload(patches), device.zeros(len(patches), np.uint8))
    measured, histogram = measure_sides(
        device, visible, device.upload(soup.points), device.upload(positions), eye, 700.0
    )
    exact = STEPS * measure_sides_twin(patches, soup.points, positions, eye, 700.0)
    sizes = measured.get()[: len(patches)]
    for k, found in enumerate((sizes & 0xFF, sizes >> 8)):
        low, high = np.ceil(exact[:, k] - 1e-3), np.ceil(exact[:, k] + 1e-3)
        assert ((low <= found) & (found <= high)).all()
    counted = np.zeros((SIZES, SIZES), np.int64)
    np.add.at(counted, (sizes >> 8, sizes & 0xFF), 1)
    np.testing.assert_array_equal(histogram.get(), counted)


@pytest.mark.parametrize(
    ("triangles", "width", "height", "steps"),
    [
        (1, 0.5, 0.5, (0, 0)),
        (1, 3.9, 1.9, (16, 8)),
        (2, 0.5, 0.5, (1, 0)),  # side by side, as neither has two texels of height
        (2, 0.5, 3.9, (0, 16)),
        (2, 3.9, 0.5, (16, 0)),
        (3, 0.5, 0.5, (1, 1)),  # two by two for three of them
        (3, 0.5, 3.9, (1, 16)),
        (3, 1.9, 0.5, (8, 1)),
        (3, 3.9, 0.5, (16, 0)),  # four in a row
    ],
)
def test_patches_below_a_pixel_have_a_texel_for_each_triangle(device, triangles, width, height, steps):
    """Rectangles 1000 units away, of a pixel per unit; sides are logarithms to base 2 in steps of 1/8, rounded up."""
    positions = (np.column_stack([POINTS * [width, height], np.full(5, -1000)])).astype(np.float32)
    present = {1: (0, 1, 3), 2: (0, 1, 2, 3), 3: (0, 1, 2, 3, 4)}[triangles]
    points = np.where(np.isin(np.arange(5), present), np.arange(5), -1).astype(np.int32)[None]
    uploaded = device.upload(points), device.upload(positions)
    sizes, _ = measure_sides(device, all_visible(device, np.ones(1, np.uint8)), *uploaded, np.zeros(3), 1000.0)
    assert (sizes.get()[0] & 0xFF, sizes.get()[0] >> 8) == steps
    exact = measure_sides_twin(np.zeros(1, np.int32), points, positions, np.zeros(3), 1000.0)
    assert tuple(np.ceil(STEPS * exact[0])) == steps


def test_an_eye_on_a_vertex_gives_finite_sizes(device):
    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
    points = np.array([[0, 1, -1, 2, -1]], np.int32)
    uploaded = device.upload(points), device.upload(positions)
    sizes, _ = measure_sides(device, all_visible(device, np.ones(1, np.uint8)), *uploaded, np.zeros(3), 500.0)
    assert 0 <= sizes.get()[0] < 1 << 16


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 1000), filled=st.integers(0, 400), top=st.integers(0, 8))
def test_needed_superblocks_match_their_twin(device, seed, filled, top):
    rng = np.random.default_rng(seed)
    histogram = np.zeros((SIZES, SIZES), np.int32)
    np.add.at(histogram, (rng.integers(0, SIZES, filled), rng.integers(0, SIZES, filled)), rng.integers(0, 50, filled))
    expected = needed_superblocks_twin(histogram, top)
    np.testing.assert_array_equal(needed_superblocks(device, device.upload(histogram), top), expected)


def test_the_largest_bias_makes_every_block_one_texel():
    assert (levels_at(np.arange(SIZES), SIZES - 1, 8) == 0).all()


def test_a_level_covers_the_footprint_without_bias():
    steps = np.arange(8 * STEPS + 1)
    assert (levels_at(steps, 0, 8) == np.ceil(steps / STEPS)).all()


@settings(max_examples=20, deadline=None)
@given(count=st.integers(0, 3000), runs=st.integers(1, 200), seed=st.integers(0, 1000))
def test_ranks_match_their_twin_for_every_number_of_runs(device, count, runs, seed):
    classes = np.random.default_rng(seed).integers(-1, 7, count).astype(np.int32)
    ranks, totals = rank_by_class(device, device.upload(classes), count, 7, "structs/test", runs)
    expected_ranks, expected_totals = rank_by_class_twin(classes, 7)
    np.testing.assert_array_equal(ranks.get()[:count], expected_ranks)
    np.testing.assert_array_equal(totals.get(), expected_totals)


def test_corners_match_their_twin(device):
    """Exactly: all values are halves below 2^14."""
    rng = np.random.default_rng(5)
    w, h = rng.integers(0, 9, 300), rng.integers(0, 9, 300)
    words = pack_location(rng.integers(0, 8192 >> w) << w, rng.integers(0, 8192 >> h) << h, w, h)
    words[::7] = 0
    patches = rng.integers(0, 300, 1000).astype(np.int32)
    codes = rng.integers(0, 15, 1000).astype(np.uint8)
    uploaded = device.upload(patches), device.upload(codes)
    found = locate_corners(device, *uploaded, 1000, device.upload(words), "client/test")
    expected = locate_corners_twin(patches, codes, words)
    np.testing.assert_array_equal(found.get(), expected.astype(np.float32))
    assert np.isnan(expected[words[patches] == 0]).all()


def test_a_rotation_turns_the_corners():
    np.testing.assert_array_equal(corner_points(np.array([0, 1, 2])), [[0, 1, 3], [3, 0, 1], [1, 3, 0]])
