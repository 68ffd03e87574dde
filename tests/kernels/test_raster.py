"""The rasteriser against its unsnapped float64 twin, and on the input that breaks rasterisers."""

from dataclasses import replace

import numpy as np
import pytest

from shading_atlas_bench.kernels.inputs.soups import (
    look_at,
    orthographic,
    perspective,
    pixel_points,
    random_soup,
    soup,
)
from shading_atlas_bench.kernels.raster.camera import Camera
from shading_atlas_bench.kernels.raster.clusters import boxes_twin, in_frustum_twin
from shading_atlas_bench.kernels.raster.rasteriser import Rasteriser, ScreenTriangles, draw_twin
from shading_atlas_bench.kernels.triangles import Triangles
from tests.conftest import REAL_SCENES

SIZE = (96, 64)
SHIFT = 1 / 256  # pixels; half of it along each axis by snapping, the rest for the float32 transform


def draw(device, triangles, view, projection, size=SIZE, **options):
    seen = Rasteriser(device, triangles, **options).draw(view, projection, *size)
    return seen.triangle.get(), seen.depth.get()


def unexplained(triangles, camera, ids, depths):
    """Pixels (row, column) that differ from the twin by more than a shift of SHIFT explains."""
    expected, nearest = draw_twin(triangles, *camera)
    screen = ScreenTriangles.of(triangles, Camera.of(*camera))

    def margins(number, centre):  # pixels to each edge, positive inside
        edges = screen.edges[number]
        return edges @ centre / np.maximum(np.hypot(edges[:, 0], edges[:, 1]), 1e-300)

    def depth_range(number, centre):
        plane = screen.depth[number]
        reach = np.hypot(plane[0], plane[1]) * SHIFT + 2e-6 * abs(plane @ centre)
        return plane @ centre - reach, plane @ centre + reach

    wrong = []
    for row, column in np.argwhere((ids != expected) | (abs(depths - nearest) > 2e-6 * nearest)):
        centre, mine, best = np.array([column + 0.5, row + 0.5, 1]), ids[row, column], expected[row, column]
        covers = mine < 0 or (margins(mine, centre) >= -SHIFT).all()
        mine_nearest = depth_range(mine, centre)[1] if mine >= 0 else 0.0
        best_robust = best >= 0 and (margins(best, centre) > SHIFT).all() and depth_range(best, centre)[1] < 1
        missed = best_robust and mine != best and depth_range(best, centre)[0] > mine_nearest
        low, high = depth_range(mine, centre) if mine >= 0 else (0.0, 0.0)
        if not covers or missed or not low <= depths[row, column] <= high:
            wrong.append((row, column))
    return wrong


@pytest.mark.parametrize("seed", range(4))
def test_random_triangles_are_drawn_as_by_the_twin(device, seed):
    rng = np.random.default_rng(seed)
    triangles = random_soup(device, rng, 300, flags=Triangles.DOUBLE_SIDED * (seed % 2))
    projection = [perspective(), perspective(120, 1.5, (0.3, -0.2)), orthographic(6, 4, 30)][seed % 3]
    view = look_at(rng.normal(0, 4, 3), (0, 0, 0))
    ids, depths = draw(device, triangles, view, projection)
    assert (ids >= 0).any()
    assert unexplained(triangles, (view, projection, *SIZE), ids, depths) == []


def test_a_planted_error_is_not_explained_by_a_shift(device):
    triangles = soup(device, [pixel_points([[5, 5], [5, 60], [90, 60]], *SIZE)])
    ids, depths = draw(device, triangles, np.eye(4), perspective())
    ids[50, 30], depths[50, 30] = -1, 0
    assert unexplained(triangles, (np.eye(4), perspective(), *SIZE), ids, depths) == [(50, 30)]


@pytest.mark.skipif(not REAL_SCENES.is_dir(), reason="real scenes are not here")
def test_part_of_a_real_view_is_drawn_as_by_the_twin(device):
    from shading_atlas_bench.scenes.load import load_scene

    scene = load_scene(str(REAL_SCENES / "sponza_dabrovic" / "scene.glb"))
    middle = np.mean([scene.positions.min(axis=0), scene.positions.max(axis=0)], axis=0)
    view = look_at(middle, middle + np.array([1.0, 0.05, 0.1]))
    projection = np.diag([12.0, 12.0, 1, 1]) @ perspective(75)  # a window of 1/12 of a view
    triangles = Triangles.upload(device, scene.positions, scene.indices, np.zeros(len(scene.indices), np.uint8))
    inside = in_frustum_twin(boxes_twin(triangles, 1), Camera.of(view, projection, *SIZE))
    part = Triangles.upload(device, scene.positions, scene.indices[inside], np.zeros(len(inside), np.uint8))
    ids, depths = draw(device, triangles, view, projection)
    assert np.isin(ids[ids >= 0], inside).all()
    numbers = np.where(ids >= 0, np.searchsorted(inside, ids), -1)
    assert (ids >= 0).mean() > 0.5
    assert unexplained(part, (view, projection, *SIZE), numbers, depths) == []


def fan(rng, spokes):
    """A closed fan around about (48, 32) in pixels, with corners on and off pixel centres."""
    angles = (np.arange(spokes) + rng.uniform(0, 0.8, spokes)) * 2 * np.pi / spokes
    ring = np.array([48, 32]) + np.stack([np.cos(angles), np.sin(angles)], axis=1) * rng.uniform(20, 30, (spokes, 1))
    ring[::2] = np.round(ring[::2]) + 0.5
    middle = np.array([48.5, 32.5]) if spokes % 2 else np.array([48, 32]) + rng.uniform(-1, 1, 2)
    ring = ring[np.argsort(np.arctan2(*(ring - middle).T))]
    return np.stack([np.broadcast_to(middle, ring.shape), ring, np.roll(ring, -1, axis=0)], axis=1)


@pytest.mark.parametrize("spokes", [5, 12, 41])
def test_each_sample_of_a_fan_is_hit_once(device, spokes):
    corners = pixel_points(fan(np.random.default_rng(spokes), spokes), *SIZE)
    alone = [draw(device, soup(device, [c], Triangles.DOUBLE_SIDED), np.eye(4), perspective())[0] for c in corners]
    hits = np.sum([ids >= 0 for ids in alone], axis=0)
    together, _ = draw(device, soup(device, corners, Triangles.DOUBLE_SIDED), np.eye(4), perspective())
    assert hits.max() == 1
    np.testing.assert_array_equal(hits == 1, together >= 0)
    rows, columns = np.mgrid[: SIZE[1], : SIZE[0]] + 0.5
    assert (hits[np.hypot(columns - 48, rows - 32) < 6] == 1).all()


@pytest.mark.parametrize("reach", [3.0, 1e3, 1e6])
def test_a_floor_that_passes_below_and_behind_the_eye_has_no_holes(device, reach):
    angles = np.linspace(0, 2 * np.pi, 15)[:-1]
    ring = np.stack([np.cos(angles), np.zeros(14), np.sin(angles)], axis=1) * reach
    corners = np.stack([np.broadcast_to([0.1, 0, 0.2], ring.shape), ring, np.roll(ring, -1, axis=0)], axis=1)
    view = look_at((0, 0.5, 0), (1, 0.0, 0.3))
    alone = [draw(device, soup(device, [c], Triangles.DOUBLE_SIDED), view, perspective())[0] for c in corners]
    hits = np.sum([ids >= 0 for ids in alone], axis=0)
    assert hits.max() == 1
    camera = Camera.of(view, perspective(), *SIZE)
    rows, columns = np.mgrid[: SIZE[1], : SIZE[0]] + 0.5
    ndc = np.stack([2 * columns / SIZE[0] - 1, 1 - 2 * rows / SIZE[1]], axis=-1)
    rays = (
        np.concatenate([ndc / perspective()[[0, 1], [0, 1]], np.full((*rows.shape, 1), -1.0)], axis=-1) @ view[:3, :3]
    )
    distance = np.where(rays[..., 1] < 0, -camera.eye[1] / np.minimum(rays[..., 1], -1e-12), np.inf)
    point = camera.eye + np.where(np.isfinite(distance), distance, 0)[..., None] * rays
    surely_inside = np.isfinite(distance) & (np.hypot(point[..., 0], point[..., 2]) < 0.9 * reach) & (distance > 0.11)
    assert (hits[surely_inside] == 1).all()
    assert surely_inside.sum() > 500


def test_large_coordinates_on_screen(device):
    far = 2.0**15
    pixels = [[-far, -far + 7], [far, far + 7.3], [-far, far]], [[-far, -far + 7], [far, -far], [far, far + 7.3]]
    triangles = soup(device, pixel_points(pixels, *SIZE), Triangles.DOUBLE_SIDED)
    ids, depths = draw(device, triangles, np.eye(4), perspective())
    assert (ids >= 0).all()
    assert set(np.unique(ids)) == {0, 1}
    assert unexplained(triangles, (np.eye(4), perspective(), *SIZE), ids, depths) == []


def test_a_world_offset_of_a_million_changes_nothing(device):
    rng = np.random.default_rng(3)
    corners = np.round(rng.normal(0, 8, (200, 3, 3)) * 8) / 8  # exact in float32 also at the offset
    offset = np.array([1e6, -1e6, 5e5])
    eye = np.array([0.3, 0.2, 12.1])
    here = draw(device, soup(device, corners), look_at(eye, (0, 0, 0)), perspective())
    there = draw(device, soup(device, corners + offset), look_at(eye + offset, offset), perspective())
    assert (here[0] != there[0]).sum() <= 3  # the view matrix itself rounds the eye to 1e-10
    same = here[0] == there[0]
    np.testing.assert_allclose(here[1][same], there[1][same], rtol=1e-5)


def test_tiny_triangles(device):
    rng = np.random.default_rng(4)
    centres = np.concatenate([rng.uniform(0, 64, (300, 1, 2)), np.floor(rng.uniform(0, 60, (100, 1, 2))) + 0.5])
    triangles = soup(device, pixel_points(centres + rng.normal(0, 1e-3, (400, 3, 2)), *SIZE), Triangles.DOUBLE_SIDED)
    ids, depths = draw(device, triangles, np.eye(4), perspective())
    assert unexplained(triangles, (np.eye(4), perspective(), *SIZE), ids, depths) == []


def test_one_triangle_over_the_whole_screen(device):
    triangles = soup(device, [pixel_points([[-200, -10], [0, 4000], [900, -10]], *SIZE, distance=7.0)])
    ids, depths = draw(device, triangles, np.eye(4), perspective())
    assert (ids == 0).all()
    np.testing.assert_allclose(depths, 0.1 / 7, rtol=1e-6)


def test_only_front_faces_unless_double_sided(device):
    counter_clockwise = pixel_points([[10, 10], [10, 50], [80, 50]], *SIZE)
    clockwise = counter_clockwise[::-1]
    for corners, flags, shown in [
        (counter_clockwise, 0, True),
        (clockwise, 0, False),
        (clockwise, Triangles.DOUBLE_SIDED, True),
    ]:
        ids, _ = draw(device, soup(device, [corners], flags), np.eye(4), perspective())
        assert (ids >= 0).any() == shown


def test_of_coplanar_duplicates_the_lowest_wins(device):
    corners = pixel_points([[10, 10], [10, 50], [80, 50]], *SIZE)
    for options in ({}, {"cluster": 8}):
        ids, _ = draw(device, soup(device, [corners] * 30), np.eye(4), perspective(), **options)
        assert set(np.unique(ids)) == {-1, 0}


def square_at(z):
    """A triangle across the view at a height z of world space."""
    return np.array([[-9, -9, z], [9, -9, z], [0, 9, z]])


def test_near_and_far_ends(device):
    before_near, behind = square_at(-0.05), square_at(1)
    assert (draw(device, soup(device, [before_near, behind]), np.eye(4), perspective())[0] == -1).all()
    beyond_far = soup(device, [square_at(-31), square_at(0.1)])
    assert (draw(device, beyond_far, np.eye(4), orthographic(6, 4, 30))[0] == -1).all()
    _, depths = draw(device, soup(device, [square_at(-3)]), np.eye(4), orthographic(1, 1, 30))
    np.testing.assert_allclose(depths, 0.9, rtol=1e-6)


def test_empty_and_unusable_input(device):
    nothing = soup(device, np.zeros((0, 3, 3)))
    ids, depths = draw(device, nothing, np.eye(4), perspective())
    assert (ids == -1).all()
    assert (depths == 0).all()
    for value in (np.nan, np.inf, 1e38):
        corners = np.zeros((100, 3, 3))
        corners[70, 1, 2] = value
        with pytest.raises(ValueError, match="triangles 64 to 99 is NaN, infinite or beyond 1e18"):
            Rasteriser(device, soup(device, corners))
    rasteriser = Rasteriser(device, soup(device, np.zeros((1, 3, 3))))
    with pytest.raises(ValueError, match="finite 4 x 4"):
        rasteriser.draw(np.full((4, 4), np.nan), perspective(), *SIZE)
    with pytest.raises(ValueError, match="1 to 8192"):
        rasteriser.draw(np.eye(4), perspective(), 9000, 10)
    assert (rasteriser.draw(np.eye(4), perspective(), 1, 1).triangle.get() == -1).all()


def test_same_bytes_for_every_way_of_cutting_the_work(device, monkeypatch):
    triangles = random_soup(device, np.random.default_rng(8), 3000)
    view, size = look_at((0, 1, 6), (0, 0, 0)), (331, 203)
    expected = draw(device, triangles, view, perspective(), size)
    for chunks, local, options in [
        (1, 1, {}),
        (7, 16, {"cluster": 8, "tile": 8}),
        (64, 256, {"cluster": 128, "tile": 32}),
        (200, 64, {"tile": 24}),
    ]:
        monkeypatch.setattr(device, "chunks", chunks)
        monkeypatch.setattr(device, "local_size", local)
        ids, depths = draw(device, triangles, view, perspective(), size, **options)
        assert ids.tobytes() == expected[0].tobytes()
        assert depths.tobytes() == expected[1].tobytes()


def test_two_passes_along_a_path_change_nothing(device):
    triangles = random_soup(device, np.random.default_rng(9), 4000)
    one, two = Rasteriser(device, triangles), Rasteriser(device, triangles, two_passes_from=0)
    for step in range(5):
        camera = (look_at((0.7 * step - 1, 1, 6 - step), (0, 0, 0)), perspective(), 200, 130)
        expected, seen = one.draw(*camera), two.draw(*camera)
        assert seen.triangle.get().tobytes() == expected.triangle.get().tobytes()
        assert seen.depth.get().tobytes() == expected.depth.get().tobytes()


def second_pass(rasteriser):
    """A draw, and the clusters that its second pass took on."""
    chosen, draw_clusters = [], rasteriser._draw_clusters

    def note(clusters, *rest):
        chosen.append(clusters.numbers(rasteriser.clusters.count))
        return draw_clusters(clusters, *rest)

    rasteriser._draw_clusters = note
    seen = rasteriser.draw(np.eye(4), perspective(), *SIZE)
    assert len(chosen) == 2
    return seen, chosen[1]


def test_the_second_pass_leaves_out_what_the_first_hides(device):
    wall = [[[-20, -20, -2], [20, -20, -2], [0, 30, -2]]] * 64
    behind = np.random.default_rng(13).normal(0, 1, (640, 3, 3)) - [0, 0, 9]
    triangles = soup(device, np.concatenate([wall, behind]), Triangles.DOUBLE_SIDED)
    rasteriser = Rasteriser(device, triangles, two_passes_from=0)
    rasteriser.draw(np.eye(4), perspective(), *SIZE)
    seen, left = second_pass(rasteriser)
    assert (seen.triangle.get() == 0).all()
    assert len(left) == 0
    assert len(rasteriser.in_frustum(np.eye(4), perspective())) == 11


@pytest.mark.parametrize(("reach", "left_out"), [(0.2, True), (0.45, False)])
def test_the_second_pass_leaves_out_what_lies_between_the_pixels(device, reach, left_out):
    """Clusters around where four pixels meet, before a wall: those that reach 0.45 pixels may cover one."""
    wall = pixel_points([[-200, -10], [0, 4000], [900, -10]], *SIZE, distance=7.0)
    near = pixel_points(np.array([48, 32]) + np.random.default_rng(0).uniform(-reach, reach, (640, 3, 2)), *SIZE)
    triangles = soup(device, np.concatenate([[wall] * 64, near * 0.5]), Triangles.DOUBLE_SIDED)
    rasteriser = Rasteriser(device, triangles, two_passes_from=0)
    rasteriser.draw(np.eye(4), perspective(), *SIZE)
    seen, left = second_pass(rasteriser)
    assert (seen.triangle.get() == 0).all()
    assert (len(left) == 0) == left_out


@pytest.mark.parametrize("room", [(1, 1), (1, 8192), (8192, 1)])
def test_records_that_do_not_fit_are_set_up_again(device, room):
    triangles = random_soup(device, np.random.default_rng(10), 2000)
    camera = (look_at((0, 1, 6), (0, 0, 0)), perspective(), *SIZE)
    expected = Rasteriser(device, triangles).draw(*camera).triangle.get()
    tight = Rasteriser(device, triangles)
    tight._scratch.records, tight._scratch.entries = room
    np.testing.assert_array_equal(tight.draw(*camera).triangle.get(), expected)
    assert tight._scratch.records > 1
    assert tight._scratch.entries > 1


def test_clusters_outside_the_frustum_are_left_out(device):
    triangles = random_soup(device, np.random.default_rng(11), 1000)
    rasteriser = Rasteriser(device, triangles, cluster=8)
    boxes = rasteriser.clusters.boxes.get()
    expected = boxes_twin(triangles, 8)
    np.testing.assert_array_equal(boxes[:, [0, 1, 2]], expected[:, 0])
    np.testing.assert_array_equal(boxes[:, [4, 5, 6]], expected[:, 1])
    for view in (look_at((0, 1, 6), (0, 0, 0)), look_at((0, 1, 6), (9, 3, 9))):
        clusters = rasteriser.in_frustum(view, perspective(40))
        inside = in_frustum_twin(expected, Camera.of(view, perspective(40), *SIZE))
        assert set(inside) <= set(clusters)
        assert len(clusters) <= len(inside) + 2


@pytest.mark.parametrize("faded", [False, True])
def test_masked_triangles_have_holes(device, faded):
    from shading_atlas_bench.kernels.texture.mask import AlphaMask, margin_twin
    from shading_atlas_bench.scenes.model import Material, Texture

    rng = np.random.default_rng(12)
    texels = np.full((16, 16, 4), 255, np.uint8)
    texels[..., 3] = rng.integers(0, 2, (16, 16)) * 255
    corners = np.array([[[-3, -2, -3], [3, -2, -3], [0, 3, -5]], [[-9, -9, -9], [9, -9, -9], [0, 9, -9]]])
    triangles = soup(device, corners)
    flags = np.array([Triangles.MASKED, 0], np.uint8)
    triangles = replace(triangles, flags=device.upload(flags), host_flags=flags)
    materials = [Material(base_texture=0, alpha_mode="mask"), Material()]
    uvs = rng.uniform(0, 2, (6, 2)).astype(np.float32)
    alphas = np.array([1.0, 0.2, 0.9, 0, 0, 0], np.float32) if faded else None
    known = (triangles.host_indices, uvs, np.array([0, 1]), materials, [Texture("", texels)])
    mask = AlphaMask.upload(device, *known, vertex_alphas=alphas)
    seen = Rasteriser(device, triangles, mask).draw(np.eye(4), perspective(), *SIZE).triangle.get()
    whole, _ = draw(device, triangles, np.eye(4), perspective())
    assert (seen[whole == 1] == 1).all()
    assert {0, 1} <= set(np.unique(seen[whole == 0]))

    screen = ScreenTriangles.of(triangles, Camera.of(np.eye(4), perspective(), *SIZE))
    rows, columns = np.nonzero(whole == 0)
    weights = np.stack([columns + 0.5, rows + 0.5, np.ones(len(rows))], axis=1) @ screen.edges[0].T
    weights /= weights.sum(axis=1, keepdims=True)
    projected = Camera.of(np.eye(4), perspective(), *SIZE).project(corners[0])
    sides = np.diff(projected[:, :2] / projected[:, 3:] / 256, axis=0)
    area = abs(sides[0, 0] * sides[1, 1] - sides[0, 1] * sides[1, 0]) / 2
    assert mask
    margin = margin_twin(mask, np.zeros(len(rows), int), weights[:, 1], weights[:, 2], np.full(len(rows), area))
    sure = abs(margin) > 1
    np.testing.assert_array_equal((seen[rows, columns] == 0)[sure], margin[sure] > 0)
