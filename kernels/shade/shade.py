"""The shading function's twin: what shade.cl computes, in float64."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Array, Bytes, Doubles, Floats, Ints
from shading_atlas_bench.kernels.constants import constants_of
from shading_atlas_bench.kernels.shade.colour import encode, shown_as, sky_irradiance, sky_radiance
from shading_atlas_bench.kernels.shade.environment import look_up, map_share
from shading_atlas_bench.kernels.shade.faces import uv_scale_twin
from shading_atlas_bench.kernels.shade.shadow_lookup import shadow_visibility
from shading_atlas_bench.kernels.shade.tables import KINDS, Tables
from shading_atlas_bench.kernels.texture.sample import trilinear

if TYPE_CHECKING:
    from shading_atlas_bench.kernels.texture.buffers import TextureBuffers

DEFINED = constants_of(Path(__file__).with_name("shade.cl"))
IN_PLANE = DEFINED.number("IN_PLANE")


@dataclass(frozen=True)
class Points:
    """Samples with what their triangles say about them, float64.

    position: (n, 3). normal, face: (n, 3), unit vectors, of the vertices and of the triangle. uvs: (S, n, 2) and
    footprints: (S, n), in texture space, of the UVs and of each further set. extra: (n, 8 or 16) and material: (n, 24),
    rows of the tables, see Tables. surface: (n, 2), roughness and metalness. open: (n, 1), the share of the light from
    all around that arrives.
    """

    position: Doubles
    normal: Doubles
    face: Doubles
    uvs: Doubles
    extra: Doubles
    material: Doubles
    footprints: Doubles
    surface: Doubles
    open: Doubles


def shade_twin(
    tables: Tables,
    faces: Ints,
    textures: TextureBuffers,
    shadow_maps: Floats,
    triangle: Array,
    bary: Array,
    footprint: Array,
    eye: Array,
) -> Bytes:
    """uint8 (n, 4), sRGB and alpha 255, of n samples: triangle int (n), bary (n, 2), footprint (n), eye (3).

    faces: int32 (T, 2), material and bits of the UV scale. shadow_maps: float32, all maps one after the other.
    """
    radiance = shaded_twin(tables, faces, textures, shadow_maps, triangle, bary, footprint, eye)
    return encode(radiance * tables.environment[9])


def shaded_twin(
    tables: Tables,
    faces: Ints,
    textures: TextureBuffers,
    shadow_maps: Floats,
    triangle: Array,
    bary: Array,
    footprint: Array,
    eye: Array,
) -> Doubles:
    """What shadeN returns: radiance (n, 3) of the samples, given as for `shade_twin`."""
    points = _interpolated(tables, faces, triangle, np.asarray(bary, np.float64), footprint)
    if tables.defines["SURFACE_MAPS"] or tables.defines["OCCLUSION"]:
        points = _mapped(textures, points)
    towards = np.asarray(eye, np.float32) - points.position
    n, smooth = _shading_normals(tables, textures, points, towards)
    albedo = points.material[:, :3].copy()
    if tables.defines["VERTEX_COLOURS"]:
        albedo *= points.extra[:, 4:7]
    albedo *= _texture(textures, points, points.material[:, 3])
    specular = tables.defines["SPECULAR"]
    diffuse = sky_irradiance(tables.environment, n[:, 1]) * points.open
    out = _reflection(tables, points, albedo, n, towards) if specular else 0.0
    for light in tables.lights.astype(np.float64):
        to_light, arriving = _incident(light, points.position)
        arriving = arriving * np.maximum(_dot(n, to_light), 0)
        arriving = arriving * shadow_visibility(light, shadow_maps, points.position, smooth, to_light)
        irradiance = arriving[:, None] * light[16:19]
        diffuse = diffuse + irradiance / np.pi
        if specular:
            out = out + irradiance * _ggx(points, albedo, n, _unit(towards, n), to_light)
    metallic = points.surface[:, 1:] if specular else 0.0
    out = out + albedo * diffuse * (1 - metallic)
    if tables.defines["EMISSIVE"]:
        out = out + points.material[:, 8:11] * _texture(
            textures, points, points.material[:, 11], points.material[:, 21]
        )
    if tables.defines["UNLIT"]:
        shown = shown_as(albedo, float(tables.environment[9]))
        out = np.where(points.material[:, 19:20] > 0, shown, out)
    return out


def _interpolated(tables: Tables, faces: Ints, triangle: Array, bary: Doubles, footprint: Array) -> Points:
    corners = tables.vertices[tables.indices[triangle]].astype(np.float64)
    weights = np.stack([1 - bary.sum(axis=1), bary[:, 0], bary[:, 1]], axis=1)
    rows = np.einsum("ni,nif->nf", weights, corners)
    upright = np.broadcast_to([0.0, 1.0, 0.0], (len(rows), 3))
    sides = corners[:, 1:, :3] - corners[:, :1, :3]
    face = _unit(np.cross(sides[:, 0], sides[:, 1]), upright)
    extra = np.zeros((len(rows), 16))
    if len(tables.extras):
        extra = np.einsum("ni,nif->nf", weights, tables.extras[tables.indices[triangle]].astype(np.float64))
    scales = [faces[triangle, 1].view(np.float32).astype(np.float64), *_further_scales(tables, triangle)]
    material = tables.materials.astype(np.float64)[faces[triangle, 0]]
    return Points(
        rows[:, :3],
        _unit(rows[:, 3:6], face),
        face,
        np.stack([rows[:, 6:8], *(extra[:, 6 + 2 * i : 8 + 2 * i] for i in range(1, len(scales)))]),
        extra,
        material,
        np.stack([footprint * scale for scale in scales]),
        material[:, 4:6],
        np.ones((len(rows), 1)),
    )


def _further_scales(tables: Tables, triangle: Array) -> list[Doubles]:
    """UV scales (n) of triangles in each further set of UVs."""
    used, place = np.unique(triangle, return_inverse=True)
    scales = []
    for number in range(tables.defines["FURTHER_UVS"]):
        uvs = tables.extras[:, 8 + 2 * number : 10 + 2 * number]
        rows = np.concatenate([tables.vertices[:, :6], uvs], axis=1)
        scales.append(uv_scale_twin(rows, tables.indices[used])[place.reshape(-1)])
    return scales


def _mapped(textures: TextureBuffers, points: Points) -> Points:
    """The points with what their textures say of roughness, metalness and occlusion."""
    material = points.material
    surface = material[:, 4:6] * _texture(textures, points, material[:, 16], material[:, 22])[:, 1:3]
    seen = _texture(textures, points, material[:, 17], material[:, 23])[:, :1]
    return replace(points, surface=surface, open=1 + material[:, 18:19] * (seen - 1))


def _dot(a: Doubles, b: Doubles) -> Doubles:
    sums: Doubles = (a * b).sum(axis=-1)
    return sums


def _unit(a: Doubles, otherwise: Doubles) -> Doubles:
    """a of length 1; `otherwise` where it has none."""
    largest = np.abs(a).max(axis=1)
    usable = (largest > 0) & (largest < 1e30)
    scaled = np.where(usable[:, None], a, otherwise) / np.where(usable, largest, 1)[:, None]
    return np.where(usable[:, None], scaled / np.linalg.norm(scaled, axis=1, keepdims=True), otherwise)


def _texture(textures: TextureBuffers, points: Points, texture: Doubles, uv_set: Doubles | None = None) -> Doubles:
    """Linear RGB (n, 3) of the points' textures (n), looked up in their sets of UVs (n), the first by default."""
    chosen = np.zeros(len(texture), int) if uv_set is None else uv_set.astype(int)
    each = np.arange(len(texture))
    uv, footprint = points.uvs[chosen, each], points.footprints[chosen, each]
    return trilinear(textures, texture.astype(int), uv[:, 0], uv[:, 1], footprint)[:, :3]


def _shading_normals(
    tables: Tables, textures: TextureBuffers, points: Points, towards: Doubles
) -> tuple[Doubles, Doubles]:
    """The normal (n, 3) to shade with, and the one without the normal map, on the side that is seen."""
    n = points.normal
    if tables.defines["NORMAL_MAPS"]:
        tangent, sign = points.extra[:, :3], points.extra[:, 3:4]
        texel = _texture(textures, points, points.material[:, 12], points.material[:, 20])
        x, y, z = (2 * texel - 1).T[..., None]
        scale = points.material[:, 13:14]
        bump = x * scale * tangent + y * scale * sign * np.cross(n, tangent) + z * n
        n = np.where(points.material[:, 12:13] > 0, _unit(bump, n), n)
    away = (points.material[:, 6] > 0) & (_dot(points.face, towards) < 0)
    away &= np.abs(_dot(points.normal, points.face)) > IN_PLANE
    side = np.where(away, -1, 1)[:, None]
    return n * side, points.normal * side


def _incident(light: Doubles, position: Doubles) -> tuple[Doubles, Doubles]:
    """Direction to the light (n, 3) and the share of its colour that arrives (n), before cosine and shadow."""
    if light[0] == KINDS["directional"]:
        return np.broadcast_to(-light[8:11], position.shape), np.ones(len(position))
    d = light[4:7] - position
    squared = _dot(d, d)
    to_light = d / np.sqrt(np.maximum(squared, 1e-12))[:, None]
    arriving = 1 / np.maximum(squared * light[11], 1e-4)
    if light[0] == KINDS["spot"]:
        fade = np.clip((-to_light @ light[8:11] - light[12]) * light[13], 0, 1)
        arriving = arriving * fade**2 * (3 - 2 * fade)
    return to_light, arriving


def _ggx(points: Points, albedo: Doubles, n: Doubles, v: Doubles, to_light: Doubles) -> Doubles:
    """The specular BRDF (n, 3): GGX, Hammon's masking, Schlick's Fresnel."""
    alpha = np.maximum(points.surface[:, 0], 0.05) ** 2
    metallic = points.surface[:, 1:]
    nl, nv = np.maximum(_dot(n, to_light), 0), np.maximum(_dot(n, v), 1e-3)
    h = _unit(v + to_light, n)
    nh, vh = np.maximum(_dot(n, h), 0), np.maximum(_dot(v, h), 0)
    across = np.cross(n, h)
    d = alpha**2 / np.pi / ((nh * alpha) ** 2 + _dot(across, across)) ** 2
    masking = 0.5 / (2 * nl * nv * (1 - alpha) + (nl + nv) * alpha + 1e-6)
    f0 = 0.04 * (1 - metallic) + metallic * albedo
    fresnel = f0 + (1 - f0) * ((1 - vh) ** 5)[:, None]
    reflected: Doubles = (d * masking)[:, None] * fresnel
    return reflected


def _reflection(tables: Tables, points: Points, albedo: Doubles, n: Doubles, towards: Doubles) -> Doubles:
    """What the surface reflects from all around (n, 3), blurred by roughness, with Karis' environment BRDF."""
    rough, metallic = np.maximum(points.surface[:, :1], 0.05), points.surface[:, 1:]
    v = _unit(towards, n)
    nv = np.maximum(_dot(n, v), 1e-3)
    a = np.minimum((1 - rough) ** 2, 2.0 ** (-9.28 * nv[:, None])) * (1 - rough) + 0.0425 - 0.0275 * rough
    weight, rest = 1.04 - 1.04 * a - 0.572 * rough, 1.04 * a + 0.022 * rough - 0.04
    f0 = 0.04 * (1 - metallic) + metallic * albedo
    direction = 2 * nv[:, None] * n - v
    blurred = sky_irradiance(tables.environment, n[:, 1])
    around = sky_radiance(tables.environment, direction[:, 1]) * (1 - rough) + blurred * rough
    if tables.defines["ENVIRONMENT_MAP"]:
        share = map_share(rough)
        around = around * (1 - share) + look_up(tables.environment_map, direction, rough[:, 0]) * share
    reflected: Doubles = around * points.open * (f0 * weight + rest)
    return reflected
