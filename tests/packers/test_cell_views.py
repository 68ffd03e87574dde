"""Views that cover a cell: every ray of it belongs to exactly one, and that one's picture shows it."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shading_atlas_bench.harness.workload.views import CellFrustum, Pose, ViewCell, from_rotation_vector, rotation
from shading_atlas_bench.packers.cell_views import owned_pixels, owned_spans, owners
from shading_atlas_bench.packers.interface import View

POSE = Pose(np.array([3.0, -2.0, 5.0]), from_rotation_vector(np.array([0.4, -1.1, 0.3])))


def views_of(cell_fov: float, size: tuple[int, int], pose: Pose = POSE) -> tuple[CellFrustum, list[View]]:
    frustum = CellFrustum.around(ViewCell(0.1, cell_fov), 60, *size)
    return frustum, frustum.frusta(pose, 0.01, frustum.density)


def rays_of(view: View) -> np.ndarray:
    """Through the centres of all pixels, (h, w, 3) in scene axes."""
    columns, rows = np.meshgrid(np.arange(view.width) + 0.5, np.arange(view.height) + 0.5)
    x = (2 * columns / view.width - 1 + view.projection[0, 2]) / view.projection[0, 0]
    y = (1 - 2 * rows / view.height + view.projection[1, 2]) / view.projection[1, 1]
    return np.stack([x, y, np.full(x.shape, -1.0)], axis=-1) @ view.view[:3, :3]


@settings(max_examples=60, deadline=None)
@given(
    turn=st.tuples(*[st.floats(-3, 3)] * 3).map(np.array),
    cell_fov=st.floats(60, 179),
    size=st.sampled_from([(960, 540), (512, 512), (300, 700)]),
    seed=st.integers(0, 99),
)
def test_each_ray_of_the_cell_is_in_the_picture_of_the_one_view_that_it_belongs_to(turn, cell_fov, size, seed):
    pose = Pose(POSE.position, from_rotation_vector(turn))
    frustum, views = views_of(cell_fov, size, pose)
    x, y = np.random.default_rng(seed).uniform(-1, 1, (2, 400))
    x[:4], y[:4] = (-1, -1, 1, 1), (-1, 1, -1, 1)
    x[4:20], y[20:36] = 0, 0  # the seams
    rays = np.stack([x * frustum.tan_x, y * frustum.tan_y, np.full(400, -1.0)], axis=1) @ rotation(pose.orientation).T
    for ray, owner in zip(rays, owners(views, rays), strict=True):
        clip = views[owner].matrix @ np.append(views[owner].eye + ray, 1.0)
        assert clip[3] > 0
        assert np.abs(clip[:2]).max() <= clip[3] * (1 + 1e-9)


@pytest.mark.parametrize("cell_fov", [80, 101, 125, 160, 179])
def test_spans_hold_the_pixels_whose_rays_belong_to_a_view(cell_fov):
    _, views = views_of(cell_fov, (96, 54))
    assert len(views) == {80: 1, 101: 2}.get(cell_fov, 4)
    for number, view in enumerate(views):
        expected = owners(views, rays_of(view).reshape(-1, 3)).reshape(view.height, view.width) == number
        np.testing.assert_array_equal(owned_pixels(views, number), expected)
        first, end = owned_spans(views, number).T
        np.testing.assert_array_equal(end - first, expected.sum(axis=1))
        assert expected.any()


@pytest.mark.parametrize("order", list(itertools.permutations(("ahead", "left", "right"))), ids="-".join)
def test_a_ray_between_two_views_belongs_to_the_first_of_them(order):
    """The view ahead has two columns, whose centres lie at 45 degrees to either side: half-way to the others."""
    right = np.array([[0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1.0]])
    turns = {"ahead": np.eye(4), "left": np.diag([-1, 1, -1, 1]) @ right, "right": right}
    projection = np.array([[0.5, 0, 0, 0], [0, 0.5, 0, 0], [0, 0, 0, 0.1], [0, 0, -1, 0]])
    views, number = [View(turns[name], projection, 2, 2) for name in order], order.index("ahead")
    owned = [number < order.index("left"), number < order.index("right")]
    assert owned_pixels(views, number).tolist() == [owned, owned]


def test_a_cell_is_split_above_100_degrees_only():
    for cell_fov, count in ((80, 0), (100, 0), (100.1, 2), (160, 4)):
        frustum, _ = views_of(cell_fov, (960, 540))
        assert len(frustum.split(POSE, 0.01)) == count


@pytest.mark.parametrize(("fov", "cell_fov"), [(110, 120), (140, 145), (179, 179)])
def test_a_client_that_is_itself_as_wide_has_one_view(fov, cell_fov):
    """At the density of its centre frusta would have fewer pixels near its edges than it has itself."""
    frustum = CellFrustum.around(ViewCell(0.1, cell_fov), fov, 160, 90)
    assert frustum.split(POSE, 0.01) == ()
