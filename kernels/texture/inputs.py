"""Alpha masks of random leaves."""

from types import SimpleNamespace

import numpy as np

from shading_atlas_bench.kernels.texture.mask import AlphaMask


def masked_material(mode="mask", texture=0, cutoff=0.5, alpha=1.0):
    return SimpleNamespace(base_colour=(1, 1, 1, alpha), base_texture=texture, alpha_mode=mode, alpha_cutoff=cutoff)


def leaves(rng, size=(128, 96)):
    """Random opaque rectangles of up to 9 texels on about a third."""
    texels = np.zeros((*size, 4), np.uint8)
    for _ in range(size[0] * size[1] // 60):
        y, x, height, width = rng.integers(0, [*size, 9, 9])
        texels[y : y + height + 1, x : x + width + 1, 3] = 255
    return texels


def masked_soup(device, faded=False):
    """The masks of 200 triangles with broken coordinates among them, and the triangles' materials; 0 is opaque. faded:
    half of the vertices have an alpha."""
    rng = np.random.default_rng(5)
    textures = [
        SimpleNamespace(texels=leaves(rng, size), srgb=True, wrap_s=s, wrap_t=t)
        for size, s, t in [((128, 96), "repeat", "repeat"), ((33, 70), "clamp", "mirror"), ((1, 1), "mirror", "clamp")]
    ]
    materials = (
        [masked_material("opaque")]
        + [masked_material(texture=i) for i in range(3)]
        + [masked_material(texture=-1, alpha=0.7)]
    )
    indices = np.arange(3 * 200).reshape(-1, 3).astype(np.int32)
    uvs = rng.uniform(-3, 3, (600, 2)).astype(np.float32)
    uvs[30:33], uvs[33:36] = np.nan, 1e9
    material_ids = rng.integers(0, 5, 200).astype(np.int32)
    material_ids[10:12] = 1
    alphas = np.where(rng.random(600) < 0.5, 1, rng.random(600)).astype(np.float32) if faded else None
    arrays = (indices, uvs, material_ids, materials, textures)
    return AlphaMask.upload(device, *arrays, vertex_alphas=alphas), material_ids
