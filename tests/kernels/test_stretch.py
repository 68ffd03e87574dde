"""Stretch against its twin and the per-triangle form of Sander et al. 2001, which holds where maps are affine."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shading_atlas_bench.kernels.metrics.stretch import stretch, stretch_twin


def measured(device, triangle, texels):
    return stretch(device, device.upload(triangle.astype(np.int32)), device.upload(texels.astype(np.float32)))


def sander(q, st_):
    """L2 and Linf of one triangle: q (3, 2) pixels as a function of st_ (3, 2) texels."""
    (s1, t1), (s2, t2), (s3, t3) = st_
    area = ((s2 - s1) * (t3 - t1) - (s3 - s1) * (t2 - t1)) / 2
    ss = (q[0] * (t2 - t3) + q[1] * (t3 - t1) + q[2] * (t1 - t2)) / (2 * area)
    sn = (q[0] * (s3 - s2) + q[1] * (s1 - s3) + q[2] * (s2 - s1)) / (2 * area)
    a, b, c = ss @ ss, ss @ sn, sn @ sn
    return np.sqrt((a + c) / 2), np.sqrt((a + c + np.sqrt((a - c) ** 2 + 4 * b * b)) / 2)


def affine_picture(height, width, triangles, seed):
    """Vertical bands of triangles with an affine map each; pixel-to-texel matrices as well."""
    rng = np.random.default_rng(seed)
    triangle = np.broadcast_to(np.arange(width) * triangles // width, (height, width)).copy()
    maps = rng.normal(0, 1, (triangles, 2, 2)) + 2 * np.eye(2)
    y, x = np.mgrid[0:height, 0:width] + 0.5
    texels = np.einsum("hwij,hwj->hwi", maps[triangle], np.stack([x, y], axis=-1))
    return triangle, texels, maps


@pytest.mark.parametrize("seed", range(3))
def test_affine_maps_give_the_published_per_triangle_stretch(device, seed):
    triangle, texels, maps = affine_picture(24, 100, 5, seed)
    corners = np.array([[0.0, 0.0], [9.0, 2.0], [3.0, 8.0]])
    per_triangle = np.array([sander(corners, corners @ m.T) for m in maps])
    area = np.bincount(triangle.ravel())
    l2, linf, degenerate = measured(device, triangle, texels)
    assert l2 == pytest.approx(np.sqrt((per_triangle[:, 0] ** 2 * area).sum() / area.sum()), rel=2e-3)
    assert linf == pytest.approx(per_triangle[:, 1].max(), rel=2e-3)
    assert degenerate == 0


def test_one_texel_per_pixel_is_one_and_half_is_two(device):
    y, x = np.mgrid[0:20, 0:33].astype(np.float64)
    one = np.stack([x, y], axis=-1)
    triangle = np.zeros((20, 33), np.int32)
    assert measured(device, triangle, one) == (1.0, 1.0, 0)
    l2, linf, _ = measured(device, triangle, one * [0.5, 1.0])
    assert linf == 2.0
    assert l2 == pytest.approx(np.sqrt((4 + 1) / 2))


@settings(max_examples=15, deadline=None)
@given(
    height=st.integers(1, 20),
    width=st.integers(1, 60),
    triangles=st.integers(1, 30),
    missing=st.sampled_from([0.0, 0.1, 0.9]),
    seed=st.integers(0, 100),
)
def test_matches_its_twin(device, height, width, triangles, missing, seed):
    rng = np.random.default_rng(seed)
    triangle = np.repeat(rng.integers(-1, triangles, (height, -(-width // 4))), 4, axis=1)[:, :width].astype(np.int32)
    texels = (rng.uniform(0, 4096, (height, width, 2))).astype(np.float32)
    texels[rng.random((height, width)) < missing] = np.nan
    got, expected = measured(device, triangle, texels), stretch_twin(triangle, texels)
    assert got[2] == expected[2]
    assert (got[0] is None) == (expected[0] is None)
    if expected[0] is not None:
        assert got[:2] == pytest.approx(expected[:2], rel=1e-3)


def test_collapsed_maps_are_counted_apart(device):
    y, x = np.mgrid[0:16, 0:32].astype(np.float64)
    texels = np.stack([x, y], axis=-1)
    texels[:, 16:, 1] = 5.0
    triangle = (x >= 16).astype(np.int32)
    assert measured(device, triangle, texels) == (1.0, 1.0, 16 * 16)


def test_nothing_visible_gives_no_number(device):
    triangle = np.full((8, 8), -1, np.int32)
    assert measured(device, triangle, np.full((8, 8, 2), np.nan)) == (None, None, 0)
    lonely = np.arange(64, dtype=np.int32).reshape(8, 8)
    assert measured(device, lonely, np.zeros((8, 8, 2))) == (None, None, 0)


def test_a_cut_within_a_triangle_is_no_stretch(device):
    y, x = np.mgrid[0:24, 0:70].astype(np.float64)
    whole = np.stack([0.5 * x, y], axis=-1)
    cut = whole + np.where((x > 35)[..., None], [500.0, -300.0], 0.0)
    triangle = np.zeros((24, 70), np.int32)
    expected = measured(device, triangle, whole)
    assert measured(device, triangle, cut)[:2] == pytest.approx(expected[:2], rel=1e-4)
