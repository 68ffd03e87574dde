"""Alpha masks: the kernel against its twin, and what they promise about far foliage."""

from types import SimpleNamespace

import numpy as np
import pytest

from kernels.inputs.masks import leaves, masked_material, masked_soup
from kernels.texture.mask import AlphaMask, between, margin_twin


@pytest.fixture(name="masked_soup")
def soup_of_masks(device):
    return masked_soup(device)


def test_the_alpha_test_matches_its_twin(device, masked_soup):
    """Both must agree unless alpha is within 0.1 of 255 of the threshold."""
    mask, material_ids = masked_soup
    rng = np.random.default_rng(6)
    triangles = rng.choice(np.flatnonzero(material_ids), 20_000).astype(np.int32)
    b1, b2 = rng.uniform(0, 0.5, (2, 20_000)).astype(np.float32)
    pixels = (10.0 ** rng.uniform(-8, 8, 20_000)).astype(np.float32)
    kept = device.empty(20_000, np.int32)
    inputs = (device.upload(array) for array in (triangles, b1, b2, pixels))
    device.launch("test", device.build("texture/mask.cl").alpha_test, 20_000, 20_000, *inputs, kept, *mask.arguments)
    margin = margin_twin(mask, triangles, b1, b2, pixels)
    clear = np.abs(margin) > 0.1
    assert clear.mean() > 0.95
    np.testing.assert_array_equal(kept.get()[clear] != 0, margin[clear] > 0)


def test_foliage_keeps_its_density_in_the_distance(device):
    texture = SimpleNamespace(texels=leaves(np.random.default_rng(1)), srgb=True, wrap_s="repeat", wrap_t="repeat")
    uvs = np.array([[0, 0], [1, 0], [0, 1]], np.float32)
    mask = AlphaMask.upload(device, np.array([[0, 1, 2]]), uvs, np.zeros(1, int), [masked_material()], [texture])
    near = np.mean(texture.texels[..., 3] > 127)
    levels, alphas = mask.host["levels"], mask.host["alphas"]
    assert len(levels) > 3
    for offset, width, height, bits in levels[:, :4]:
        level = alphas[offset : offset + width * height].reshape(height, width)
        passing = np.mean(between(level) >= np.int32(bits).view(np.float32))
        assert passing == pytest.approx(near, abs=0.02)


def test_masks_without_texture_are_all_there_or_not_at_all(device):
    uvs = np.zeros((3, 2), np.float32)
    for alpha, expected in [(0.7, True), (0.3, False), (0.0, False)]:
        mask = AlphaMask.upload(
            device, np.array([[0, 1, 2]]), uvs, np.zeros(1, int), [masked_material(texture=-1, alpha=alpha)], []
        )
        margin = margin_twin(mask, np.zeros(1, int), np.array([0.3]), np.array([0.3]), np.array([10.0]))
        assert (margin[0] >= 0) == expected


def test_scenes_without_masks_have_none(device):
    none = AlphaMask.upload(
        device, np.zeros((1, 3), int), np.zeros((1, 2)), np.zeros(1, int), [masked_material("opaque")], []
    )
    assert none is None


def test_masks_follow_their_triangles_into_another_list(device, masked_soup):
    mask, material_ids = masked_soup
    chosen = np.flatnonzero(material_ids)[::-3]
    part = mask.of_triangles(device, chosen)
    n = len(chosen)
    values = np.full(n, 0.25), np.full(n, 0.25), np.full(n, 1000.0)
    np.testing.assert_array_equal(margin_twin(part, np.arange(n), *values), margin_twin(mask, chosen, *values))
    np.testing.assert_array_equal(part.slots.get(), part.host["slots"])
