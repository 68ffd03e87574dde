"""The tables that the shading function reads: vertices, materials, lights and environment as rows of floats."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Floats, Ints
from shading_atlas_bench.arithmetic.functions import cos
from shading_atlas_bench.kernels.constants import constants_of

MATERIAL_FLOATS = 24
MOST_FURTHER_UVS = 4  # one for each kind of texture beside the base colour's
DEFINED = constants_of(Path(__file__).with_name("light.cl"))
LIGHT_FLOATS = DEFINED.whole("LIGHT_FLOATS")
KINDS = {"directional": 0, "point": 1, "spot": 2}
FADE_START = 0.8  # of a spot's cone: there it starts to fade


class MaterialLike(Protocol):
    """The fields of a metallic-roughness material that shading reads; linear colours, texture indices or -1. The `_uv`
    of a texture is 0 for the surface's UVs, or 1 + the number of a further set."""

    base_colour: tuple[float, float, float, float]
    base_texture: int
    normal_texture: int
    normal_scale: float
    normal_uv: int
    emissive: tuple[float, float, float]
    emissive_texture: int
    emissive_uv: int
    roughness: float
    metallic: float
    surface_texture: int
    surface_uv: int
    occlusion_texture: int
    occlusion_strength: float
    occlusion_uv: int
    double_sided: bool
    unlit: bool


class LightLike(Protocol):
    """The fields of a light that shading reads; directions are where the light goes, `cone` in degrees."""

    kind: str
    colour: tuple[float, float, float]
    position: tuple[float, float, float]
    direction: tuple[float, float, float]
    cone: float


class SkyLike(Protocol):
    """Linear RGB radiance from straight up, the horizon and below."""

    zenith: tuple[float, float, float]
    horizon: tuple[float, float, float]
    ground: tuple[float, float, float]


@dataclass(frozen=True)
class Surface:
    """What shading needs to know of a scene's triangles, host arrays.

    normals float32 (V, 3); uvs float32 (V, 2); material_ids int32 (T); colours float32 (V, 4), linear, or None where
    all are white; tangents float32 (V, 4), the bitangent's sign in w, or None where no normal map is used; further_uvs
    float32 (S, V, 2), S up to MOST_FURTHER_UVS, or None where all textures use `uvs`.
    """

    normals: Floats
    uvs: Floats
    material_ids: Ints
    materials: Sequence[MaterialLike]
    colours: Floats | None = None
    tangents: Floats | None = None
    further_uvs: Floats | None = None


@dataclass(frozen=True)
class Lighting:
    """Lights, sky and exposure; metres_per_unit turns distances to local lights into metres."""

    lights: Sequence[LightLike]
    sky: SkyLike
    exposure: float = 1.0
    metres_per_unit: float = 1.0


@dataclass(frozen=True)
class Tables:
    """The rows that kernel and twin both read, float32 unless said otherwise; layouts in this module.

    vertices (V, 8): position, normal, uv. extras (V, 8 or 16): tangent, colour, further UVs. indices int32 (T, 3).
    materials (M, 24).
    lights (L, 48). environment (10). defines: what is compiled in (see shade.cl). environment_map: see environment.py,
    of any shape where there is none.
    """

    vertices: Floats
    extras: Floats
    indices: Ints
    materials: Floats
    lights: Floats
    environment: Floats
    defines: dict[str, int] = field(default_factory=dict)
    environment_map: Floats = field(default_factory=lambda: np.zeros(1, np.float32))


def vertex_rows(positions: Floats, surface: Surface) -> Floats:
    """float32 (V, 8): position, of positions (V, 3), normal, texture coordinates."""
    rows = np.empty((len(positions), 8), np.float32)
    columns = [column for part in (positions, surface.normals, surface.uvs) for column in part.T]
    for number, column in enumerate(columns):  # one by one NumPy copies four times as fast as row by row
        rows[:, number] = column
    return rows


def extra_rows(surface: Surface) -> Floats:
    """float32 (V, 8): tangent and colour, defaults where only one of them is used; (0, 8) without either. With further
    UVs (V, 16), these from 8 on."""
    further = surface.further_uvs
    if surface.colours is None and surface.tangents is None and further is None:
        return np.zeros((0, 8), np.float32)
    rows = np.ones((len(surface.normals), 8 if further is None else 16), np.float32)
    if surface.tangents is not None:
        rows[:, :4] = surface.tangents
    if surface.colours is not None:
        rows[:, 4:8] = surface.colours
    for number, uvs in enumerate(() if further is None else further):
        rows[:, 8 + 2 * number : 10 + 2 * number] = uvs
    return rows


def material_rows(materials: Sequence[MaterialLike]) -> Floats:
    """float32 (M, 24): base colour, base texture, roughness, metallic, double-sided, 0, emissive colour and texture,
    normal texture and scale, 0, 0, texture of roughness and metalness, occlusion texture and strength, unlit, UV sets
    of the textures of normals, emission, roughness and metalness, occlusion. Texture numbers are entries of the
    texture table, 0 being white."""
    rows = np.zeros((len(materials), MATERIAL_FLOATS), np.float32)
    for row, m in zip(rows, materials, strict=True):
        row[:8] = *m.base_colour[:3], m.base_texture + 1, m.roughness, m.metallic, m.double_sided, 0
        row[8:14] = *m.emissive, m.emissive_texture + 1, m.normal_texture + 1, m.normal_scale
        row[16:20] = m.surface_texture + 1, m.occlusion_texture + 1, m.occlusion_strength, m.unlit
        row[20:24] = m.normal_uv, m.emissive_uv, m.surface_uv, m.occlusion_uv
    return rows


def light_rows(lights: Sequence[LightLike], metres_per_unit: float) -> Floats:
    """float32 (L, 48): kind at 0, position at 4, direction at 8, falloff at 11, cone at 12, colour at 16; the shadow's
    part from 20 on is zero (layout in shadow_lookup.cl)."""
    rows = np.zeros((len(lights), LIGHT_FLOATS), np.float32)
    for row, light in zip(rows, lights, strict=True):
        direction = np.asarray(light.direction, np.float64)
        outer, inner = (cos(np.radians(light.cone * share)) for share in (1.0, FADE_START))
        row[0] = KINDS[light.kind]
        row[4:7] = light.position
        row[8:11] = direction / max(np.linalg.norm(direction, axis=-1), 1e-30)
        row[11] = metres_per_unit * metres_per_unit
        row[12:14] = outer, 1 / max(inner - outer, 1e-9)
        row[16:19] = light.colour
    return rows


def environment_row(sky: SkyLike, exposure: float) -> Floats:
    """float32 (10): zenith, horizon, ground, exposure."""
    return np.array([*sky.zenith, *sky.horizon, *sky.ground, exposure], np.float32)


def textures_of(material: MaterialLike) -> tuple[int, ...]:
    """The indices of a material's textures, -1 for those that it has not."""
    m = material
    return m.base_texture, m.normal_texture, m.emissive_texture, m.surface_texture, m.occlusion_texture


def needed(surface: Surface, lighting: Lighting, wraps: bool, shadows: bool) -> dict[str, int]:
    """What must be compiled into the shading function, as its defines."""
    materials = surface.materials
    return {
        "TEXTURES": int(any(max(textures_of(m)) >= 0 for m in materials)),
        "WRAP_MODES": int(wraps),
        "NORMAL_MAPS": int(surface.tangents is not None and any(m.normal_texture >= 0 for m in materials)),
        "VERTEX_COLOURS": int(surface.colours is not None),
        "SPECULAR": int(any(m.metallic > 0 or m.roughness < 1 or m.surface_texture >= 0 for m in materials)),
        "ENVIRONMENT_MAP": 0,  # Shader.reflecting
        "SURFACE_MAPS": int(any(m.surface_texture >= 0 for m in materials)),
        "OCCLUSION": int(any(m.occlusion_texture >= 0 for m in materials)),
        "UNLIT": int(any(m.unlit for m in materials)),
        "FURTHER_UVS": 0 if surface.further_uvs is None else len(surface.further_uvs),
        "EMISSIVE": int(any(max(m.emissive) > 0 for m in materials)),
        "DOUBLE_SIDED": int(any(m.double_sided for m in materials)),
        "LOCAL_LIGHTS": int(any(light.kind != "directional" for light in lighting.lights)),
        "SHADOWS": int(shadows),
        "LIGHTS": len(lighting.lights),
    }


def make_tables(
    positions: Floats, indices: Ints, surface: Surface, lighting: Lighting, wraps: bool, shadows: Floats
) -> Tables:
    """All rows of a scene.

    positions: float32 (V, 3). indices: int32 (T, 3). shadows: float32 (L, 28), the shadow part of each light's record.
    """
    lights = light_rows(lighting.lights, lighting.metres_per_unit)
    lights[:, 20:] = shadows
    return Tables(
        vertex_rows(positions, surface),
        extra_rows(surface),
        np.ascontiguousarray(indices, np.int32),
        material_rows(surface.materials),
        lights,
        environment_row(lighting.sky, lighting.exposure),
        needed(surface, lighting, wraps, bool(np.any(shadows[:, 17] > 0))),
    )
