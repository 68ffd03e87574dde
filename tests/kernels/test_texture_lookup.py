"""Mip chains, and texture lookups through the shading kernel's tables."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shading_atlas_bench.kernels.runtime.opencl import DeviceError
from shading_atlas_bench.kernels.texture.buffers import TextureBuffers
from shading_atlas_bench.kernels.texture.mipmap import fill_hidden, linear_texels, mip_chain, srgb_to_linear
from shading_atlas_bench.kernels.texture.sample import trilinear


def image(texels, srgb=True, wrap_s="repeat", wrap_t="repeat"):
    return SimpleNamespace(texels=texels, srgb=srgb, wrap_s=wrap_s, wrap_t=wrap_t)


@settings(max_examples=25, deadline=None)
@given(width=st.integers(1, 70), height=st.integers(1, 70), seed=st.integers(0, 99))
def test_every_mip_level_keeps_the_mean(width, height, seed):
    level: Any = np.random.default_rng(seed).random((height, width, 4))  # float64, for so narrow a bound
    chain = list(mip_chain(level))
    assert chain[-1].shape == (1, 1, 4)
    assert len(chain) == max(width, height).bit_length()
    for smaller in chain:
        np.testing.assert_allclose(smaller.mean(axis=(0, 1)), level.mean(axis=(0, 1)), atol=1e-12)


def test_averages_are_taken_in_linear_light(device):
    texels = np.full((1, 2, 4), 255, np.uint8)
    texels[0, 0, :3] = 0
    buffers = TextureBuffers.upload(device, [image(texels)])
    smallest = buffers.host_texels[buffers.host_levels[-1, 0]] / 65535
    np.testing.assert_allclose(smallest[:3], 0.5, atol=1e-4)
    assert srgb_to_linear(np.array(188 / 255)) == pytest.approx(0.5, abs=5e-3)


def test_alpha_is_never_decoded_as_srgb():
    texels = np.full((1, 1, 4), 128, np.uint8)
    np.testing.assert_allclose(linear_texels(texels, srgb=True)[0, 0], [0.2158605] * 3 + [128 / 255], atol=1e-6)


def test_colours_under_holes_do_not_bleed_into_masked_textures(device):
    texels = np.zeros((8, 8, 4), np.uint8)
    texels[..., 0] = 255  # red where nothing is to be seen
    texels[:4, :, :] = (0, 255, 0, 255)
    buffers = TextureBuffers.upload(device, [image(texels)], {0: 0.5})
    red, green, _, alpha = buffers.host_texels[buffers.host_levels[-1, 0]] / 65535
    assert red < 0.01
    assert green > 0.99
    assert alpha == pytest.approx(0.5, abs=1e-4)


@pytest.mark.parametrize("size", [(8, 8), (7, 13), (1, 5)])
def test_holes_have_the_colour_of_what_is_seen_around_them(size):
    """Everything seen is green or blue, everything else red: nothing red is left, and what is seen stays as it is."""
    rng = np.random.default_rng(size[0])
    seen = rng.random(size) < 0.3
    seen[0, 0] = True
    colours = np.where(rng.random(size)[..., None] < 0.5, [0, 1, 0], [0, 0, 1])
    filled = fill_hidden(np.where(seen[..., None], colours, [1, 0, 0]).astype(np.float32), seen)
    np.testing.assert_array_equal(filled[seen], colours[seen])
    np.testing.assert_allclose(filled.sum(axis=-1), 1, atol=1e-6)
    assert not filled[..., 0].any()


def test_nothing_is_filled_where_nothing_or_all_is_seen():
    level = np.random.default_rng(0).random((4, 6, 3), np.float32)
    for seen in (np.zeros((4, 6), bool), np.ones((4, 6), bool)):
        np.testing.assert_array_equal(fill_hidden(level, seen), level)


@pytest.mark.parametrize(
    ("wrap", "u", "texel"),
    [("repeat", 1.125, 0), ("repeat", -0.125, 3), ("clamp", 1.4, 3), ("clamp", -3.0, 0), ("mirror", 1.125, 3)],
)
def test_wrap_modes(device, wrap, u, texel):
    texels = np.zeros((1, 4, 4), np.uint8)
    texels[0, :, 0] = (0, 60, 120, 180)
    buffers = TextureBuffers.upload(device, [image(texels, srgb=False, wrap_s=wrap)])
    found = trilinear(buffers, np.array([1]), np.array([u]), np.array([0.5]), np.array([0.0]))
    assert found[0, 0] * 255 == pytest.approx(60 * texel, abs=0.01)


def test_row_0_is_at_v_0(device):
    texels = np.zeros((2, 1, 4), np.uint8)
    texels[1] = 255
    buffers = TextureBuffers.upload(device, [image(texels)])
    found = trilinear(buffers, np.array([1, 1]), np.array([0.5, 0.5]), np.array([0.25, 0.75]), np.zeros(2))
    np.testing.assert_allclose(found[:, 0], [0, 1], atol=1e-6)


def test_the_level_follows_the_footprint(device):
    texels = np.zeros((64, 64, 4), np.uint8)
    texels[::2, ::2] = texels[1::2, 1::2] = 255
    buffers = TextureBuffers.upload(device, [image(texels)])
    at = np.full(3, 0.5 / 64)
    found = trilinear(buffers, np.ones(3, int), at, at, np.array([0.0, 2 / 64, 1e30]))[:, 0]
    np.testing.assert_allclose(found, [1, 0.5, 0.5], atol=1e-4)


@pytest.mark.parametrize(
    ("room", "words"),
    [
        (8 * 3000, "--max-texture 32 reduces them"),
        (8 * 2, "the scene has too many"),
    ],
)
def test_textures_that_a_device_does_not_take_are_refused_with_the_size_that_it_does(room, words):
    """Before anything is made of them."""
    small: Any = SimpleNamespace(name="small", device=SimpleNamespace(max_mem_alloc_size=room))
    textures = [image(np.zeros((height, width, 4), np.uint8)) for height, width in ((64, 64), (64, 16), (20, 20))]
    with pytest.raises(DeviceError, match=f"more than small gives: {words}"):
        TextureBuffers.upload(small, textures)
