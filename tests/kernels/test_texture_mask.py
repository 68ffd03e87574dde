"""Alpha masks: the kernel against its twin, and what they promise about far foliage."""

from types import SimpleNamespace

import numpy as np
import pytest

from kernels.texture.mask import AlphaMask, between, margin_twin


def material(mode="mask", texture=0, cutoff=0.5, alpha=1.0):
    return SimpleNamespace(base_colour=(1, 1, 1, alpha), base_texture=texture, alpha_mode=mode, alpha_cutoff=cutoff)


def leaves(rng, size=(128, 96)):
    """Random opaque rectangles of up to 9 texels on about a third."""
    texels = np.zeros((*size, 4), np.uint8)
    for _ in range(size[0] * size[1] // 60):
        y, x, height, width = rng.integers(0, [*size, 9, 9])
        texels[y : y + height + 1, x : x + width + 1, 3] = 255
    return texels


@pytest.fixture
def masked_soup(device):
    rng = np.random.default_rng(5)
    textures = [
        SimpleNamespace(texels=leaves(rng, size), srgb=True, wrap_s=s, wrap_t=t)
        for size, s, t in [((128, 96), "repeat", "repeat"), ((33, 70), "clamp", "mirror"), ((1, 1), "mirror", "clamp")]
    ]
    materials = [material("opaque")] + [material(texture=i) for i in range(3)] + [material(texture=-1, alpha=0.7)]
    indices = np.arange(3 * 200).reshape(-1, 3).astype(np.int32)
    uvs = rng.uniform(-3, 3, (600, 2)).astype(np.float32)
    uvs[30:33], uvs[33:36] = np.nan, 1e9
    material_ids = rng.integers(0, 5, 200).astype(np.int32)
    material_ids[10:12] = 1
    return AlphaMask.upload(device, indices, uvs, material_ids, materials, textures), material_ids


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
    mask = AlphaMask.upload(device, np.array([[0, 1, 2]]), uvs, np.zeros(1, int), [material()], [texture])
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
            device, np.array([[0, 1, 2]]), uvs, np.zeros(1, int), [material(texture=-1, alpha=alpha)], []
        )
        margin = margin_twin(mask, np.zeros(1, int), np.array([0.3]), np.array([0.3]), np.array([10.0]))
        assert (margin[0] >= 0) == expected


def test_scenes_without_masks_have_none(device):
    none = AlphaMask.upload(device, np.zeros((1, 3), int), np.zeros((1, 2)), np.zeros(1, int), [material("opaque")], [])
    assert none is None


def test_masks_follow_their_triangles_into_another_list(device, masked_soup):
    mask, material_ids = masked_soup
    chosen = np.flatnonzero(material_ids)[::-3]
    part = mask.of_triangles(device, chosen)
    n = len(chosen)
    values = np.full(n, 0.25), np.full(n, 0.25), np.full(n, 1000.0)
    np.testing.assert_array_equal(margin_twin(part, np.arange(n), *values), margin_twin(mask, chosen, *values))
    np.testing.assert_array_equal(part.slots.get(), part.host["slots"])
