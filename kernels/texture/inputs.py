"""Alpha masks of random leaves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Bytes, Ints
from shading_atlas_bench.kernels.inputs.materials import Material, Texture
from shading_atlas_bench.kernels.texture.mask import AlphaMask

if TYPE_CHECKING:
    from shading_atlas_bench.kernels.device import Device


def masked_material(mode: str = "mask", texture: int = 0, cutoff: float = 0.5, alpha: float = 1.0) -> Material:
    """A white material. mode: its alpha mode. texture: of its base colour, -1 for none. cutoff: the alpha below which
    it has holes. alpha: of its base colour."""
    return Material(base_colour=(1, 1, 1, alpha), base_texture=texture, alpha_mode=mode, alpha_cutoff=cutoff)


def leaves(rng: np.random.Generator, size: tuple[int, int] = (128, 96)) -> Bytes:
    """uint8 (H, W, 4) of this size: random opaque rectangles of up to 9 texels a side on about a third."""
    texels = np.zeros((*size, 4), np.uint8)
    for _ in range(size[0] * size[1] // 60):
        y, x, height, width = rng.integers(0, [*size, 9, 9])
        texels[y : y + height + 1, x : x + width + 1, 3] = 255
    return texels


def masked_soup(device: Device, faded: bool = False) -> tuple[AlphaMask, Ints]:
    """The masks of 200 triangles with broken coordinates among them, and the triangles' materials, int32 (200); 0 is
    opaque. faded: half of the vertices have an alpha."""
    rng = np.random.default_rng(5)
    textures = [
        Texture(leaves(rng, size), wrap_s=s, wrap_t=t)
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
    mask = AlphaMask.upload(device, indices, uvs, material_ids, materials, textures, vertex_alphas=alphas)
    assert mask is not None  # for some are masked
    return mask, material_ids
