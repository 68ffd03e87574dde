"""Shadow maps: a surface does not shadow itself, what is behind a blocker is dark, and maps see what they must."""

from types import SimpleNamespace

import numpy as np
import pytest

from shading_atlas_bench.kernels.shade.shadow import LARGE_SIZE, ShadowMaps, shadow_camera
from shading_atlas_bench.kernels.shade.shadow_lookup import shadow_visibility
from shading_atlas_bench.kernels.shade.tables import light_rows
from shading_atlas_bench.kernels.triangles import Triangles

LIT = 1 - 1e-9  # up to rounding


def light(kind, **changes):
    plain = {"colour": (1, 1, 1), "position": (0.0, 4.0, 0.0), "direction": (0.0, -1.0, 0.0), "cone": 60.0}
    return SimpleNamespace(kind=kind, shadows=True, **{**plain, **changes})


def floor(side, y=0.0):
    """A square of side 2 * `side` that faces up."""
    corners = np.array([[-1, 0, -1], [-1, 0, 1], [1, 0, 1], [1, 0, -1]], np.float32) * side
    corners += np.array([0, y, 0], np.float32)
    return corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32)


def triangles_of(device, *parts, flip=False):
    positions, indices, offset = [], [], 0
    for corners, faces in parts:
        positions.append(corners)
        indices.append((faces[:, ::-1] if flip else faces) + offset)
        offset += len(corners)
    count = sum(len(faces) for faces in indices)
    return Triangles.upload(device, np.concatenate(positions), np.concatenate(indices), np.zeros(count, np.uint8))


def lit(device, triangles, one, points, faces=(0.0, 1.0, 0.0), focus=(0.0, 0.0, 0.0), unit=1.0):
    """The share of a light that arrives at points with normals `faces`."""
    shadows = ShadowMaps.render(device, triangles, None, [one], np.array(focus), unit)
    row = light_rows([one], unit)[0].astype(np.float64)
    row[20:] = shadows.rows[0]
    to_light = -row[8:11] if one.kind == "directional" else row[4:7] - points
    to_light = np.broadcast_to(to_light / np.linalg.norm(to_light, axis=-1, keepdims=True), points.shape)
    return shadow_visibility(row, shadows.maps.get(), points, np.broadcast_to(faces, points.shape), to_light)


def on_the_floor(side, y=0.0, count=3000):
    points = np.random.default_rng(0).uniform(-side, side, (count, 3))
    points[:, 1] = y
    return points


@pytest.mark.parametrize("degrees", [0, 30, 60, 80, 85])
@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_a_plane_in_the_sun_does_not_shadow_itself(device, degrees, turn):
    tilt = np.radians(degrees)
    direction = (np.sin(tilt) * np.cos(turn), -np.cos(tilt), np.sin(tilt) * np.sin(turn))
    sun = light("directional", direction=direction)
    assert lit(device, triangles_of(device, floor(9)), sun, on_the_floor(8.9)).min() > LIT


@pytest.mark.parametrize("lean", [0.0, 0.5, 1.5])
def test_a_plane_under_a_lamp_does_not_shadow_itself(device, lean):
    lamp = light("spot", direction=(lean, -1.0, 0.3 * lean))
    assert lit(device, triangles_of(device, floor(9)), lamp, on_the_floor(8.9)).min() > LIT


@pytest.mark.parametrize("kind", ["directional", "spot"])
@pytest.mark.parametrize("flip", [False, True])
def test_behind_a_blocker_it_is_dark_whichever_way_the_blocker_faces(device, kind, flip):
    triangles = triangles_of(device, floor(6), floor(1, y=1.0), flip=flip)
    points = on_the_floor(6)
    share = lit(device, triangles, light(kind), points)
    edge = np.abs(points).max(axis=1) - (1.0 if kind == "directional" else 4 / 3)
    assert (share[edge < -0.1] == 0).all()
    assert (share[edge > 0.1] > LIT).all()


def test_shadows_start_close_to_their_caster(device):
    """A wall's shadow begins within 5 cm of its foot."""
    wall = np.array([[0, 0, -5], [0, 0, 5], [0, 2, 5], [0, 2, -5]], np.float32), np.array([[0, 1, 2], [0, 2, 3]])
    triangles = triangles_of(device, floor(6), wall)
    points = np.array([[0.05, 0, z] for z in np.linspace(-4, 4, 200)])
    sun = light("directional", direction=(0.5, -1.0, 0.1))
    assert lit(device, triangles, sun, points).max() < 0.5
    assert lit(device, triangles, sun, points * [-1, 1, 1]).min() > LIT


def test_large_scenes_have_sharp_shadows_around_the_focus_only(device):
    triangles = triangles_of(device, floor(1000), floor(1, y=1.0))
    camera = shadow_camera(light("directional"), triangles, np.array([400.0, 0, 300.0]), 1.0)
    assert camera.size == LARGE_SIZE
    assert camera.texel[0] == pytest.approx(0.03)
    centre = camera.view @ [400.0, 0, 300.0, 1]
    np.testing.assert_allclose(centre[:2], 0, atol=1e-9)
    points = on_the_floor(0.5)
    assert lit(device, triangles, light("directional"), points).max() == 0
    assert lit(device, triangles, light("directional"), points, focus=np.array([500.0, 0, 0])).min() > LIT


def test_lights_without_shadows_have_no_map(device):
    triangles = triangles_of(device, floor(1))
    silent = light("directional")
    silent.shadows = False
    maps = ShadowMaps.render(device, triangles, None, [silent, light("point")], np.zeros(3), 1.0)
    assert not maps.rows.any()
    assert maps.maps.size == 1
