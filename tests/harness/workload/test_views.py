"""Cameras: rotations, the cell's frustum and the frusta that cover it, confinement of the client."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shading_atlas_bench.harness.workload.views import (
    CellFrustum,
    Pose,
    ViewCell,
    client_view,
    confined,
    from_rotation_vector,
    rotation,
    rotation_vector,
)
from shading_atlas_bench.scenes.quaternions import conjugate, multiply

angles = st.floats(-3, 3)
vectors = st.tuples(angles, angles, angles).map(np.array)
turns = vectors.map(from_rotation_vector)


def project(view, point):
    """Pixel position and clip w of a point."""
    clip = view.matrix @ np.append(point, 1.0)
    ndc = clip[:2] / clip[3]
    return np.array([(ndc[0] + 1) / 2 * view.width, (1 - ndc[1]) / 2 * view.height]), clip[3]


@given(turns, turns)
def test_multiplication_is_composition_of_rotations(a, b):
    assert rotation(multiply(a, b)) == pytest.approx(rotation(a) @ rotation(b), abs=1e-12)
    assert rotation(multiply(a, conjugate(a))) == pytest.approx(np.eye(3), abs=1e-12)


@given(vectors)
def test_rotation_vectors_are_the_inverse_of_quaternions(vector):
    if np.linalg.norm(vector) < np.pi - 1e-3:
        assert rotation_vector(from_rotation_vector(vector)) == pytest.approx(vector, abs=1e-9)


def test_a_camera_looks_along_minus_z_with_row_0_on_top():
    view = client_view(Pose(np.array([1.0, 2.0, 3.0]), np.array([0, 0, 0, 1.0])), 90, 200, 100, 0.1)
    pixel, distance = project(view, [1, 2, -7])
    assert pixel == pytest.approx([100, 50])
    assert distance == pytest.approx(10)
    up_right, _ = project(view, [1 + 5, 2 + 2.5, -7])
    assert up_right == pytest.approx([150, 25])
    assert view.eye == pytest.approx([1, 2, 3])
    assert view.pixels_per_tangent == pytest.approx(100)


@settings(max_examples=30)
@given(
    turn=turns,
    cell_fov=st.floats(60, 175),
    size=st.sampled_from([(960, 540), (512, 512), (300, 700)]),
    seed=st.integers(0, 99),
)
def test_the_frusta_cover_the_cell_at_the_density_asked_for(turn, cell_fov, size, seed):
    pose = Pose(np.array([3.0, -2.0, 5.0]), turn)
    frustum = CellFrustum.around(ViewCell(0.1, cell_fov), 60, *size)
    views = frustum.frusta(pose, 0.01, 2 * frustum.density)
    random = np.random.default_rng(seed).uniform(-1, 1, (50, 2))
    rays = np.concatenate([[[-1, -1], [-1, 1], [1, -1], [1, 1], [0, 0]], random]) * (frustum.tan_x, frustum.tan_y)
    for x, y in rays * (1 - 1e-9):
        point = pose.position + rotation(turn) @ np.array([x, y, -1.0])
        hits = [project(view, point) for view in views]
        assert any(
            w > 0 and -1e-3 <= p[0] <= v.width + 1e-3 and -1e-3 <= p[1] <= v.height + 1e-3
            for (p, w), v in zip(hits, views, strict=True)
        )
    for view in views:
        assert np.degrees(np.arctan(1 / view.projection[0, 0])) <= 60  # tilting widens at most by 1 / cos 44
        assert view.pixels_per_tangent >= 2 * frustum.density * (1 - 1e-9)


@settings(max_examples=50)
@given(turn=turns, shift=vectors, look=vectors)
def test_a_confined_client_stays_inside_the_cell(turn, shift, look):
    frustum = CellFrustum.around(ViewCell(0.1, 80), 60, 960, 540)
    server = Pose(np.zeros(3), turn)
    wanted = Pose(shift, multiply(turn, from_rotation_vector(look)))
    client = client_view(wanted, 60, 960, 540, 0.1)
    pose, moved = confined(server, wanted, 0.1, frustum, client)
    assert np.linalg.norm(pose.position) <= 0.1 * (1 + 1e-9)
    assert frustum.contains(server, client_view(pose, 60, 960, 540, 0.1))
    if not moved:
        assert pose.position == pytest.approx(shift)


def test_a_client_inside_the_cell_is_not_moved():
    frustum = CellFrustum.around(ViewCell(0.1, 80), 60, 960, 540)
    server = Pose(np.zeros(3), np.array([0, 0, 0, 1.0]))
    wanted = Pose(np.array([0.05, 0, 0]), from_rotation_vector(np.array([0.02, 0.05, 0.01])))
    pose, moved = confined(server, wanted, 0.1, frustum, client_view(wanted, 60, 960, 540, 0.1))
    assert not moved
    assert pose.position == pytest.approx(wanted.position)
