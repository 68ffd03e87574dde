"""Fill and coherence against counting by hand."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shading_atlas_bench.harness.measure.coherence import AtlasHistory, AtlasUse


def atlas(owners: list[int], colour: int = 0) -> tuple[np.ndarray, np.ndarray]:
    owner = np.array(owners, np.int32).reshape(2, -1)
    plane = np.full((*owner.shape, 4), colour, np.uint8)
    plane[..., 3] = np.where(owner >= 0, 255, 0)
    return owner, plane


def test_the_first_frame_has_nothing_to_compare_with():
    assert AtlasHistory().update(*atlas([5, -1, 5, 6])) == AtlasUse(0.75, None, None)


def test_only_texels_owned_now_count():
    history = AtlasHistory()
    history.update(*atlas([5, 6, 7, -1]))
    assert history.update(*atlas([5, -1, 8, -1])).coherence == 0.5
    assert history.update(*atlas([5, 6, 8, -1])).coherence == pytest.approx(2 / 3)


def test_alpha_is_no_colour():
    history = AtlasHistory()
    history.update(*atlas([5, 6, 7, -1], colour=10))
    owner, plane = atlas([-1, -1, -1, -1], colour=10)
    plane[0, 0, 1] = 11
    assert history.update(owner, plane) == AtlasUse(0.0, None, 11 / 12)


def test_an_atlas_of_another_size_is_a_first_one():
    history = AtlasHistory()
    history.update(*atlas([5, 6, 7, 8]))
    assert history.update(*atlas([5, 6, 7, 8, 9, 10])) == AtlasUse(1.0, None, None)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**31), channels=st.sampled_from([3, 4]))
def test_same_as_counting_one_by_one(seed: int, channels: int):
    rng = np.random.default_rng(seed)
    owners = rng.integers(-1, 3, (2, 5, 7)).astype(np.int32)
    planes = rng.integers(0, 3, (2, 5, 7, channels)).astype(np.uint8)
    history = AtlasHistory()
    history.update(owners[0], planes[0])
    use = history.update(owners[1], planes[1])
    now = [texel for texel in np.ndindex(5, 7) if owners[1][texel] >= 0]
    assert use.fill == len(now) / 35
    assert use.coherence == sum(owners[0][t] == owners[1][t] for t in now) / len(now)
    assert use.coherence_bytes == sum(planes[0][i] == planes[1][i] for i in np.ndindex(5, 7, 3)) / 105
