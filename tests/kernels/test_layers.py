"""Blended triangles in front of opaque ones: which fragments there are, what they show, and what contributes."""

import itertools

import numpy as np
import pytest

from shading_atlas_bench.kernels.fragments.blend import blend_layers, blend_twin, nearest_twin
from shading_atlas_bench.kernels.fragments.build import Builder
from shading_atlas_bench.kernels.fragments.layered import LayeredRasteriser, numbered
from shading_atlas_bench.kernels.fragments.layers import mark_layers_twin
from shading_atlas_bench.kernels.inputs.soups import look_at, perspective, random_soup, soup
from shading_atlas_bench.kernels.raster.camera import Camera
from shading_atlas_bench.kernels.raster.rasteriser import Rasteriser
from shading_atlas_bench.kernels.triangles import Triangles

SIZE = (99, 64)  # rows that do not end with a group of 8
VIEW = look_at((0, 1, 9), (0, 0, 0))
CAMERA = (VIEW, perspective(), *SIZE)


def half_blended(device, rng, count, share=0.5, duplicates=0):
    """Random triangles, some of them blended; the first `duplicates` are there twice, at equal depths."""
    triangles = random_soup(device, rng, count)
    indices = np.concatenate([triangles.host_indices, triangles.host_indices[:duplicates]])
    blended = rng.random(len(indices)) < share
    flags = np.where(blended, Triangles.BLENDED, 0) | Triangles.DOUBLE_SIDED
    return Triangles.upload(device, triangles.host_positions, indices, flags.astype(np.uint8)), blended


def fragments_of(fragments):
    """Offsets, triangles and depths."""
    n = fragments.count
    return fragments.offsets.get(), fragments.samples.triangle.get()[:n], fragments.depth.get()[:n]


@pytest.mark.parametrize(("seed", "share"), [(0, 0.5), (1, 0.02), (2, 1.0), (3, 0.0)])
def test_the_layers_are_the_fragments_before_the_first_opaque_one(device, seed, share):
    """Against the lists of all triangles, cut at the first opaque one; a third is there twice, at equal depths."""
    triangles, blended = half_blended(device, np.random.default_rng(seed), 300, share, 100)
    visible, fragments = LayeredRasteriser(device, triangles).draw(*CAMERA, "layers")
    builder = Builder(Rasteriser(device, triangles))
    members = device.upload(np.ones(triangles.count, np.uint8))
    everything = builder.build(*builder.bins(Camera.of(*CAMERA), "all"), members, 1, "all")
    offsets, triangle, depth = fragments_of(everything)
    opaque = np.full(SIZE[0] * SIZE[1], -1, np.int32)
    kept: list[int] = []
    counts: list[int] = []
    for pixel, (first, end) in enumerate(itertools.pairwise(offsets)):
        hidden = np.flatnonzero(~blended[triangle[first:end]])
        last = first + hidden[0] if len(hidden) else end
        opaque[pixel] = triangle[last] if len(hidden) else -1
        kept += range(first, last)
        counts.append(last - first)
    found = fragments_of(fragments)
    np.testing.assert_array_equal(visible.triangle.get().ravel(), opaque)
    np.testing.assert_array_equal(np.diff(found[0]), counts)
    np.testing.assert_array_equal(found[1], triangle[kept])
    np.testing.assert_array_equal(found[2], depth[kept])
    assert (fragments.count > 500) == (share > 0.1)


def drawn(device, seed=4):
    """Layers of random triangles with random opacities, a third of them 0 or 255."""
    rng = np.random.default_rng(seed)
    triangles, _ = half_blended(device, rng, 400, 0.7)
    visible, fragments = LayeredRasteriser(device, triangles).draw(*CAMERA, "layers")
    opacity = rng.choice([0, 1, 40, 128, 254, 255], fragments.count).astype(np.int32)
    return triangles, visible, fragments, opacity, rng


def test_blending_layers_equals_its_twin(device):
    """Within half a level and rounding; the nearest visible triangle exactly."""
    _, visible, fragments, opacity, rng = drawn(device)
    colours = rng.integers(0, 256, (fragments.count, 4), np.uint8)
    background = rng.integers(0, 256, (SIZE[0] * SIZE[1], 4), np.uint8)
    background[:, 3] = 255
    before = visible.triangle.get().ravel()
    picture, opacities, ids = (device.upload(a) for a in (background, opacity, np.arange(len(opacity), dtype=np.int32)))
    blend_layers(device, fragments, device.upload(colours), opacities, ids, picture, visible.triangle, "blend")
    offsets = fragments.offsets.get()
    rgba = np.concatenate([colours[:, :3], opacity[:, None].astype(np.uint8)], axis=1)
    expected = blend_twin(offsets, rgba, background)
    assert np.abs(picture.get().reshape(-1, 4) - expected).max() <= 0.51
    nearest = nearest_twin(offsets, opacity, np.arange(len(opacity)), before)
    np.testing.assert_array_equal(visible.triangle.get().ravel(), nearest)
    assert (nearest != before).mean() > 0.1


def test_what_contributes_equals_its_twin(device):
    triangles, visible, fragments, opacity, _ = drawn(device, 5)
    opacity[::3] = 250  # then little is left after two layers
    flags = device.zeros(triangles.count, np.uint8)
    lists = (fragments.pixels, fragments.offsets, fragments.samples.triangle, device.upload(opacity))
    kernel = device.build("fragments/layers.cl").mark_layers
    device.launch("mark", kernel, fragments.pixels, *lists, visible.triangle, flags)
    offsets, triangle, _ = fragments_of(fragments)
    before = np.zeros(triangles.count, np.uint8)
    expected = mark_layers_twin(offsets, triangle, opacity, visible.triangle.get().ravel(), before)
    np.testing.assert_array_equal(flags.get(), expected)
    assert 0 < expected.sum() < len(np.unique(triangle)) + len(np.unique(visible.triangle.get()))


def test_a_stack_of_panes_ends_where_nothing_is_left_to_see(device):
    """Panes of alpha 0.6, one behind the other before a wall: 0.4^k of the light is left behind k of them, which makes
    up 1/255 for the last time at k = 6, so six panes contribute (0.6 * 0.4^5 = 1.6/255) and the wall (1.04/255)."""
    for panes, wall in ((6, True), (7, False)):
        card = np.array([[-30, -30, 0], [30, -30, 0], [0, 60, 0]], np.float32)
        flags = np.array([*[Triangles.BLENDED] * panes, 0], np.uint8)
        scene = soup(device, [card - np.array([0, 0, k]) for k in range(panes + 1)], 0)
        scene = Triangles.upload(device, scene.host_positions, scene.host_indices, flags)
        visible, fragments = LayeredRasteriser(device, scene).draw(*CAMERA, "layers")
        opacity = np.full(fragments.count, 153, np.int32)
        _, triangle, _ = fragments_of(fragments)
        marked = device.zeros(panes + 1, np.uint8)
        lists = (fragments.pixels, fragments.offsets, fragments.samples.triangle, device.upload(opacity))
        kernel = device.build("fragments/layers.cl").mark_layers
        device.launch("mark", kernel, fragments.pixels, *lists, visible.triangle, marked)
        assert marked.get().tolist() == [1] * min(panes, 6) + [0] * (panes - 6) + [wall]
        assert len(np.unique(triangle)) == panes


def test_work_group_size_and_chunks_change_no_byte(device, monkeypatch):
    triangles, _ = half_blended(device, np.random.default_rng(6), 400, 0.5, 50)

    def drawn_bytes():
        visible, fragments = LayeredRasteriser(device, triangles).draw(*CAMERA, "layers")
        texel = numbered(device, fragments, "n").samples.texel.get()[: fragments.count]
        assert (texel == np.arange(fragments.count)).all()
        return [visible.triangle.get().tobytes(), *(part.tobytes() for part in fragments_of(fragments))]

    expected = drawn_bytes()
    for local_size, chunks in ((1, 3), (7, 64), (256, 1000)):
        monkeypatch.setattr(device, "local_size", local_size)
        monkeypatch.setattr(device, "chunks", chunks)
        assert drawn_bytes() == expected
