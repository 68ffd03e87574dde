"""Surfaces, lights, textures, shadow maps and samples for the shading kernel."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Floats
from shading_atlas_bench.kernels.inputs.materials import Light, Material, Sky, Texture
from shading_atlas_bench.kernels.samples import Samples
from shading_atlas_bench.kernels.shade.environment import SHAPE
from shading_atlas_bench.kernels.shade.shader import Shader
from shading_atlas_bench.kernels.shade.shadow import ShadowCamera, ShadowMaps
from shading_atlas_bench.kernels.shade.tables import Lighting, Surface
from shading_atlas_bench.kernels.texture.buffers import TextureBuffers
from shading_atlas_bench.kernels.triangles import Triangles

if TYPE_CHECKING:
    from shading_atlas_bench.kernels.device import Device

TRIANGLES = 60
EYE = np.array([0.3, 1.7, 6.0])
SKY = Sky()

PLAIN = [Material()]
FULL = [
    Material(base_texture=0, normal_texture=2, roughness=0.4, double_sided=True),
    Material(base_texture=1, metallic=1.0, roughness=0.1, emissive=(0.1, 0.3, 0.2), emissive_texture=0),
    Material(double_sided=True, normal_texture=2, normal_scale=0.5, roughness=0.0),
    Material(surface_texture=3, metallic=0.8, occlusion_texture=3, occlusion_uv=2, normal_texture=2, normal_uv=1),
    Material(occlusion_texture=3, occlusion_strength=0.6, emissive=(0.2, 0.1, 0.1), emissive_texture=1, emissive_uv=2),
    Material(base_texture=1, unlit=True),
]
MAPPED = [Material(base_texture=0, surface_texture=3, metallic=1.0), Material(occlusion_texture=3)]
# Smooth enough for the map alone, half and half, and too rough for it.
GLOSSY = [Material(roughness=roughness, metallic=0.5) for roughness in (0.0, 0.2, 0.5, 0.7, 0.79, 0.8, 1.0)]
UNLIT = [Material(base_texture=0, unlit=True), Material()]
FURTHER = [
    Material(base_texture=0, emissive=(0.5, 0.6, 0.7), emissive_texture=1, emissive_uv=1),
    Material(occlusion_texture=3, occlusion_uv=2),
]
TEXTURED = [Material(base_texture=0), Material(base_texture=1)]
LIGHTS = [Light("directional"), Light("point", colour=(9.0, 8.0, 7.0)), Light("spot", colour=(30.0, 20.0, 10.0))]


def textures_of(rng: np.random.Generator, device: Device, wraps: bool) -> TextureBuffers:
    """Four textures of random texels, two of them sRGB. wraps: in different wrap modes, else all repeat."""
    modes = ["clamp", "mirror", "repeat", "repeat"] if wraps else ["repeat"] * 4
    sizes = [(64, 64), (19, 50), (32, 16), (24, 40)]
    images = []
    for i, (size, mode) in enumerate(zip(sizes, modes, strict=True)):
        texels = rng.integers(0, 256, (*size, 4), dtype=np.uint8)
        images.append(Texture(texels, i < 2, mode, modes[i - 1]))
    return TextureBuffers.upload(device, images)


def random_maps(rng: np.random.Generator, device: Device, lights: Sequence[Light]) -> ShadowMaps:
    """Shadow maps of smooth random depth for all lights but point lights."""
    rows = np.zeros((len(lights), 28), np.float32)
    maps, start = [], 0
    for row, one in zip(rows, lights, strict=True):
        if one.kind == "point":
            continue
        size = 128
        view = np.eye(4)
        view[:3, :3] = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])  # looks down
        view[:3, 3] = -view[:3, :3] @ [0, 8, 0]
        if one.kind == "spot":
            projection = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 0.5], [0, 0, -1, 0]])
            camera = ShadowCamera(view, projection, size, (0.0, 2 / size), (0.0, 2.0))
        else:
            projection = np.diag([1 / 5, 1 / 5, 1 / 16, 1.0])
            projection[2, 3] = 1
            camera = ShadowCamera(view, projection, size, (10 / size, 0.0), (1 / 16, 0.0))
        row[:] = camera.row(start)
        maps.append(
            rng.uniform(0.4, 0.6, size * size) if one.kind == "directional" else rng.uniform(0.04, 0.1, size**2)
        )
        start += size * size
    return ShadowMaps(device.upload(np.concatenate(maps).astype(np.float32)), rows)


def further_uvs(materials: Sequence[Material], count: int) -> Floats | None:
    """As many further sets of UVs as the materials use, float32 (S, count, 2); None if they use none."""
    sets = max(max(m.normal_uv, m.emissive_uv, m.surface_uv, m.occlusion_uv) for m in materials)
    return np.random.default_rng(9).uniform(-2, 2, (sets, count, 2)).astype(np.float32) if sets else None


def make_shader(
    device: Device,
    materials: Sequence[Material],
    lights: Sequence[Light],
    *,
    seed: int = 0,
    shadows: bool = False,
    colours: bool = False,
    wraps: bool = False,
    mirrors: bool = False,
    degenerate: bool = False,
) -> Shader:
    """A shader of random triangles. mirrors: with an environment map, of random texels."""
    rng = np.random.default_rng(seed)
    count = 3 * TRIANGLES
    positions = rng.uniform(-3, 3, (count, 3)).astype(np.float32)
    normals = rng.normal(size=(count, 3))
    normals = (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)
    # Corner normals near the first keep interpolated ones away from zero, where any direction would be right.
    normals.reshape(-1, 3, 3)[:, 1:] = normals[0::3, None] + 0.4 * normals.reshape(-1, 3, 3)[:, 1:]
    uvs = rng.uniform(-2, 2, (count, 2)).astype(np.float32)
    tangents = np.concatenate([rng.normal(size=(count, 3)), rng.choice([-1, 1], (count, 1))], axis=1)
    tangents[1::3], tangents[2::3] = tangents[0::3], tangents[0::3]
    if degenerate:
        normals[0:30] = 0
        positions[31:33] = positions[30]  # no area
        positions[33:36] = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0]])  # on a line
        uvs[36:48] = uvs[36]
        uvs[48:51], uvs[51:54], uvs[54:57] = np.nan, 3e9, -np.inf
        tangents[60:90] = 0
        positions[90:93] *= 1e-12
    indices = np.arange(count, dtype=np.int32).reshape(-1, 3)
    triangles = Triangles.upload(device, positions, indices, np.zeros(TRIANGLES, np.uint8))
    surface = Surface(
        normals,
        uvs,
        rng.integers(0, len(materials), TRIANGLES).astype(np.int32),
        materials,
        rng.random((count, 4)).astype(np.float32) if colours else None,
        tangents.astype(np.float32) if any(m.normal_texture >= 0 for m in materials) else None,
        further_uvs(materials, count),
    )
    maps = random_maps(rng, device, lights) if shadows else None
    lighting = Lighting(lights, SKY, exposure=0.7, metres_per_unit=1.3)
    shader = Shader(device, triangles, surface, lighting, textures_of(rng, device, wraps), maps)
    around = np.random.default_rng(7).uniform(0.2, 0.8, SHAPE).astype(np.float32)
    return shader.reflecting(around) if mirrors else shader


def make_samples(device: Device, count: int = 4000, seed: int = 1, adversarial: bool = False) -> Samples:
    """Random samples of the triangles of `make_shader`, with texels in random order.

    seed: odd for samples in the order of their triangles. adversarial: beyond their triangles, with footprints that are
    huge, not finite, 0 or negative.
    """
    rng = np.random.default_rng(seed)
    samples = Samples.allocate(device, count)
    room = samples.triangle.size
    ids = np.sort(rng.integers(0, TRIANGLES, room)) if seed % 2 else rng.integers(0, TRIANGLES, room)
    bary = rng.dirichlet((1, 1, 1), room)[:, :2]
    footprint = 10.0 ** rng.uniform(-3, 1, room)
    if adversarial:
        bary = rng.uniform(-1, 2, (room, 2))
        footprint = rng.choice([0.0, 1e-30, 1.0, 1e30, np.inf, np.nan, -1.0], room)
    ids[count:] = 2**30  # beyond the list: must not be read
    samples.triangle.set(ids.astype(np.int32))
    samples.bary1.set(bary[:, 0].astype(np.float32))
    samples.bary2.set(bary[:, 1].astype(np.float32))
    samples.footprint.set(footprint.astype(np.float32))
    samples.texel.set(rng.permutation(room).astype(np.int32))
    return samples


# Materials, lights, and what else `make_shader` is told.
CASES: dict[str, tuple[list[Material], list[Light], dict[str, bool]]] = {
    "plain": (PLAIN, LIGHTS[:1], {}),
    "no lights": (TEXTURED, [], {}),
    "wrap modes": (TEXTURED, LIGHTS[:1], {"wraps": True}),
    "local lights": (TEXTURED, LIGHTS, {"colours": True}),
    "shadows": (TEXTURED, LIGHTS, {"shadows": True}),
    "surface maps": (MAPPED, LIGHTS, {}),
    "unlit": (UNLIT, LIGHTS[:1], {"colours": True}),
    "further UVs": (FURTHER, LIGHTS[:1], {}),
    "environment map": (GLOSSY, LIGHTS[:1], {"mirrors": True}),
    "everything": (FULL, LIGHTS, {"shadows": True, "colours": True, "wraps": True, "mirrors": True}),
}
