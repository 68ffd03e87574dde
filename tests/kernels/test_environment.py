"""Environment maps: what is in their levels, how they are looked up, and what is captured of a scene."""

from __future__ import annotations

import hashlib

import numpy as np
import pytest

from shading_atlas_bench.kernels.device import Device
from shading_atlas_bench.kernels.inputs.materials import Material
from shading_atlas_bench.kernels.raster.rasteriser import Rasteriser
from shading_atlas_bench.kernels.samples import Samples
from shading_atlas_bench.kernels.shade.capture import BRIGHTEST, scene_around, sky_around
from shading_atlas_bench.kernels.shade.environment import (
    MATT,
    ROUGHNESSES,
    SIDE,
    SIZES,
    directions,
    environment_map,
    look_up,
    map_share,
)
from shading_atlas_bench.kernels.shade.inputs import EYE, LIGHTS, SKY, make_samples, make_shader
from shading_atlas_bench.kernels.shade.radiance import radiance
from shading_atlas_bench.kernels.shade.shader import Shader
from shading_atlas_bench.kernels.shade.tables import Lighting, Surface
from shading_atlas_bench.kernels.texture.buffers import TextureBuffers
from shading_atlas_bench.kernels.triangles import Triangles

SMOOTHEST = ROUGHNESSES[0]
GOLDEN = "c7a0b3cab279f263"  # of the map that random triangles give


def waves(direction: np.ndarray) -> np.ndarray:
    """Smooth radiance (n, 3), another in every direction."""
    x, y, z = direction.T
    return np.stack([1 + x, 1 + y * z, 2 + x * y - z * z], axis=-1)


def lamps(direction: np.ndarray) -> np.ndarray:
    """Radiance (n, 3) with edges: a bright cap about (0.6, 0.48, 0.64), and a ground."""
    near = direction @ [0.6, 0.48, 0.64] > 0.9
    return np.stack([9.0 * near, 1.0 * (direction[:, 1] < 0), near + 0.5], axis=-1)


@pytest.fixture(scope="module")
def lit() -> np.ndarray:
    return environment_map(lamps)


def level_of(texels: np.ndarray, level: int) -> np.ndarray:
    """A level's texels (SIDE, SIDE, 3) without their border."""
    return texels[1:-2, 1:-1, 3 * level : 3 * level + 3].astype(np.float64)


def test_a_constant_gives_the_constant_everywhere() -> None:
    texels = environment_map(lambda direction: np.full(direction.shape, 0.7))
    rng = np.random.default_rng(1)
    found = look_up(texels, rng.normal(size=(500, 3)), rng.uniform(0, 1, 500))
    np.testing.assert_allclose(found, 0.7, rtol=1e-6)


def test_the_first_level_is_what_is_seen() -> None:
    """Lookups are off by the curvature within a texel, which is up to 3 degrees wide, and by a quarter of the level's
    blur at the folds of the square."""
    direction = np.random.default_rng(2).normal(size=(2000, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    found = look_up(environment_map(waves), direction, np.full(2000, SMOOTHEST))
    np.testing.assert_allclose(found, waves(direction), atol=0.01)


@pytest.mark.parametrize("level", range(1, len(SIZES)))
def test_further_levels_are_integrals_over_ggx(lit: np.ndarray, level: int) -> None:
    """Against a finer sum over the sphere of the same integral, written with the half vector."""
    sources, angles = (part.reshape(256 * 256, -1) for part in directions(256))
    alpha = ROUGHNESSES[level] ** 2
    seen = lamps(sources)
    targets = directions(SIZES[level])[0].reshape(-1, 3)[:: SIZES[level] ** 2 // 7]
    found = look_up(lit, targets, np.full(len(targets), ROUGHNESSES[level]))
    for normal, value in zip(targets, found, strict=True):
        half = sources + normal
        half /= np.maximum(np.linalg.norm(half, axis=1, keepdims=True), 1e-9)
        spread = alpha**2 / (np.pi * ((half @ normal) ** 2 * (alpha**2 - 1) + 1) ** 2)
        weight = (spread * np.maximum(sources @ normal, 0))[:, None] * angles
        expected = (weight * seen).sum(axis=0) / weight.sum()
        np.testing.assert_allclose(value, expected, rtol=0.1, atol=0.05)


def test_levels_keep_the_energy(lit: np.ndarray) -> None:
    angles = directions(SIDE)[1][..., None]
    means = [(level_of(lit, level) * angles).sum(axis=(0, 1)) / angles.sum() for level in range(len(SIZES))]
    np.testing.assert_allclose(means[1:], np.tile(means[0], (len(SIZES) - 1, 1)), rtol=0.05)


def test_there_are_no_seams() -> None:
    """On both sides of the planes where the square is folded or ends, and around the point where its corners meet."""
    rng = np.random.default_rng(3)
    texels = environment_map(lambda direction: rng.random(direction.shape))
    roughness = rng.uniform(0, 0.9, 3000)
    for axis in range(3):
        above = rng.normal(size=(3000, 3))
        above[:, axis] = 1e-7
        below = above * np.where(np.arange(3) == axis, -1, 1)
        np.testing.assert_allclose(look_up(texels, above, roughness), look_up(texels, below, roughness), atol=1e-4)
    down = np.concatenate([rng.normal(0, 1e-7, (3000, 1)), np.full((3000, 1), -1), rng.normal(0, 1e-7, (3000, 1))], 1)
    for rough in (0.05, 0.3, 0.8):
        assert np.ptp(look_up(texels, down, np.full(3000, rough)), axis=0).max() < 1e-4


def test_roughness_is_continuous(lit: np.ndarray) -> None:
    steps = np.linspace(0, 1, 20_001)
    found = look_up(lit, np.tile([0.6, 0.48, 0.64], (len(steps), 1)), steps)
    assert np.abs(np.diff(found, axis=0)).max() < 0.005
    assert np.ptp(found[:, 0]) > 1


def test_the_map_gives_way_to_the_sky_without_a_step() -> None:
    share = map_share(np.linspace(0, 1, 1001))
    assert share[0] == 1
    assert share[-1] == 0
    assert np.abs(np.diff(share)).max() < 0.006


def colours(device: Device, shader: Shader) -> np.ndarray:
    samples = make_samples(device)
    target = device.zeros((1, samples.triangle.size, 4), np.uint8)
    shader.shade(samples, EYE, target)
    return target.get()


@pytest.mark.parametrize(("roughness", "changes"), [(0.3, True), (0.75, True), (MATT, False), (1.0, False)])
def test_a_map_changes_glossy_surfaces_only(device: Device, roughness: float, changes: bool) -> None:
    """To the byte: rough surfaces beside glossy ones look as they do in a scene without a map."""
    surfaces = [Material(roughness=roughness, metallic=0.5)]
    plain, mapped = (make_shader(device, surfaces, LIGHTS[:1], mirrors=mirrors) for mirrors in (False, True))
    assert (colours(device, plain) != colours(device, mapped)).any() == changes


def test_a_mirror_shows_the_map(device: Device) -> None:
    """A smooth metal floor, seen at 45 degrees: what comes from the other side, by white metal's reflectance."""
    corners = np.array([[-9, 0, -9], [-9, 0, 9], [9, 0, 0]], np.float32)
    shader = on_corners(device, corners, [Material(base_colour=(1,) * 4, roughness=0.0, metallic=1.0)])
    shader = shader.reflecting(environment_map(lambda direction: 1.0 + 0.5 * direction))
    eye = np.array([-1.0, 1.0, 0.0])
    found = radiance(shader, at_origin(device, corners), eye)[0]
    expected = 1 + 0.5 * np.array([1, 1, 0]) / np.sqrt(2)
    np.testing.assert_allclose(found, expected * 0.97, rtol=0.02)


def on_corners(device: Device, corners: np.ndarray, materials: list) -> Shader:
    """A shader of one triangle that faces up."""
    triangles = Triangles.upload(device, corners, np.array([[0, 1, 2]]), np.zeros(1, np.uint8))
    up = np.tile(np.array([0, 1, 0], np.float32), (3, 1))
    surface = Surface(up, np.zeros((3, 2), np.float32), np.zeros(1, np.int32), materials)
    return Shader(device, triangles, surface, Lighting([], SKY), TextureBuffers.upload(device, []))


def at_origin(device: Device, corners: np.ndarray) -> Samples:
    """One sample of the triangle, at the origin."""
    weights = np.linalg.solve(
        np.stack([corners[1] - corners[0], corners[2] - corners[0]], 1)[[0, 2]], -corners[0][[0, 2]]
    )
    one = (np.zeros(1, np.int32), weights[:1], weights[1:], np.zeros(1), np.zeros(1, np.int32))
    return Samples.upload(device, *one)


def captured(device: Device, materials: list, seen_from: np.ndarray) -> np.ndarray:
    """The map of the random triangles of the shading tests, from a point."""
    shader = make_shader(device, materials, LIGHTS[:2])
    flags = np.full(len(shader.tables.indices), Triangles.DOUBLE_SIDED, np.uint8)
    triangles = Triangles.upload(device, shader.tables.vertices[:, :3].copy(), shader.tables.indices, flags)
    return environment_map(scene_around(device, Rasteriser(device, triangles), None, shader, seen_from, 0.01))


def test_a_capture_has_golden_bytes(device: Device) -> None:
    """The same on every runtime and processor: after a change that is meant to change them, what is found belongs
    here."""
    texels = captured(device, [Material(roughness=0.4), Material(double_sided=True)], np.zeros(3))
    assert hashlib.blake2b(texels.tobytes(), digest_size=8).hexdigest() == GOLDEN


def test_a_capture_holds_the_scene_and_the_sky(device: Device) -> None:
    """From far away the triangles, of edges up to 6, fill less than a quarter of one half of the sky."""
    from_far = captured(device, [Material(base_colour=(0, 0, 0, 1))], np.array([0.0, 0.0, 40.0]))
    sky = environment_map(sky_around(make_shader(device, [Material()], [])))
    differs = (np.abs(level_of(from_far, 0) - level_of(sky, 0)) > 1e-6).any(axis=-1)
    towards = directions(SIDE)[0][..., 2] < -0.9
    assert differs[towards].any()
    assert not differs[~towards].any()


def test_black_metal_is_not_the_sky(device: Device) -> None:
    """Rough, it sends less than 0 by a thousandth, which is no mark of the sky."""
    corners = np.array([[-9, 0, -9], [-9, 0, 9], [9, 0, 0]], np.float32)
    triangles = Triangles.upload(device, corners, np.array([[0, 1, 2]]), np.zeros(1, np.uint8))
    down, above = np.array([[0.0, -1, 0]]), np.array([0.0, 1, 0])
    for colour in ((0.0, 0.0, 0.0, 1.0), (0.8, 0.0, 0.0, 1.0)):
        shader = on_corners(device, corners, [Material(base_colour=colour, roughness=1.0, metallic=1.0)])
        seen = scene_around(device, Rasteriser(device, triangles), None, shader, above, 0.01)(down)[0]
        np.testing.assert_array_equal(seen[1:], 0)


def test_what_glows_is_brighter_than_white_but_bounded(device: Device) -> None:
    lamp, furnace = (captured(device, [Material(emissive=(glow,) * 3)], np.zeros(3)) for glow in (5.0, 1e5))
    assert 5 < lamp.max() < 7
    assert furnace.max() == pytest.approx(BRIGHTEST / 0.7, rel=1e-6)
