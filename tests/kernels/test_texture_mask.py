"""Alpha masks: the kernel against its twin, and what they promise about far foliage."""

from types import SimpleNamespace

import numpy as np
import pytest

from shading_atlas_bench.kernels.texture.inputs import leaves, masked_material, masked_soup
from shading_atlas_bench.kernels.texture.mask import AlphaMask, between, margin_twin, mask_defines


@pytest.fixture(name="masked_soup", params=[False, True], ids=["plain", "faded"])
def soup_of_masks(request, device):
    return masked_soup(device, request.param)


def test_the_alpha_test_matches_its_twin(device, masked_soup):
    """Both must agree unless alpha is within 0.1 of 255 of the threshold."""
    mask, material_ids = masked_soup
    rng = np.random.default_rng(6)
    triangles = rng.choice(np.flatnonzero(material_ids), 20_000).astype(np.int32)
    b1, b2 = rng.uniform(0, 0.5, (2, 20_000)).astype(np.float32)
    pixels = (10.0 ** rng.uniform(-8, 8, 20_000)).astype(np.float32)
    kept = device.empty(20_000, np.int32)
    inputs = (device.upload(array) for array in (triangles, b1, b2, pixels))
    kernel = device.build("texture/mask.cl", **mask_defines(mask)).alpha_test
    device.launch("test", kernel, 20_000, 20_000, *inputs, kept, *mask.arguments)
    margin = margin_twin(mask, triangles, b1, b2, pixels)
    clear = np.abs(margin) > 0.1
    assert clear.mean() > 0.95
    np.testing.assert_array_equal(kept.get()[clear] != 0, margin[clear] > 0)


def test_foliage_keeps_its_density_in_the_distance(device):
    texture = SimpleNamespace(texels=leaves(np.random.default_rng(1)), srgb=True, wrap_s="repeat", wrap_t="repeat")
    uvs = np.array([[0, 0], [1, 0], [0, 1]], np.float32)
    mask = AlphaMask.upload(device, np.array([[0, 1, 2]]), uvs, np.zeros(1, int), [masked_material()], [texture])
    assert mask
    near = np.mean(texture.texels[..., 3] > 127)
    levels, alphas = mask.host.levels, mask.host.alphas
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
        assert mask
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
    np.testing.assert_array_equal(part.slots.get(), part.host.slots)


def margins(device, alphas, texels, material, pixels):
    """Of the middle of a triangle whose corners have these alphas, at its areas on screen."""
    uvs, texture = np.array([[0, 0], [1, 0], [0, 1]], np.float32), []
    if texels is not None:
        texture = [SimpleNamespace(texels=texels, srgb=True, wrap_s="repeat", wrap_t="repeat")]
    known = (np.array([[0, 1, 2]]), uvs, np.zeros(1, int), [material], texture)
    mask = AlphaMask.upload(device, *known, vertex_alphas=np.array(alphas, np.float32))
    assert mask
    n = len(pixels)
    return mask, margin_twin(mask, np.zeros(n, int), np.full(n, 1 / 3), np.full(n, 1 / 3), np.array(pixels, np.float64))


@pytest.mark.parametrize(
    ("alphas", "base", "cutoff", "kept"),
    [
        ((0.2, 0.2, 0.2), 1.0, 0.5, False),
        ((0.2, 0.8, 0.8), 1.0, 0.5, True),
        ((0.5, 0.5, 0.5), 1.0, 0.5, True),
        ((0.9, 0.9, 0.9), 0.5, 0.5, False),
        ((0.9, 0.9, 0.9), 0.6, 0.5, True),
        ((0.0, 0.0, 0.0), 1.0, 0.0, True),
        ((1.0, 1.0, 1.0), 1.0, 1.0, True),
        ((1.0, 1.0, 0.99), 1.0, 1.0, False),
    ],
)
@pytest.mark.parametrize("textured", [False, True])
def test_the_alpha_of_vertices_counts_near_and_far(device, alphas, base, cutoff, kept, textured):
    """Base, texture (opaque here) and vertices multiply, at the finest level and at those behind it."""
    texels = np.full((64, 64, 4), 255, np.uint8) if textured else None
    material = masked_material(texture=0 if textured else -1, cutoff=cutoff, alpha=base)
    _, margin = margins(device, alphas, texels, material, [1e6, 100, 10])
    assert ((margin >= 0) == kept).all()


def test_foliage_keeps_its_density_in_the_distance_as_its_vertices_fade(device):
    """And where no alpha of the texture makes up for theirs, it is gone at every level."""
    texels = leaves(np.random.default_rng(1))
    b1, b2 = np.random.default_rng(2).uniform(0, 0.5, (2, 20_000))
    for alpha, gone in ((0.45, True), (0.52, False), (0.6, False), (0.9, False)):
        mask, _ = margins(device, (alpha,) * 3, texels, masked_material(), [10])
        near, *far = (
            np.mean(margin_twin(mask, np.zeros(20_000, int), b1, b2, np.full(20_000, pixels)) >= 0)
            for pixels in (1e5, 3e2, 3e1)
        )
        assert (near < 0.01) == gone
        assert far == pytest.approx([near, near], abs=0.06)


def test_vertices_that_are_all_there_cost_nothing(device):
    mask, _ = margins(device, (1.0,) * 3, None, masked_material(texture=-1), [10])
    assert mask.fades is None
    assert mask_defines(mask)["VERTEX_ALPHA"] == 0
    assert len(mask.arguments) == 5
