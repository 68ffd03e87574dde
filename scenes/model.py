"""The one scene model that loaders and procedural scenes fill and everything else reads."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from shading_atlas_bench.arithmetic.arrays import Bytes, Doubles, Floats, Ints
from shading_atlas_bench.errors import BenchError

Indices: TypeAlias = NDArray[np.integer[Any]]  # of any width: NumPy's own are as wide as an address


class SceneError(BenchError, ValueError):
    """A scene that cannot be used; the message is one sentence: what is wrong, where, what to do."""


@dataclass
class Texture:
    """An image for sampling.

    texels: uint8 (H, W, 4); row 0 is v = 0 as glTF defines it (top of the image). RGB is sRGB-encoded when `srgb`,
        linear otherwise; A is linear coverage.
    wrap_s, wrap_t: "repeat", "clamp" or "mirror".
    """

    name: str
    texels: Bytes
    srgb: bool = True
    wrap_s: str = "repeat"
    wrap_t: str = "repeat"


SLOTS = ("base", "normal", "emissive", "surface", "occlusion")  # of a material's textures


@dataclass
class Material:
    """A glTF-like metallic-roughness material; colours are linear RGB, textures are indices or -1.

    A texture's `_uv` says which UVs it is looked up at: 0 `Scene.uvs`, k `Scene.further_uvs[k - 1]`; the base texture's
    are always 0.
    surface_texture: its green multiplies `roughness`, its blue `metallic`. occlusion_texture: its red is the share of
        the light from all around that arrives; of it `occlusion_strength` counts (0..1).
    alpha_mode: "opaque", "mask" (drawn where the alpha of base colour times texture times vertices >= alpha_cutoff) or
        "blend" (by the same alpha).
    unlit: base colour times texture times vertex colour is what is seen, whatever the light and the exposure.
    transmission: share of light let through (KHR_materials_transmission); such materials count as "blend" later on.
    """

    name: str = ""
    base_colour: tuple[float, float, float, float] = (0.8, 0.8, 0.8, 1.0)
    base_texture: int = -1
    normal_texture: int = -1
    normal_scale: float = 1.0
    emissive: tuple[float, float, float] = (0.0, 0.0, 0.0)
    emissive_texture: int = -1
    roughness: float = 1.0
    metallic: float = 0.0
    alpha_mode: str = "opaque"
    alpha_cutoff: float = 0.5
    double_sided: bool = False
    transmission: float = 0.0
    unlit: bool = False
    surface_texture: int = -1
    occlusion_texture: int = -1
    occlusion_strength: float = 1.0
    normal_uv: int = 0
    emissive_uv: int = 0
    surface_uv: int = 0
    occlusion_uv: int = 0

    @property
    def textures(self) -> dict[str, int]:
        """The textures that it has, by the names of its slots: "base", "normal", "emissive", "surface", "occlusion"."""
        slots = {name: getattr(self, f"{name}_texture") for name in SLOTS}
        return {name: texture for name, texture in slots.items() if texture >= 0}

    def uv_of(self, slot: str) -> int:
        """Which UVs the texture in a slot is looked up at."""
        return 0 if slot == "base" else getattr(self, f"{slot}_uv")

    def without(self, slots: Iterable[str]) -> Material:
        """The material without the textures in some slots; a glow that a texture shaped goes with it."""
        none: dict[str, Any] = {f"{slot}_texture": -1 for slot in slots}
        bare = replace(self, **none)
        return replace(bare, emissive=(0.0, 0.0, 0.0)) if "emissive" in slots else bare


@dataclass
class Light:
    """A light, in the same origin-relative space as the positions.

    kind: "directional" (colour = irradiance on a facing surface, linear RGB), "point" or "spot" (colour = intensity:
        irradiance is colour / distance^2, distance in metres). Directions are where the light goes.
    cone: half angle in degrees where a spot has faded out; it starts to fade at 0.8 of it.
    shadows: whether one shadow map is rendered for it (directional and spot only).
    """

    kind: str
    colour: tuple[float, float, float]
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    direction: tuple[float, float, float] = (0.0, -1.0, 0.0)
    cone: float = 60.0
    shadows: bool = True


@dataclass
class Sky:
    """Environment light and background: linear RGB radiance from straight up, the horizon and below."""

    zenith: tuple[float, float, float] = (0.30, 0.42, 0.65)
    horizon: tuple[float, float, float] = (0.60, 0.65, 0.70)
    ground: tuple[float, float, float] = (0.22, 0.20, 0.18)


@dataclass
class Camera:
    """A camera that came with the scene: position and axes in origin-relative space, field of view in degrees."""

    position: tuple[float, float, float]
    direction: tuple[float, float, float]
    up: tuple[float, float, float] = (0.0, 1.0, 0.0)
    fov_x: float | None = None
    name: str = ""


@dataclass
class CameraAnimation:
    """An animated camera of the file.

    times: float64 (N), milliseconds, from 0. positions: float64 (N, 3), in scene units, relative to the scene's origin.
    orientations: float64 (N, 4), quaternions x, y, z, w, camera to world.
    """

    name: str
    times: Doubles
    positions: Doubles
    orientations: Doubles


@dataclass
class Features:
    """What a scene has, found once; it decides which kernels are built and which stages run.

    glossy: materials that are somewhere smoother than features.MATT. surface_maps: textures of roughness and metalness.
    further_uvs: textures with UVs other than their base texture's.
    blend: blended or transmissive materials. varying_opacity: some of these do not cover the same everywhere.
    slanted: share of triangles whose longest edge is over 3 heights; largest: share of all area in the largest 1%.
    """

    textures: bool = False
    normal_maps: bool = False
    vertex_colours: bool = False
    mask: bool = False
    blend: bool = False
    varying_opacity: bool = False
    shadows: bool = False
    specular: bool = False
    glossy: bool = False
    emissive: bool = False
    surface_maps: bool = False
    occlusion: bool = False
    unlit: bool = False
    further_uvs: bool = False
    single_sided: bool = False
    slanted: float = 0.0
    largest: float = 0.0


@dataclass
class Scene:
    """Triangles, materials, textures, lights and cameras. Linear colour; right-handed; y is up.

    name: what reports call it. content_hash: as from features.content_digest.
    origin: float64 (3); true position = origin + positions.
    positions: float32 (V, 3). indices: int32 (T, 3); a triangle's id is its row. Front faces are counter-clockwise.
    normals: float32 (V, 3), unit. uvs: float32 (V, 2). colours: float32 (V, 4), linear, white where a file has none.
    further_uvs: float32 (S, V, 2), sets of UVs of textures that do not use `uvs`, or None where all do.
    tangents: float32 (V, 4) with the bitangent's sign in w, or None where no normal map needs them.
    material_ids: int32 (T).
    metres_per_unit: scale of the positions. unit_from: who says so.
    notes: sentences for the report: repairs made, things the file has that are not supported.
    place: whether a person can walk in it (walk); objects are orbited instead. because: why a file's is.
    route: float64 (N, 3), floor points of a walk designed with the scene, origin-relative; None where there is none.
    """

    name: str
    positions: Floats
    indices: Ints
    normals: Floats
    uvs: Floats
    colours: Floats
    material_ids: Ints
    materials: list[Material]
    textures: list[Texture] = field(default_factory=list)
    tangents: Floats | None = None
    further_uvs: Floats | None = None
    lights: list[Light] = field(default_factory=list)
    sky: Sky = field(default_factory=Sky)
    exposure: float = 1.0
    origin: Doubles = field(default_factory=lambda: np.zeros(3))
    metres_per_unit: float = 1.0
    unit_from: str = "made in metres"
    cameras: list[Camera] = field(default_factory=list)
    animations: list[CameraAnimation] = field(default_factory=list)
    place: bool = True
    because: str = ""
    route: Doubles | None = None
    features: Features = field(default_factory=Features)
    notes: list[str] = field(default_factory=list)
    content_hash: str = ""

    @property
    def triangle_count(self) -> int:
        """How many triangles it has."""
        return len(self.indices)

    @property
    def bounds(self) -> tuple[Doubles, Doubles]:
        """Lowest and highest corner of all positions, float64 (3) each, origin-relative."""
        columns = self.positions.T  # each by itself: over the first axis NumPy takes ten times as long
        low, high = ([float(pick(column)) for column in columns] for pick in (np.min, np.max))
        return np.array(low), np.array(high)
