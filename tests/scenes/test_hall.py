"""The hall: a place with the triangles the packers' papers speak of."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shading_atlas_bench.scenes import builder, surfaces
from shading_atlas_bench.scenes.features import content_digest, find_features
from shading_atlas_bench.scenes.hall import HALF_LENGTH, HALF_WIDTH, HEIGHT, make_hall
from shading_atlas_bench.scenes.model import Scene, SceneError
from tests.scenes.checks import assert_sound, inward_share


@pytest.fixture(scope="module")
def hall() -> Scene:
    return make_hall()


def test_default_hall_is_sound(hall: Scene) -> None:
    assert hall.name == "hall"
    assert_sound(hall)
    low, high = hall.bounds
    assert np.all(high - low <= np.array([2 * HALF_LENGTH, HEIGHT, 2 * HALF_WIDTH]) + 0.1)


def test_few_very_large_and_many_slanted_triangles(hall: Scene) -> None:
    features = find_features(hall)
    assert 0.25 <= features.slanted <= 0.40
    assert features.largest > 0.6
    assert features.textures
    assert features.normal_maps
    assert not features.mask
    assert not features.blend


def test_three_spot_lights_cast_shadows_inside(hall: Scene) -> None:
    assert [(light.kind, light.shadows) for light in hall.lights] == [("spot", True)] * 3
    for light in hall.lights:
        assert np.all(np.abs(light.position) < (HALF_LENGTH, HEIGHT, HALF_WIDTH))


def test_shell_is_closed_and_faces_inwards(hall: Scene) -> None:
    """From the camera, every direction meets geometry, and its nearest surface is a front."""
    assert inward_share(hall, np.array(hall.cameras[0].position)) == 1.0


@pytest.mark.parametrize("detail", [60_000, 150_000, 500_000])
def test_triangle_budget(detail: int) -> None:
    scene = make_hall(detail)
    assert abs(scene.triangle_count - detail) <= 0.01 * detail
    assert 0.25 <= scene.features.slanted <= 0.40


def test_same_seed_same_bytes_other_seed_other_scene(hall: Scene) -> None:
    assert content_digest(make_hall()) == hall.content_hash
    assert make_hall(seed=1).content_hash != hall.content_hash


def test_impossible_detail_is_refused() -> None:
    with pytest.raises(SceneError, match="triangles"):
        make_hall(detail=12)


@given(st.floats(0.01, 3), st.floats(0.01, 3), st.integers(3, 24))
@settings(max_examples=20, deadline=None)
def test_cylinders_are_closed_and_face_outwards(radius: float, height: float, segments: int) -> None:
    part = builder.cylinder(radius, height, segments, 0)
    a, b, c = (part.positions[part.indices[:, k]].astype(np.float64) for k in range(3))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6
    exact = segments / 2 * np.sin(2 * np.pi / segments) * radius**2 * height
    assert volume == pytest.approx(exact, rel=1e-3)


@given(st.lists(st.tuples(*[st.floats(-5, 5)] * 3), min_size=2, max_size=6, unique=True), st.integers(3, 9))
@settings(max_examples=20, deadline=None)
def test_tubes_keep_their_radius(points: list, sides: int) -> None:
    line = np.array(points)
    if np.linalg.norm(np.diff(line, axis=0), axis=1).min() < 0.05:
        return
    gradient = np.gradient(line, axis=0)
    if np.linalg.norm(gradient, axis=1).min() < 1e-3:
        return
    part = builder.tube(line, 0.1, sides, 0)
    away = np.linalg.norm(part.positions.reshape(len(line), sides + 1, 3) - line[:, None], axis=2)
    assert np.allclose(away, 0.1, atol=1e-4)


def test_textures_repeat_without_a_seam() -> None:
    """Neighbours across the border differ no more than neighbours inside."""
    for texels in (surfaces.brick(0)[0], surfaces.concrete(0), surfaces.cobbles(0)[0], surfaces.planks(0)):
        image = texels[..., :3].astype(np.float64)
        inside = np.abs(np.diff(image, axis=0)).mean(axis=(1, 2))
        seam = np.abs(image[0] - image[-1]).mean()
        assert seam <= inside.max() + 1


def test_text_is_legible() -> None:
    """The letter T has its bar on top and its stem in the middle."""
    letter = surfaces.text(["T"], 1)
    assert letter[0, :5].sum() == 5
    assert letter[1:7, 2].sum() == 6
    assert letter.sum() == 11
