"""Where environment maps are seen from, which scenes have one, and how much the hall depends on the view."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from shading_atlas_bench.harness.workload.environment import cached_environment_map, standpoint
from shading_atlas_bench.harness.workload.session import Session, open_session
from shading_atlas_bench.harness.workload.settings import Settings
from shading_atlas_bench.harness.workload.upload import upload_scene
from shading_atlas_bench.harness.workload.views import Pose, client_view
from shading_atlas_bench.kernels.device import Device
from shading_atlas_bench.kernels.shade.environment import MATT, SHAPE, look_up
from shading_atlas_bench.scenes import features
from shading_atlas_bench.scenes.features import find_features
from shading_atlas_bench.scenes.load import load_scene
from shading_atlas_bench.scenes.model import Camera, Material, Scene, Texture
from shading_atlas_bench.scenes.quaternions import looking

FLOOR = 1.5  # levels of 255, mean over the picture; with the sky in place of the map it is a sixth less
CORNERS = np.array([[-5, 0, -5], [-5, 4, 5], [5, 0, 5]], np.float32)
SCENE = Scene(
    "one triangle", CORNERS, np.array([[0, 1, 2]], np.int32), CORNERS, CORNERS[:, :2], np.ones((3, 4), np.float32),
    np.zeros(1, np.int32), [Material(roughness=0.3)], content_hash="a",
    cameras=[Camera((9.0, 1.0, 0.0), (1.0, 0.0, 0.0)), Camera((1.0, 2.0, 0.0), (1.0, 0.0, 0.0))],
)  # fmt: skip


@pytest.fixture(scope="module")
def hall() -> Session:
    return open_session(Settings(detail=40_000, width=320, height=180, frames=1, codec="none"))


def test_a_place_is_seen_from_its_route_or_from_a_camera_inside() -> None:
    route = np.array([[0, 0, 0], [1, 0.5, 0], [2, 0, 0]], np.float64)
    middle = standpoint(replace(SCENE, route=route, metres_per_unit=0.1))
    assert middle is not None
    np.testing.assert_allclose(middle, [1, 16.5, 0])
    np.testing.assert_array_equal(standpoint(SCENE), [1, 2, 0])
    assert standpoint(replace(SCENE, cameras=SCENE.cameras[:1])) is None
    assert standpoint(replace(SCENE, place=False)) is None


@pytest.mark.parametrize(
    "change", [{"content_hash": "b"}, {"place": False}, {"route": np.zeros((1, 3))}, {"cameras": []}], ids=str
)
def test_maps_are_drawn_once_for_each_scene(device: Device, tmp_path: Path, monkeypatch, change) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    drawn: list[np.ndarray] = []

    def draw() -> np.ndarray:
        drawn.append(np.full(SHAPE, len(drawn), np.float32))
        return drawn[-1]

    for scene, number in ((SCENE, 0), (replace(SCENE, **change), 1), (SCENE, 0)):
        np.testing.assert_array_equal(cached_environment_map(device, scene, draw), drawn[number])
    assert len(drawn) == 2
    cached_environment_map(device, replace(SCENE, content_hash=""), draw)
    assert len(drawn) == 3


@pytest.mark.parametrize(
    ("material", "glossy"),
    [
        (Material(roughness=0.79), True),
        (Material(roughness=0.8), False),
        (Material(roughness=1.0, surface_texture=0), True),
        (Material(roughness=1.0, surface_texture=1), False),
        (Material(roughness=0.1, unlit=True), False),
    ],
    ids=["smooth", "rough", "smooth in places", "rough everywhere", "unlit"],
)
def test_materials_decide(material: Material, glossy: bool) -> None:
    """Of textures the smoothest texel counts: 200 of 255 is 0.784, 210 is 0.824."""
    textures = [Texture("", np.full((2, 2, 4), 255, np.uint8), srgb=False) for _ in range(2)]
    for texture, smoothest in zip(textures, (200, 210), strict=True):
        texture.texels[1, 0, 1] = smoothest
    assert find_features(replace(SCENE, materials=[material], textures=textures)).glossy == glossy


def test_scenes_and_kernels_agree_on_what_is_matt() -> None:
    assert features.MATT == MATT


def test_a_scene_without_gloss_has_no_map(device: Device) -> None:
    scene = replace(SCENE, materials=[Material()], content_hash="")
    scene.features = find_features(scene)
    uploaded = upload_scene(device, scene)
    assert uploaded.shader.defines["ENVIRONMENT_MAP"] == 0
    assert "environment map" in uploaded.skips.always


def test_the_sky_does_not_shine_into_the_hall(hall: Session) -> None:
    """Upwards there are a dark roof and lamps, ahead of a person the walls; the sky is nowhere."""
    scene = hall.scene
    texels = scene.shader.tables.environment_map
    rng = np.random.default_rng(5)
    direction = rng.normal(size=(2000, 3))
    found = look_up(texels, direction, np.full(2000, 0.05))
    bare = upload_scene(hall.device, replace(scene.host, place=False, content_hash=""))
    sky = look_up(bare.shader.tables.environment_map, direction, np.full(2000, 0.05))
    assert (np.abs(found - sky) > 0.01).any(axis=1).mean() > 0.97
    assert found.max() > 2 > 1 > sky.max()


def test_an_object_reflects_the_sky_alone(device: Device) -> None:
    shells = load_scene("shells", detail=2_000)
    glossy = replace(shells, materials=[replace(m, roughness=0.2) for m in shells.materials], content_hash="")
    glossy.features = find_features(glossy)
    texels = upload_scene(device, glossy).shader.tables.environment_map
    up, down = look_up(texels, np.array([[0.0, 1, 0], [0, -1, 0]]), np.full(2, 0.05))
    np.testing.assert_allclose(up, glossy.sky.zenith, rtol=0.02)
    np.testing.assert_allclose(down, glossy.sky.ground, rtol=0.02)


def test_the_hall_depends_on_the_view(hall: Session) -> None:
    """Its floor, seen from the walk, as shaded for an eye 10 cm to the side."""
    eye = np.array([-7.0, 1.6, 0.0])
    gaze = np.array([1.0, -0.35, 0.0])
    view = client_view(Pose(eye, looking(gaze / np.linalg.norm(gaze), np.array([0, 1.0, 0]))), 60.0, 320, 180, 0.02)
    here, there = (
        hall.forward.draw(view, eye + shift)[0].rgb.get()[..., :3].astype(int) for shift in (np.zeros(3), [0, 0, 0.1])
    )
    assert np.abs(here - there).mean() > FLOOR
