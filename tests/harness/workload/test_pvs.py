"""The potentially visible set: what views from inside the cell show is in it; nothing is drawn for nothing."""

from dataclasses import replace

import numpy as np
import pytest

from shading_atlas_bench.harness.workload import pvs
from shading_atlas_bench.harness.workload.frames import FrameSource
from shading_atlas_bench.harness.workload.pvs import POOR, cell_eyes, potentially_visible
from shading_atlas_bench.harness.workload.settings import Settings
from shading_atlas_bench.harness.workload.upload import upload_scene
from shading_atlas_bench.harness.workload.views import (
    CellFrustum,
    Pose,
    ViewCell,
    client_view,
    confined,
    from_rotation_vector,
)
from shading_atlas_bench.packers.skips import Skips
from shading_atlas_bench.scenes.features import content_digest, find_features
from shading_atlas_bench.scenes.hall import make_hall
from shading_atlas_bench.scenes.head_motion import HeadMotion
from shading_atlas_bench.scenes.model import Material, Scene
from shading_atlas_bench.scenes.paths import make_path
from shading_atlas_bench.scenes.quaternions import multiply

AHEAD = np.array([0, 0, 0, 1.0])


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    """Sets of other tests and runs must not answer for what is tested here."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))


@pytest.fixture(scope="module")
def hall(device):
    scene = make_hall()
    scene.features, scene.content_hash = find_features(scene), content_digest(scene)
    return upload_scene(device, scene)


@pytest.fixture(scope="module")
def wall(device):
    """One large quad, and a small one behind it."""
    quad = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32)
    positions = np.concatenate([quad * (20, 20, 1) - (0, 0, 2), quad * 0.1 - (0, 0, 3)]).astype(np.float32)
    indices = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]], np.int32)
    scene = Scene(
        name="wall",
        positions=positions,
        indices=indices,
        normals=np.tile(np.array([0, 0, 1], np.float32), (8, 1)),
        uvs=np.zeros((8, 2), np.float32),
        colours=np.ones((8, 4), np.float32),
        material_ids=np.zeros(4, np.int32),
        materials=[Material()],
        content_hash="wall",
    )
    return upload_scene(device, scene)


def test_views_from_inside_the_cell_show_hardly_anything_else(hall):
    """Over random poses in the cell, under 1 % of the pixels show a triangle outside the set."""
    settings = Settings(width=320, height=180)
    path = make_path(hall.host, "walk", 1)
    source = FrameSource(hall, path, HeadMotion.synthetic(0), settings)
    frame = source.work(0).frame
    server = Pose(path.positions[0], path.orientations[0])
    known = np.zeros(hall.host.triangle_count, bool)
    known[frame.pvs] = True
    random = np.random.default_rng(1)
    for _ in range(8):
        shift, turn = random.normal(size=3) * frame.cell_radius, random.normal(size=3) * 0.2
        wanted = Pose(server.position + shift, multiply(server.orientation, from_rotation_vector(turn)))
        camera = client_view(wanted, 60, 320, 180, source.near)
        pose, _ = confined(server, wanted, frame.cell_radius, source.frustum, camera)
        view = client_view(pose, 60, 320, 180, source.near)
        seen = hall.rasteriser.draw(view.view, view.projection, 320, 180).triangle.get()
        assert np.mean(~known[seen[seen >= 0]]) < 0.01
    assert len(frame.pvs) < hall.host.triangle_count
    assert (np.diff(frame.pvs) > 0).all()


def test_what_a_wall_hides_is_not_potentially_visible(wall):
    frustum = CellFrustum.around(ViewCell(0.1, 80), 60, 96, 54)
    found = potentially_visible(wall, Pose(np.zeros(3), AHEAD), 0.1, frustum, 0.01, 2.0)
    assert found.ids.tolist() == [0, 1]


def test_views_that_add_nothing_are_not_drawn(wall):
    """A view whose clusters are marked already is skipped; a hidden triangle in one keeps it."""
    frustum = CellFrustum.around(ViewCell(0.1, 60), 60, 96, 54)
    ahead = Pose(np.zeros(3), AHEAD)
    wall_only = potentially_visible(wall, ahead, 0.1, frustum, 0.01, 2.0)
    assert wall_only.ids.tolist() == [0, 1]
    assert wall_only.planned == 9
    # All four triangles share one cluster, whose hidden part keeps every view from being skipped.
    assert wall_only.views == 9
    alone = potentially_visible(_without_the_hidden(wall), ahead, 0.1, frustum, 0.01, 2.0)
    assert alone.ids.tolist() == [0, 1]
    assert alone.views == 1
    assert wall.skips.take() == set()
    with wall.device.record() as record:
        forced = _without_the_hidden(wall, Skips(["set views"]))
        every = potentially_visible(forced, ahead, 0.1, frustum, 0.01, 2.0, cached=False)
    assert every.ids.tolist() == [0, 1]
    assert every.views == 9
    assert record.launches["pvs/mark"] == 9
    assert forced.skips.take() == set()


def _without_the_hidden(wall, skips=None):
    host = replace(wall.host, indices=wall.host.indices[:2], material_ids=wall.host.material_ids[:2], content_hash="2")
    return upload_scene(wall.device, host, skips)


def test_a_set_comes_from_the_cache_the_second_time(wall):
    frustum = CellFrustum.around(ViewCell(0.1, 80), 60, 96, 54)
    pose = Pose(np.zeros(3), AHEAD)
    first = potentially_visible(wall, pose, 0.1, frustum, 0.01, 2.0)
    again = potentially_visible(wall, pose, 0.1, frustum, 0.01, 2.0)
    assert first.views > 0
    assert first.milliseconds > 0
    assert again.ids.tolist() == first.ids.tolist()
    assert (again.views, again.planned, again.milliseconds) == (first.views, first.planned, first.milliseconds)
    other = potentially_visible(wall, pose, 0.1, frustum, 0.01, 1.0)
    assert other.views > 0


def test_the_cell_has_a_centre_and_eight_corners_on_its_sphere():
    eyes = list(cell_eyes(Pose(np.ones(3), AHEAD), 0.3))
    assert len(eyes) == 9
    assert [round(float(np.linalg.norm(eye.position - 1)), 9) for eye in eyes] == [0.0] + [0.3] * 8
    assert len(list(cell_eyes(Pose(np.ones(3), AHEAD), 0.0))) == 1


def _carpet(device, cells, opacity=1.0):
    """A square that fills a view at distance 2, in 2 x cells x cells triangles, smaller towards its middle."""
    t = np.sqrt(3) * np.linspace(-1, 1, cells + 1)
    x, y = np.meshgrid(*2 * [t * abs(t)], indexing="ij")
    corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    quads = np.stack([corner, corner + cells + 1, corner + cells + 2, corner + 1], axis=1)
    indices = quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3).astype(np.int32)
    count = len(indices)
    scene = Scene(
        name="carpet",
        positions=np.stack([x.ravel(), y.ravel(), np.full(x.size, -2.0)], axis=1).astype(np.float32),
        indices=indices,
        normals=np.tile(np.array([0, 0, 1], np.float32), (x.size, 1)),
        uvs=np.zeros((x.size, 2), np.float32),
        colours=np.ones((x.size, 4), np.float32),
        material_ids=np.zeros(count, np.int32),
        materials=[Material(alpha_mode="blend", base_colour=(1, 1, 1, opacity)) if opacity < 1 else Material()],
        content_hash=f"carpet {cells} {opacity}",
    )
    scene.features = find_features(scene)
    return upload_scene(device, scene)


def _missing(scene, pvs, eye):
    """The share of the pixels of a client of 60 degrees at `eye` whose triangle is not in the set."""
    view = client_view(Pose(eye, AHEAD), 60, 96, 54, 0.01)
    seen = scene.rasteriser.draw(view.view, view.projection, view.width, view.height).triangle.get()
    return np.mean(~np.isin(seen[seen >= 0], pvs))


@pytest.mark.parametrize("opacity", [1.0, 0.5])
def test_tiny_triangles_are_looked_for_with_more_samples(device, opacity, monkeypatch):
    """One denser eye among nine halves what they miss, as views from anywhere in the cell show."""
    carpet = _carpet(device, 400, opacity)
    frustum = CellFrustum.around(ViewCell(0.1, 80), 60, 96, 54)
    cell = (Pose(np.zeros(3), AHEAD), 0.1, frustum, 0.01, 2.0)
    found = potentially_visible(carpet, *cell)
    assert found.planned == 9
    assert len(found.ids) > POOR * 4 * frustum.pixels
    monkeypatch.setattr(pvs, "POOR", np.inf)
    nine = potentially_visible(carpet, *cell, cached=False)
    assert set(found.ids.tolist()) - set(nine.ids.tolist())
    eyes = np.random.default_rng(0).uniform(-0.05, 0.05, (6, 3))
    missing = [np.mean([_missing(carpet, pvs.ids, eye) for eye in eyes]) for pvs in (found, nine)]
    assert 0 < missing[0] < 0.5 * missing[1]


@pytest.mark.parametrize(("cells", "densest"), [(8, 2), (400, 6)])
def test_only_tiny_triangles_have_a_denser_view(device, monkeypatch, cells, densest):
    widths: list[int] = []
    draw = pvs._mark

    def noted(*marked):
        widths.extend(view.width for view in marked[1])
        return draw(*marked)

    frustum = CellFrustum.around(ViewCell(0.1, 60), 60, 96, 54)
    monkeypatch.setattr(pvs, "_mark", noted)
    potentially_visible(_carpet(device, cells), Pose(np.zeros(3), AHEAD), 0.1, frustum, 0.01, 2.0)
    assert sorted(widths) == [2 * 96] * 8 + [densest * 96]


def test_no_view_is_larger_than_can_be_drawn(device, monkeypatch):
    monkeypatch.setattr(pvs, "LARGEST_VIEW", 256)
    frustum = CellFrustum.around(ViewCell(0.1, 60), 60, 96, 54)
    carpet = _carpet(device, 400)
    with device.record() as record:
        found = potentially_visible(carpet, Pose(np.zeros(3), AHEAD), 0.1, frustum, 0.01, 2.0)
    assert (found.planned, record.launches["pvs/mark"]) == (9, 9)


def test_a_cell_of_one_point_is_looked_at_twice_where_triangles_are_tiny(device):
    frustum = CellFrustum.around(ViewCell(0, 60), 60, 96, 54)
    ahead = Pose(np.zeros(3), AHEAD)
    assert potentially_visible(_carpet(device, 400), ahead, 0.0, frustum, 0.01, 2.0).planned == 2
    assert potentially_visible(_carpet(device, 8), ahead, 0.0, frustum, 0.01, 2.0).planned == 1


def test_frames_depend_on_their_index_alone(hall):
    """A resumed run starts anywhere and must get the same work."""
    settings = Settings(width=64, height=36, cell_radius=0.02)
    path = make_path(hall.host, "walk", 6)
    head = HeadMotion.synthetic(3)
    forwards = FrameSource(hall, path, head, settings)
    works = [forwards.work(i) for i in range(6)]
    again = FrameSource(hall, path, head, settings).work(5)
    assert np.array_equal(again.novel.view, works[5].novel.view)
    assert np.array_equal(again.frame.pvs, works[5].frame.pvs)
    for ours, theirs in zip(again.frame.predicted, works[5].frame.predicted, strict=True):
        assert np.array_equal(ours.view, theirs.view)
    assert not np.array_equal(works[4].novel.view, works[5].novel.view)
