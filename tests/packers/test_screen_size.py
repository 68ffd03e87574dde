"""Triangles' edges in pixels, against values computed by hand: a pixel is 1/100 of the distance from the eye."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shading_atlas_bench import edge_pixels
from shading_atlas_bench.harness.workload.views import CellFrustum, Pose, ViewCell, client_view, projection_matrix
from shading_atlas_bench.packers.interface import View

NEAR = 0.1
VIEW = View(np.eye(4), projection_matrix(1.0, 0.5, NEAR), 200, 100)


def lengths(*corners: tuple[float, float, float], view: View = VIEW) -> list[float]:
    return edge_pixels(view, np.array([corners], np.float32))[0].tolist()


def test_a_triangle_parallel_to_the_picture():
    """Of 3, 4 and 5 units, 2 units away."""
    assert lengths((0, 0, -2), (3, 0, -2), (3, 4, -2)) == pytest.approx([150, 200, 250])


def test_a_picture_may_have_half_a_pixel_to_its_middle():
    """A side of 3 units, 2 away, is 1.5 times 100.5 pixels long; one of 4 upwards 4 times 50.5."""
    odd = View(np.eye(4), VIEW.projection, 201, 101)
    found = lengths((0, 0, -2), (3, 0, -2), (3, 4, -2), view=odd)
    assert found == pytest.approx([150.75, 202, np.hypot(150.75, 202)])


def test_perspective_shortens_what_is_far_away():
    """From x = 1 at distance 1, pixel 100, to x = 1 at distance 4, pixel 25, and on to x = 2, pixel 50."""
    assert lengths((1, 0, -1), (1, 0, -4), (2, 0, -4)) == pytest.approx([75, 25, 50])


def test_an_edge_along_a_ray_is_a_point():
    assert lengths((1, 0.5, -1), (2, 1, -2), (4, 2, -4)) == pytest.approx([0, 0, 0], abs=1e-4)


def test_nothing_behind_the_eye_has_a_size():
    assert lengths((0, 0, 1), (3, 0, 1), (3, 4, 2)) == [0, 0, 0]


def test_an_edge_is_cut_at_the_near_plane():
    """From distance 0.5, pixel 60, to behind the eye: at distance 0.1 it is at pixel 300. The edge from there to the
    middle of the picture comes to distance 0.1 after 0.6 of its way, at x = 0.12, pixel 120."""
    assert lengths((0.3, 0, -0.5), (0.3, 0, 0.5), (0, 0, -0.5)) == pytest.approx([240, 120, 60], rel=1e-5)


def test_an_edge_in_the_near_plane_counts_and_one_that_ends_there_does_not():
    near = float(np.float32(NEAR) + np.float32(1e-8))
    assert lengths((0, 0, -near), (0.1, 0, -near), (0, 0, 0)) == pytest.approx([100, 0, 0], abs=1e-3)


def test_an_eye_that_is_elsewhere_and_turned():
    """At (10, 5, -3), turned left by a quarter, so that it looks along -x and its right is -z."""
    pose = Pose(np.array([10.0, 5.0, -3.0]), np.array([0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5)]))
    view = client_view(pose, 90.0, 200, 100, NEAR)
    assert lengths((8, 5, -3), (8, 5, -6), (8, 9, -6), view=view) == pytest.approx([150, 200, 250], rel=1e-5)


def test_a_picture_that_is_not_centred_has_the_same_sizes():
    projection = VIEW.projection.copy()
    projection[:2, 2] = 0.3, -0.2
    shifted = View(VIEW.view, projection, VIEW.width, VIEW.height)
    corners = ((0, 0, -2), (3, 0, -1), (3, 4, 5))
    assert lengths(*corners, view=shifted) == pytest.approx(lengths(*corners))


def test_no_triangles_have_no_sizes():
    assert edge_pixels(VIEW, np.empty((0, 3, 3), np.float32)).shape == (0, 3)


def test_a_server_s_pixels_are_the_client_s():
    """Within the one pixel by which the server's picture is rounded up."""
    pose = Pose(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]))
    client = client_view(pose, 60.0, 960, 540, NEAR)
    server = CellFrustum.around(ViewCell(0.08, 125), 60.0, 960, 540).server_view(pose, NEAR)
    corners = ((0, 0, -2), (0.1, 0, -2), (0.1, 0.1, -2))
    assert lengths(*corners, view=server) == pytest.approx(lengths(*corners, view=client), rel=1 / 500)


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 9999))
def test_sizes_are_finite_and_the_same_in_either_direction(seed: int):
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(40, 3, 3)) * 10.0 ** rng.uniform(-3, 6, (40, 1, 1))
    found = edge_pixels(VIEW, corners)
    assert np.isfinite(found).all()
    assert (found >= 0).all()
    np.testing.assert_allclose(edge_pixels(VIEW, corners[:, ::-1])[:, [1, 0, 2]], found, rtol=1e-6, atol=1e-6)
