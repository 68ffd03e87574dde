"""Fragment lists, and glass."""

from types import SimpleNamespace

import numpy as np

from kernels.fragments.opacity import Opacity
from kernels.inputs.soups import perspective
from kernels.inputs.surfaces import SKY, material
from kernels.ppll.lists import Lists
from kernels.shade.shader import Shader
from kernels.shade.tables import Lighting, Surface
from kernels.texture.buffers import TextureBuffers

SIZE = (24, 16)
PROJECTION = perspective(80, SIZE[0] / SIZE[1])


def normal_lists(device, rng, most=6, near=1.0, size=SIZE):
    """Lists of fragments that lie in their pixels; a fifth of the distances occurs twice."""
    pixels = size[0] * size[1]
    counts = rng.integers(0, most, pixels) * (rng.random(pixels) < 0.8)
    pixel = np.repeat(np.arange(pixels), counts)
    distance = near + rng.integers(0, 40, len(pixel)).astype(np.float32) / 16
    distance = distance[np.lexsort((distance, pixel))]
    tangent = 1 / PROJECTION[0, 0] / (size[0] / 2)
    x = (pixel % size[0] + rng.uniform(0.1, 0.9, len(pixel)) - size[0] / 2) * tangent * distance
    y = (size[1] / 2 - pixel // size[0] - rng.uniform(0.1, 0.9, len(pixel))) * tangent * distance
    rows = np.zeros((len(pixel), 5), np.uint32)
    rows[:, 0] = rng.integers(0, 1 << 8, len(pixel)) | 200 << 24
    rows[:, 1] = np.arange(len(pixel))  # a name, to tell fragments apart
    rows[:, 2:] = np.stack([x, y, distance], axis=1).astype(np.float32).view(np.uint32)
    return Lists.upload(device, *size, np.concatenate([[0], np.cumsum(counts)]), rows)


def random_lists(device, rng, width=24, height=16, most=6, words=2):
    """Lists of colours and depths, a fifth of them opaque."""
    counts = rng.integers(0, most, width * height) * (rng.random(width * height) < 0.7)
    offsets = np.concatenate([[0], np.cumsum(counts)])
    pixel = np.repeat(np.arange(len(counts)), counts)
    depth = rng.uniform(0.01, 0.2, len(pixel)).astype(np.float32)
    depth = depth[np.lexsort((-depth, pixel))]
    rows = rng.integers(0, 2**32, (len(pixel), words), dtype=np.uint64).astype(np.uint32)
    rows[:, 1] = depth.view(np.uint32)
    rows[:, 0] |= 1 << 24
    rows[rng.random(len(rows)) < 0.2, 0] |= 255 << 24
    return Lists.upload(device, width, height, offsets, rows)


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
