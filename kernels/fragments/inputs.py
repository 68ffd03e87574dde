"""Scenes of glass triangles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Floats, Ints
from shading_atlas_bench.kernels.fragments.opacity import Opacity
from shading_atlas_bench.kernels.inputs.materials import Material, Texture
from shading_atlas_bench.kernels.shade.inputs import SKY
from shading_atlas_bench.kernels.shade.shader import Shader
from shading_atlas_bench.kernels.shade.tables import Lighting, Surface
from shading_atlas_bench.kernels.texture.buffers import TextureBuffers

if TYPE_CHECKING:
    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.kernels.triangles import Triangles


@dataclass(frozen=True)
class Glass:
    """A scene's materials and vertices, as BlendedScene has them.

    uvs: float32 (V, 2). colours: float32 (V, 4), linear. indices: int32 (T, 3). material_ids: int32 (T).
    """

    uvs: Floats
    colours: Floats
    indices: Ints
    material_ids: Ints
    materials: list[Material]
    textures: list[Texture]

    @classmethod
    def of(cls, rng: np.random.Generator, triangles: Triangles, textures: list[Texture]) -> Glass:
        """The triangles with random coordinates, colours and materials."""
        vertices = len(triangles.host_positions)
        return cls(
            rng.normal(0, 2, (vertices, 2)).astype(np.float32),
            rng.uniform(0.3, 1, (vertices, 4)).astype(np.float32),
            triangles.host_indices,
            rng.integers(0, 5, triangles.count).astype(np.int32),
            [
                Material(),
                Material(base_colour=(1, 1, 1, 0.6), base_texture=0, alpha_mode="blend"),
                Material(base_colour=(1, 1, 1, 0.5), alpha_mode="blend"),
                Material(base_colour=(1, 1, 1, 0.5), transmission=0.7),
                Material(base_colour=(1, 1, 1, 0.2), base_texture=0, alpha_mode="mask"),
            ],
            textures,
        )


def glass_opacity(device: Device, rng: np.random.Generator, triangles: Triangles) -> tuple[Opacity, Ints]:
    """What covers what in a scene of glass triangles, and the triangles' materials, int32 (T)."""
    texels = rng.integers(0, 256, (32, 48, 4)).astype(np.uint8)
    images = [Texture(texels, wrap_s="mirror", wrap_t="clamp")]
    textures, glass = TextureBuffers.upload(device, images), Glass.of(rng, triangles, images)
    ids = glass.material_ids
    normals = np.tile(np.array([0, 1, 0], np.float32), (len(glass.uvs), 1))
    surface = Surface(normals, glass.uvs, ids, glass.materials)
    shader = Shader(device, triangles, surface, Lighting([], SKY), textures)
    return Opacity.of_scene(triangles, shader, glass), ids
