"""Scenes of glass triangles."""

from types import SimpleNamespace

import numpy as np

from shading_atlas_bench.kernels.fragments.opacity import Opacity
from shading_atlas_bench.kernels.shade.inputs import SKY, material
from shading_atlas_bench.kernels.shade.shader import Shader
from shading_atlas_bench.kernels.shade.tables import Lighting, Surface
from shading_atlas_bench.kernels.texture.buffers import TextureBuffers


class Glass:
    """A scene's materials and vertices, as Opacity reads them."""

    def __init__(self, rng, triangles, textures):
        vertices = len(triangles.host_positions)
        self.indices, self.textures = triangles.host_indices, textures
        self.uvs = rng.normal(0, 2, (vertices, 2)).astype(np.float32)
        self.colours = rng.uniform(0.3, 1, (vertices, 4)).astype(np.float32)
        self.material_ids = rng.integers(0, 5, triangles.count).astype(np.int32)
        self.materials = [
            material(),
            material(base_colour=(1, 1, 1, 0.6), base_texture=0, alpha_mode="blend"),
            material(base_colour=(1, 1, 1, 0.5), alpha_mode="blend"),
            material(base_colour=(1, 1, 1, 0.5), transmission=0.7),
            material(base_colour=(1, 1, 1, 0.2), base_texture=0, alpha_mode="mask"),
        ]


def glass_opacity(device, rng, triangles):
    """What covers what in a scene of glass triangles, and the triangles' materials."""
    texels = rng.integers(0, 256, (32, 48, 4)).astype(np.uint8)
    images = [SimpleNamespace(texels=texels, srgb=True, wrap_s="mirror", wrap_t="clamp")]
    textures, glass = TextureBuffers.upload(device, images), Glass(rng, triangles, images)
    ids = glass.material_ids
    normals = np.tile(np.array([0, 1, 0], np.float32), (len(glass.uvs), 1))
    surface = Surface(normals, glass.uvs, ids, glass.materials)
    shader = Shader(device, triangles, surface, Lighting([], SKY), textures)
    return Opacity.of_scene(triangles, shader, glass), ids
