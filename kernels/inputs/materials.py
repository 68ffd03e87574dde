"""Materials, textures, lights and a sky, with the fields that kernels read of a scene's."""

from __future__ import annotations

from dataclasses import dataclass

from shading_atlas_bench.arithmetic.arrays import Bytes


@dataclass
class Material:
    """A metallic-roughness material; colours are linear RGB, textures are indices or -1."""

    base_colour: tuple[float, float, float, float] = (0.7, 0.6, 0.5, 1.0)
    base_texture: int = -1
    normal_texture: int = -1
    normal_scale: float = 1.0
    normal_uv: int = 0
    emissive: tuple[float, float, float] = (0.0, 0.0, 0.0)
    emissive_texture: int = -1
    emissive_uv: int = 0
    roughness: float = 1.0
    metallic: float = 0.0
    surface_texture: int = -1
    surface_uv: int = 0
    occlusion_texture: int = -1
    occlusion_strength: float = 1.0
    occlusion_uv: int = 0
    unlit: bool = False
    double_sided: bool = False
    alpha_mode: str = "opaque"
    alpha_cutoff: float = 0.5
    transmission: float = 0.0


@dataclass
class Texture:
    """Texels uint8 (H, W, 4), row 0 at v = 0."""

    texels: Bytes
    srgb: bool = True
    wrap_s: str = "repeat"
    wrap_t: str = "repeat"


@dataclass
class Light:
    """A light of some kind: "directional", "point" or "spot"; `cone` in degrees."""

    kind: str
    colour: tuple[float, float, float] = (2.0, 1.8, 1.5)
    position: tuple[float, float, float] = (1.0, 3.0, 1.0)
    direction: tuple[float, float, float] = (0.2, -1.0, 0.1)
    cone: float = 50.0


@dataclass
class Sky:
    """Linear RGB radiance from straight up, the horizon and below."""

    zenith: tuple[float, float, float] = (0.3, 0.4, 0.7)
    horizon: tuple[float, float, float] = (0.6, 0.6, 0.5)
    ground: tuple[float, float, float] = (0.2, 0.15, 0.1)
