"""Samples of blocks: against the twin, and every texel that a lookup inside a triangle touches is among them."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shading_atlas_bench.packers.sas.kernels.bias import levels_at
from shading_atlas_bench.packers.sas.kernels.corners import locate_corners_twin
from shading_atlas_bench.packers.sas.kernels.emit import emit_samples, emit_samples_twin, without_texel_twin
from shading_atlas_bench.packers.sas.kernels.footprint import measure_sides
from shading_atlas_bench.packers.sas.kernels.inputs import (
    ROLES,
    Soup,
    all_visible,
    random_masks,
    random_patches,
    words_in_rows,
)

WIDTH = 4096
FIELDS = ("triangle", "bary1", "bary2", "footprint", "texel")
ALL_LEVELS = [(w, h) for w in range(9) for h in range(9)]


def emit(device, soup: Soup, masks: np.ndarray, words: np.ndarray, complete=False, runs=None) -> dict:
    visible, tables = all_visible(device, masks), soup.upload(device)
    samples, without = emit_samples(device, visible, device.upload(words), tables, WIDTH, complete, runs)
    return {name: getattr(samples, name).get()[: samples.count] for name in FIELDS} | {"without": without}


@pytest.mark.parametrize("size", [1, 2, 3])
@pytest.mark.parametrize("complete", [False, True])
def test_matches_its_twin_at_all_levels(device, size, complete):
    """Texels and owners exactly; barycentrics within 1e-6 and footprints within 1e-5 of their size."""
    rng = np.random.default_rng(size)
    soup = random_patches(rng, len(ALL_LEVELS), size)
    masks, words = random_masks(rng, soup), words_in_rows(ALL_LEVELS)
    words[11] = 0
    found = emit(device, soup, masks, words, complete)
    patches = np.arange(len(words), dtype=np.int32)
    expected = emit_samples_twin(patches, masks, words, soup, WIDTH, complete)
    for name in ("texel", "triangle"):
        np.testing.assert_array_equal(found[name], expected[name])
    for name in ("bary1", "bary2"):
        np.testing.assert_allclose(found[name], expected[name], atol=1e-6)
    np.testing.assert_allclose(found["footprint"], expected["footprint"], rtol=1e-5)
    assert found["without"] == without_texel_twin(patches, masks, words, soup.members, expected["triangle"])


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10_000), levels=st.lists(st.sampled_from(ALL_LEVELS), min_size=1, max_size=30))
def test_lookups_inside_a_triangle_touch_written_texels(device, seed, levels):
    rng = np.random.default_rng(seed)
    soup = random_patches(rng, len(levels))
    masks, words = random_masks(rng, soup), words_in_rows(levels)
    found = emit(device, soup, masks, words)
    assert len(np.unique(found["texel"])) == len(found["texel"])
    written = set(found["texel"].tolist())
    for patch, mask in enumerate(masks):
        for slot in range(3):
            if mask >> slot & 1:
                triangle = soup.members[patch, slot]
                code, own = soup.codes[[triangle]], np.array([patch])
                corners = locate_corners_twin(own, code, words)[0]
                assert touched(rng, corners) <= written


def touched(rng: np.random.Generator, corners: np.ndarray) -> set[int]:
    """Texels that bilinear lookups at random points, corners and edges of a triangle use with any weight."""
    weights = np.concatenate([rng.dirichlet(np.ones(3), 200), rng.dirichlet(np.full(3, 0.05), 200), np.eye(3)])
    position = weights @ corners - 0.5
    base = np.floor(position + 1e-9)
    texels = set()
    for dx in (0, 1):
        for dy in (0, 1):
            weight = np.where([dx, dy], position - base, 1 - (position - base)).prod(axis=1)
            used = base[weight > 1e-6].astype(int) + np.array([dx, dy])
            texels |= set((used[:, 1] * WIDTH + used[:, 0]).tolist())
    return texels


@pytest.mark.parametrize("size", [1, 2, 3])
def test_samples_interpolate_to_the_point_looked_up(device, size):
    """The bilinear mean of the samples' surface points is the surface point itself, in sides over one texel."""
    rng = np.random.default_rng(size)
    levels = [level for level in ALL_LEVELS if min(level) >= 1 and max(level) <= 5]
    soup = random_patches(rng, len(levels), size)
    words = words_in_rows(levels)
    for role in range(size):
        masks = np.full(len(levels), 1 << role, np.uint8)
        found = emit(device, soup, masks, words)
        at = dict(zip(found["texel"].tolist(), range(len(found["texel"])), strict=True))
        for patch in range(len(levels)):
            triangle = soup.members[patch, role]
            corners = locate_corners_twin(np.array([patch]), soup.codes[[triangle]], words)[0]
            for weights in rng.dirichlet(np.ones(3), 5):
                x, y = weights @ corners - 0.5
                column, row = int(x), int(y)
                texels = [row * WIDTH + column, row * WIDTH + column + 1]
                texels += [texel + WIDTH for texel in texels]
                samples = [at[texel] for texel in texels]
                if (found["triangle"][samples] == triangle).all():
                    fx, fy = x - column, y - row
                    share = np.array([(1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy])
                    bary = np.stack([found["bary1"][samples], found["bary2"][samples]])
                    np.testing.assert_allclose(bary @ share, weights[1:], atol=1e-5)


def test_a_block_with_all_its_triangles_has_one_sample_per_texel(device):
    rng = np.random.default_rng(0)
    for size in (2, 3):
        soup = random_patches(rng, len(ALL_LEVELS), size)
        found = emit(device, soup, np.full(len(ALL_LEVELS), 2**size - 1, np.uint8), words_in_rows(ALL_LEVELS))
        assert len(found["texel"]) == sum(1 << w + h for w, h in ALL_LEVELS)
        bary = np.stack([1 - found["bary1"] - found["bary2"], found["bary1"], found["bary2"]])
        assert bary.min() >= -1e-6


def test_a_triangle_in_the_set_owns_what_it_shares(device):
    """The only texel of a pair's 1x1 block goes to the member that is visible."""
    soup = random_patches(np.random.default_rng(1), 2, 2)
    found = emit(device, soup, np.array([1, 2], np.uint8), words_in_rows([(0, 0), (0, 0)]))
    np.testing.assert_array_equal(found["triangle"], [soup.members[0, 0], soup.members[1, 1]])


@pytest.mark.parametrize("complete", [False, True])
def test_triangles_without_a_texel_are_counted_for_every_set(device, complete):
    """Small blocks, all sizes of patches, each with every choice of visible members."""
    rng, levels = np.random.default_rng(4), [(w, h) for w in range(3) for h in range(4)]
    for size in (1, 2, 3):
        for mask in range(1, 1 << size):
            soup, words = random_patches(rng, len(levels), size), words_in_rows(levels)
            masks = np.full(len(levels), mask, np.uint8)
            found = emit(device, soup, masks, words, complete)
            expected = without_texel_twin(
                np.arange(len(levels), dtype=np.int32), masks, words, soup.members, found["triangle"]
            )
            assert found["without"] == expected


@pytest.mark.parametrize(
    ("size", "level", "without"),
    [
        (1, (0, 0), 0),
        (2, (0, 0), 1),
        (2, (1, 0), 0),
        (2, (0, 1), 0),
        (3, (0, 0), 2),
        (3, (1, 0), 1),
        (3, (0, 3), 2),
        (3, (1, 1), 0),
        (3, (2, 0), 0),
    ],
)
def test_pairs_need_two_texels_and_fans_four_in_two_columns(device, size, level, without):
    soup = random_patches(np.random.default_rng(2), 1, size)
    assert emit(device, soup, np.array([2**size - 1], np.uint8), words_in_rows([level]))["without"] == without


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10_000), scale=st.floats(-5, 1), flat=st.floats(-4, 0), complete=st.booleans())
def test_without_a_bias_every_triangle_owns_a_texel(device, seed, scale, flat, complete):
    """Also of patches far below a pixel, and of slivers: sizes 10^scale, of which one axis is 10^flat of the others."""
    rng = np.random.default_rng(seed)
    soup = random_patches(rng, 200)
    positions = np.array([0, 0, 50]) + 10.0**scale * soup.positions * rng.permutation([1, 1, 10.0**flat])
    points, places = (device.upload(array) for array in (soup.points, positions.astype(np.float32)))
    visible = all_visible(device, np.ones(200, np.uint8))
    sizes = measure_sides(device, visible, points, places, np.zeros(3), 700.0)[0].get()[:200]
    levels = np.stack([levels_at(side, 0, 8) for side in (sizes & 0xFF, sizes >> 8)], axis=1)
    masks, words = random_masks(rng, soup), words_in_rows(levels.tolist())
    found = emit(device, soup, masks, words, complete)
    asked = soup.members[masks[:, None] >> np.arange(3) & 1 > 0]
    assert np.isin(asked, found["triangle"]).all()
    assert found["without"] == 0


def test_the_number_of_runs_changes_no_byte(device):
    rng = np.random.default_rng(7)
    levels = [ALL_LEVELS[k] for k in rng.integers(0, 60, 200)]
    soup = random_patches(rng, 200)
    masks, words = random_masks(rng, soup), words_in_rows(levels)
    expected = emit(device, soup, masks, words, runs=1)
    for runs in (3, 200, 999):
        found = emit(device, soup, masks, words, runs=runs)
        for name in FIELDS:
            assert found[name].tobytes() == expected[name].tobytes()


def test_no_patch_gives_no_sample(device):
    soup = random_patches(np.random.default_rng(0), 1)
    soup = replace(soup, members=soup.members[:0])
    assert len(emit(device, soup, np.empty(0, np.uint8), np.empty(0, np.uint32))["texel"]) == 0


def test_roles_cover_all_sizes():
    assert sorted(role for roles in ROLES.values() for role in roles) == [0, 0, 1, 2, 3, 4]
