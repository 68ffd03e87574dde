"""The kernels of per-pixel linked lists against their twins, on ordinary and on adversarial input."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from shading_atlas_bench.kernels.fragments.blend import blend_lists, blend_twin
from shading_atlas_bench.kernels.fragments.build import Builder, build_twin
from shading_atlas_bench.kernels.fragments.inputs import glass_opacity
from shading_atlas_bench.kernels.fragments.opacity import VARIES, constant_opacities, opacity_twin
from shading_atlas_bench.kernels.inputs.soups import look_at, perspective, random_soup, soup
from shading_atlas_bench.kernels.raster.camera import Camera
from shading_atlas_bench.kernels.raster.rasteriser import Rasteriser, ScreenTriangles
from shading_atlas_bench.kernels.triangles import Triangles
from shading_atlas_bench.packers.interface import View
from shading_atlas_bench.packers.ppll.kernels.inputs import random_lists
from shading_atlas_bench.packers.ppll.kernels.limit import EVERY_LAYER, Depth, limit_fragments, limit_twin
from shading_atlas_bench.packers.ppll.kernels.lists import (
    Lists,
    ListView,
    changed_lists,
    changed_twin,
    cut_lists,
    cut_twin,
    splice_lists,
    splice_twin,
)
from shading_atlas_bench.packers.ppll.kernels.rows import normal_rows, normals_twin, rows_twin
from shading_atlas_bench.packers.ppll.kernels.splat import draw_lists, draw_lists_twin

SIZE = (96, 64)
VIEW = look_at((0, 1, 9), (0, 0, 0))


def build(device, triangles, camera, members=None, member=1):
    """The fragments of all triangles, or of those of a member."""
    builder = Builder(Rasteriser(device, triangles))
    members = np.ones(triangles.count, np.uint8) if members is None else members
    return builder.build(*builder.bins(camera, "build"), device.upload(members), member, "build")


def host(fragments):
    """Offsets, triangle, depth and pixel."""
    n = fragments.count
    samples = fragments.samples
    return fragments.offsets.get(), samples.triangle.get()[:n], fragments.depth.get()[:n], samples.texel.get()[:n]


def assert_sorted(offsets, triangle, depth, pixel):
    assert (pixel == np.repeat(np.arange(len(offsets) - 1), np.diff(offsets))).all()
    same = pixel[1:] == pixel[:-1]
    ordered = (depth[1:] < depth[:-1]) | ((depth[1:] == depth[:-1]) & (triangle[1:] > triangle[:-1]))
    assert (ordered | ~same).all()


@pytest.mark.parametrize("seed", range(3))
def test_every_fragment_is_there_once_and_sorted(device, seed):
    """Against the unsnapped twin: only fragments within 1/256 pixel of an edge, or edge-on in depth, may differ."""
    rng = np.random.default_rng(seed)
    triangles, camera = random_soup(device, rng, 200), Camera.of(VIEW, perspective(), *SIZE)
    offsets, triangle, depth, pixel = host(build(device, triangles, camera))
    assert_sorted(offsets, triangle, depth, pixel)
    expected_offsets, expected_triangle, expected_depth = build_twin(triangles, camera, np.ones(200), 1)
    expected_pixel = np.repeat(np.arange(SIZE[0] * SIZE[1]), np.diff(expected_offsets))
    found = dict(zip(zip(pixel.tolist(), triangle.tolist(), strict=True), depth.tolist(), strict=True))
    wanted = dict(
        zip(zip(expected_pixel.tolist(), expected_triangle.tolist(), strict=True), expected_depth, strict=True)
    )
    assert len(found) == len(pixel) > 1000
    screen = ScreenTriangles.of(triangles, camera)
    for place, number in found.keys() ^ wanted.keys():
        centre = np.array([place % SIZE[0] + 0.5, place // SIZE[0] + 0.5, 1])
        edges = screen.edges[number]
        margins = edges @ centre / np.maximum(np.hypot(edges[:, 0], edges[:, 1]), 1e-300)
        assert margins.min() > -2 / 256
        assert abs(margins).min() < 2 / 256 or screen.depth[number] @ centre > 0.999
    both = [key for key in found if key in wanted]
    slopes = np.hypot(*screen.depth[[number for _, number in both], :2].T)
    errors = np.abs([found[key] - wanted[key] for key in both])
    assert (errors <= slopes * 2 / 256 + 3e-6).all()


@pytest.mark.parametrize("size", [SIZE, (101, 71), (3, 130)])
def test_the_nearest_fragments_are_what_the_rasteriser_shows(device, size):
    triangles = random_soup(device, np.random.default_rng(5), 2000)
    visible = Rasteriser(device, triangles).draw(VIEW, perspective(), *size)
    found = host(build(device, triangles, Camera.of(VIEW, perspective(), *size)))
    assert_sorted(*found)
    offsets, triangle, depth, _ = found
    used = np.diff(offsets) > 0
    nearest, depths = np.full(used.shape, -1), np.zeros(used.shape, np.float32)
    nearest[used], depths[used] = triangle[offsets[:-1][used]], depth[offsets[:-1][used]]
    np.testing.assert_array_equal(nearest, visible.triangle.get().ravel())
    np.testing.assert_array_equal(depths, visible.depth.get().ravel())


def test_members_share_the_fragments(device):
    triangles, camera = (
        random_soup(device, np.random.default_rng(6), 300),
        Camera.of(VIEW, perspective(), *SIZE),
    )
    members = np.random.default_rng(7).integers(0, 3, 300).astype(np.uint8)
    everything = host(build(device, triangles, camera))
    parts = [host(build(device, triangles, camera, members, member)) for member in range(3)]
    assert sum(len(part[1]) for part in parts) == len(everything[1])
    for member, part in enumerate(parts):
        assert (members[part[1]] == member).all()
        assert_sorted(*part)


def test_hundreds_of_layers_equal_depths_and_slivers(device):
    """Coplanar duplicates are ordered by triangle, long lists are sorted, triangles through the eye are clipped."""
    card = np.array([[-5, -5, 0], [5, -5, 0], [0, 9, 0]], np.float32)
    stack = [card - np.array([0, 0, 0.01 * (k * 37 % 400 // 2)]) for k in range(400)]
    odd = [card + np.array([0, 0, 9]), np.array([[0, 0, 9.5], [4, 0, -9], [4.001, 0, -9]])]
    triangles = soup(device, [*stack, *odd], Triangles.DOUBLE_SIDED)
    found = host(build(device, triangles, Camera.of(VIEW, perspective(), *SIZE)))
    assert_sorted(*found)
    assert np.diff(found[0]).max() >= 400


def test_the_pool_of_pages_changes_no_byte(device):
    """Drawn again with more pages, and once with enough, the lists are the same; so are they with pages left over."""
    triangles, camera = random_soup(device, np.random.default_rng(13), 3000), Camera.of(VIEW, perspective(), *SIZE)
    builder, members = Builder(Rasteriser(device, triangles)), device.upload(np.ones(3000, np.uint8))
    found = []
    for _ in range(2):
        with device.record() as record:
            found.append(host(builder.build(*builder.bins(camera, "build"), members, 1, "build")))
        found[-1] = [part.tobytes() for part in found[-1]], record.launches["build/draw"]
    (first, drawn), (second, drawn_again) = found
    assert drawn > drawn_again
    assert first == second == [part.tobytes() for part in host(build(device, triangles, camera))]


@pytest.mark.parametrize("corners", [np.zeros((0, 3, 3)), np.full((1, 3, 3), 40.0)])
def test_nothing_to_see(device, corners):
    fragments = build(device, soup(device, corners), Camera.of(VIEW, perspective(), *SIZE))
    assert fragments.count == 0
    assert not fragments.offsets.get().any()


def test_work_group_size_and_chunks_change_no_byte(device, monkeypatch):
    triangles, camera = (
        random_soup(device, np.random.default_rng(8), 500),
        Camera.of(VIEW, perspective(), *SIZE),
    )
    expected = [part.tobytes() for part in host(build(device, triangles, camera))]
    for local_size, chunks in ((1, 3), (7, 64), (256, 1000)):
        monkeypatch.setattr(device, "local_size", local_size)
        monkeypatch.setattr(device, "chunks", chunks)
        assert [part.tobytes() for part in host(build(device, triangles, camera))] == expected


@pytest.mark.parametrize(("layers", "threshold"), [(1, 2.0), (3, 2.0), (EVERY_LAYER, 0.9), (2, 0.5), (100, 2.0)])
def test_limits_keep_what_the_twin_keeps(device, layers, threshold):
    rng = np.random.default_rng(9)
    fragments = build(device, random_soup(device, rng, 400), Camera.of(VIEW, perspective(), *SIZE))
    opacity = rng.choice([0, 1, 100, 128, 255], fragments.count).astype(np.int32)
    spans = np.sort(rng.integers(0, SIZE[0] + 1, (SIZE[1], 2)).astype(np.int32), axis=1)
    spans[::2] = 0, SIZE[0]
    depth = Depth(layers, threshold)
    kept, left = limit_fragments(device, fragments, device.upload(opacity), depth, spans, "limit")
    before, after = host(fragments), host(kept)
    expected = limit_twin(before[0], opacity, depth, spans, SIZE[0])
    for a, b in zip(before[1:], after[1:], strict=True):
        np.testing.assert_array_equal(a[expected], b)
    assert left is not None
    np.testing.assert_array_equal(left.get()[: kept.count], opacity[expected])
    assert np.diff(after[0]).max() <= layers
    assert_sorted(*after)


@pytest.mark.parametrize(("threshold", "kept"), [(0.1995, 1), (0.2005, 2), (0.3595, 2), (0.3605, 3)])
def test_a_threshold_is_reached_by_what_opacities_of_255_cover_together(threshold, kept):
    """51 of 255 are 0.2, and twice 0.2 covers 1 - 0.8 * 0.8."""
    opacity, spans = np.array([51, 51, 255]), np.array([[0, 1]])
    assert limit_twin(np.array([0, 3]), opacity, Depth(threshold=threshold), spans, 1).tolist() == [0, 1, 2][:kept]


def test_a_depth_limits_by_layers_or_by_a_threshold_that_can_be_reached():
    assert [depth.limits for depth in (Depth(), Depth(3), Depth(threshold=1.0), Depth(threshold=1.5))] == [
        False,
        True,
        True,
        False,
    ]


def test_opaque_fragments_are_limited_to_the_nearest(device):
    fragments = build(
        device, random_soup(device, np.random.default_rng(10), 400), Camera.of(VIEW, perspective(), *SIZE)
    )
    spans = np.tile(np.array([0, SIZE[0]], np.int32), (SIZE[1], 1))
    kept, opacity = limit_fragments(device, fragments, None, Depth(threshold=1.0), spans, "limit")
    assert opacity is None
    np.testing.assert_array_equal(np.diff(kept.offsets.get()), np.diff(fragments.offsets.get()) > 0)
    every, _ = limit_fragments(device, fragments, None, Depth(), spans, "limit")
    assert every.count == fragments.count


def test_blending_equals_the_over_operator(device):
    """Within half a level: one 255th after rounding."""
    rng = np.random.default_rng(11)
    lists = random_lists(device, rng, most=12)
    background = rng.integers(0, 256, (lists.pixels, 4)).astype(np.uint8)
    picture = device.empty((lists.pixels, 4), np.uint8)
    inputs = (lists.pixels, lists.offsets, lists.rows, lists.words, device.upload(background), picture)
    blend_lists(device, *inputs, "blend")
    offsets, rows = lists.host()
    expected = blend_twin(offsets, rows[:, :1].copy().view(np.uint8), background)
    assert np.abs(picture.get() - expected).max() <= 0.501


def test_cutting_splicing_and_finding_changes_equal_their_twins(device):
    rng = np.random.default_rng(12)
    held, fresh = random_lists(device, rng), random_lists(device, rng)
    counts = np.append(rng.integers(0, 5, held.pixels), 0).astype(np.int32)
    cut = cut_lists(device, fresh, device.upload(counts), "cut")
    for found, expected in (
        (cut.host(), cut_twin(fresh.host(), counts[:-1])),
        (splice_lists(device, held, cut, "splice").host(), splice_twin(held.host(), cut.host())),
    ):
        np.testing.assert_array_equal(found[0], expected[0])
        np.testing.assert_array_equal(found[1], expected[1])


@pytest.mark.parametrize("tolerance", [0, 3])
def test_changed_lists_are_those_of_the_twin_and_make_the_other_end_equal(device, tolerance):
    rng = np.random.default_rng(13)
    held = random_lists(device, rng)
    offsets, rows = held.host()
    some = rng.random(len(rows)) < 0.1
    rows[some, 0] ^= rng.choice([1, 2, 4, 1 << 20], some.sum()).astype(np.uint32)
    moved = rng.random(len(rows)) < 0.1
    rows[moved, 1] += rng.choice([1, 1 << 14, 1 << 16], moved.sum()).astype(np.uint32)
    fresh = Lists.upload(device, held.width, held.height, offsets, rows)
    changed = changed_lists(device, fresh, held, tolerance, 1e-4, "difference")
    expected = changed_twin(fresh.host(), held.host(), tolerance, 1e-4)
    np.testing.assert_array_equal(np.diff(changed.host()[0]) > 0, expected)
    assert 0.05 < expected.mean() < 0.6
    exact = splice_lists(device, held, changed_lists(device, fresh, held, 0, 0.0, "difference"), "hold")
    np.testing.assert_array_equal(exact.host()[1], fresh.host()[1])


def test_a_fragment_has_moved_by_a_share_of_its_new_depth(device):
    """From 1.6 to 1.0 by 0.6 of it, and from 1.0 to 1.6 by 0.375 of it."""
    held, fresh = (
        Lists.upload(device, 2, 1, np.arange(3), np.array([[-1, -1], depths], np.float32).T.copy().view(np.uint32))
        for depths in ((1.6, 1.0), (1.0, 1.6))
    )
    for share, changed in ((0.37, [True, True]), (0.38, [True, False]), (0.59, [True, False]), (0.61, [False, False])):
        assert changed_twin(fresh.host(), held.host(), 0, share).tolist() == changed
        found = changed_lists(device, fresh, held, 0, share, "difference")
        assert (np.diff(found.host()[0]) > 0).tolist() == changed


def test_opacity_equals_its_twin(device):
    """Within one level; texels of a level next to it where the footprint lies between two levels."""
    rng = np.random.default_rng(14)
    triangles = random_soup(device, rng, 300)
    opacity, ids = glass_opacity(device, rng, triangles)
    fragments = build(device, triangles, Camera.of(VIEW, perspective(), *SIZE))
    samples, n = fragments.samples, fragments.count
    found = opacity.of(samples, "opacity").get()[:n]
    triangle = samples.triangle.get()[:n]
    bary = np.stack([samples.bary1.get()[:n], samples.bary2.get()[:n]], axis=1).astype(np.float64)
    expected = opacity_twin(opacity, triangle, bary, samples.footprint.get()[:n].astype(np.float64))
    off = np.abs(found - expected) > 1
    assert off.mean() < 0.002
    assert (found[np.isin(ids[triangle], (0, 4))] == 255).all()
    assert len(np.unique(found)) > 50
    plane = device.zeros((1, len(samples.texel), 4), np.uint8)
    opacity.write(replace(samples, texel=device.upload(np.arange(n, dtype=np.int32))), plane, "opacity")
    np.testing.assert_array_equal(plane.get()[0, :n], np.stack([found, found, found, 0 * found + 255], axis=1))


def test_opacities_that_are_the_same_everywhere_are_known_without_a_plane():
    from shading_atlas_bench.scenes.model import Material, Texture

    even, uneven = np.full((4, 4, 4), 51, np.uint8), np.arange(64, dtype=np.uint8).reshape(4, 4, 4)
    scene = SimpleNamespace()
    scene.textures = [Texture("even", even), Texture("uneven", uneven)]
    blend: dict[str, Any] = {"base_colour": (1, 1, 1, 0.5), "alpha_mode": "blend"}
    scene.materials = [
        Material(base_colour=(1, 1, 1, 0.5)),
        Material(**blend),
        Material(**blend, base_texture=0),
        Material(**blend, base_texture=1),
        Material(base_texture=1, transmission=1.0),
        Material(**blend, transmission=0.5),
        Material(**blend),
        Material(**blend, base_texture=1),  # which no triangle has
    ]
    scene.material_ids, scene.indices = np.arange(7), np.arange(21).reshape(7, 3)
    scene.colours = np.ones((21, 4), np.float32)
    scene.colours[18:, 3] = (0.5, 0.6, 0.7)
    exact = [255, 127.5, 25.5, VARIES, 25.5, 70.125, VARIES, 255]
    np.testing.assert_allclose(constant_opacities(scene), exact, atol=0.51)


def test_rows_hold_normals_and_positions(device):
    """Normals within 0.002 (half floats of angles up to pi), positions within 1e-5 of their distance."""
    rng = np.random.default_rng(15)
    triangles = random_soup(device, rng, 300)
    projection = perspective(80, 1.5, (0.1, -0.2))
    fragments = build(device, triangles, Camera.of(VIEW, projection, *SIZE))
    n = fragments.count
    normals = rng.normal(size=triangles.host_positions.shape)
    normals[::7] = [0, 0, 1]
    normals[1::7] = [0, 0, -1]
    vertices = np.zeros((len(normals), 8), np.float32)
    vertices[:, 3:6] = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    colours = device.upload(rng.integers(0, 256, (1, n, 4)).astype(np.uint8))
    rows = normal_rows(device, fragments, colours, None, triangles, device.upload(vertices), projection, "rows").get()
    expected = rows_twin(fragments.samples, fragments.depth.get()[:n], triangles, vertices[:, 3:6], projection, *SIZE)
    np.testing.assert_array_equal(rows[:, 0], colours.get().view(np.uint32).ravel())
    assert np.abs(normals_twin(rows[:, 1].copy()) - expected[0]).max() < 0.002
    positions = rows[:, 2:].copy().view(np.float32)
    assert (np.abs(positions - expected[1]) <= 1e-5 * expected[1][:, 2:]).all()


def views(shift, taken=(24, 16), seen=(20, 14)):
    """A list view and another one, whose eye is moved and turned; of these sizes."""
    turn = look_at((shift, 0.3 * shift, 0), (0.5 * shift, 0, -5)) if shift else np.eye(4)
    return View(np.eye(4), perspective(80, 24 / 16), *taken), View(turn, perspective(60, 20 / 14), *seen)


def test_reprojection_equals_its_twin(device):
    """Within one level, but for pixels where a point's square ends within rounding of the pixel's centre."""
    rng = np.random.default_rng(16)
    parts, others = ([random_lists(device, rng, most=4) for _ in range(count)] for count in (2, 1))
    taken, view = views(0.05)
    beside = replace(taken, view=look_at((0, 0, 0), (2, 1, -3)))
    background = rng.integers(0, 256, (14, 20, 4)).astype(np.uint8)
    picture, depth = device.upload(background), device.empty((14, 20), np.float32)
    held = [ListView(taken, parts), ListView(beside, others)]
    draw_lists(device, held, view, picture, depth, "draw")
    expected, distances = draw_lists_twin(held, view, background)
    error = np.abs(picture.get()[..., :3] - expected).max(axis=-1)
    assert (error > 1).mean() < 0.01
    assert (np.abs(depth.get() - distances) > 1e-6 * distances).mean() < 0.01
    assert (depth.get() > 0).mean() > 0.8


def test_where_nothing_moved_reprojection_is_the_blend(device):
    rng = np.random.default_rng(17)
    lists = random_lists(device, rng, most=8)
    taken, _ = views(0)
    background = rng.integers(0, 256, (lists.height, lists.width, 4)).astype(np.uint8)
    background[..., 3] = 255
    expected, picture = device.upload(background), device.upload(background)
    inputs = (lists.pixels, lists.offsets, lists.rows, lists.words, expected, expected)
    blend_lists(device, *inputs, "blend")
    depth = device.empty((lists.height, lists.width), np.float32)
    draw_lists(device, [ListView(taken, [lists])], taken, picture, depth, "draw")
    assert np.abs(picture.get().astype(int) - expected.get()).max() <= 1
    np.testing.assert_array_equal(depth.get().ravel() > 0, np.diff(lists.host()[0]) > 0)


def test_reprojection_is_the_same_for_every_work_group_size(device, monkeypatch):
    lists = random_lists(device, np.random.default_rng(18), 60, 40, most=9)
    taken, view = views(0.2, (60, 40), (100, 70))
    pictures = []
    for local_size in (64, 1, 7, 256):
        monkeypatch.setattr(device, "local_size", local_size)
        picture, depth = device.zeros((70, 100, 4), np.uint8), device.empty((70, 100), np.float32)
        draw_lists(device, [ListView(taken, [lists, replace(lists)])], view, picture, depth, "draw")
        pictures.append(picture.get().tobytes() + depth.get().tobytes())
    assert len(set(pictures)) == 1
