"""Filling of unowned texels: whole numbers, so the kernel equals its twin."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shading_atlas_bench.kernels.fill.fill import Filler, fill_twin
from shading_atlas_bench.kernels.inputs.atlases import random_atlas


@settings(max_examples=20, deadline=None)
@given(
    height=st.integers(1, 50),
    width=st.integers(1, 70),
    owned=st.sampled_from([0.0, 0.02, 0.5, 1.0]),
    seed=st.integers(0, 100),
)
def test_equals_its_twin_over_three_frames(device, height, width, owned, seed):
    rng = np.random.default_rng(seed)
    filler, before = Filler(device, width, height), None
    for _ in range(3):
        atlas = random_atlas(rng, height, width, owned)
        before = fill_twin(atlas, before)
        np.testing.assert_array_equal(filler.fill(device.upload(atlas)).get(), before)


def test_owned_texels_and_all_alpha_stay(device):
    atlas = random_atlas(np.random.default_rng(1), 100, 90, 0.4)
    filled = Filler(device, 90, 100).fill(device.upload(atlas)).get()
    owned = atlas[..., 3] > 0
    np.testing.assert_array_equal(filled[owned], atlas[owned])
    np.testing.assert_array_equal(filled[..., 3], atlas[..., 3])


def test_one_owned_texel_colours_the_whole_plane(device):
    atlas = np.zeros((33, 65, 4), np.uint8)
    atlas[20, 40] = 10, 200, 30, 255
    filled = Filler(device, 65, 33).fill(device.upload(atlas)).get()
    assert np.all(filled[..., :3] == [10, 200, 30])


@pytest.mark.parametrize("forget", [False, True])
def test_texels_that_stay_unowned_keep_their_colour(device, forget):
    rng = np.random.default_rng(2)
    first, second = (random_atlas(rng, 64, 64, 0.3) for _ in range(2))
    filler = Filler(device, 64, 64)
    before = filler.fill(device.upload(first)).get()
    if forget:
        filler.reset()
    after = filler.fill(device.upload(second)).get()
    fresh = Filler(device, 64, 64).fill(device.upload(second)).get()
    stayed = (first[..., 3] == 0) & (second[..., 3] == 0)
    np.testing.assert_array_equal(after[stayed], (fresh if forget else before)[stayed])
    np.testing.assert_array_equal(after[~stayed], fresh[~stayed])
