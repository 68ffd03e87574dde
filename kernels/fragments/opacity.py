"""How much fragments cover what is behind them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from shading_atlas_bench.arithmetic import arrays
from shading_atlas_bench.arithmetic.arrays import Doubles, Floats, Ints
from shading_atlas_bench.kernels.texture.sample import bilinear

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.kernels.samples import Samples
    from shading_atlas_bench.kernels.shade.shader import Shader
    from shading_atlas_bench.kernels.texture.buffers import TextureBuffers, TextureImage
    from shading_atlas_bench.kernels.triangles import Triangles

VARIES = 256  # in place of a material's opacity: it is not the same all over its triangles
TRANSMITTANCE = 0.9  # of the light that a material transmits; the rest keeps clear glass visible


class BlendedMaterial(Protocol):
    """What opacity reads of a material."""

    base_colour: tuple[float, float, float, float]
    base_texture: int
    alpha_mode: str
    transmission: float


class BlendedScene(Protocol):
    """What opacity reads of a scene."""

    @property
    def uvs(self) -> Floats:
        """Texture coordinates, float32 (V, 2)."""

    @property
    def colours(self) -> Floats:
        """Linear RGBA of the vertices, float32 (V, 4)."""

    @property
    def indices(self) -> Ints:
        """Vertices of the triangles, int32 (T, 3)."""

    @property
    def material_ids(self) -> Ints:
        """Materials of the triangles, int32 (T)."""

    @property
    def materials(self) -> Sequence[BlendedMaterial]:
        """What `material_ids` number."""

    @property
    def textures(self) -> Sequence[TextureImage]:
        """What the materials' `base_texture` numbers."""


def blends(material: BlendedMaterial) -> bool:
    """Whether what is behind a material shows through."""
    return material.alpha_mode == "blend" or material.transmission > 0


def constant_opacities(scene: BlendedScene) -> NDArray[np.uint16]:
    """uint16 (M): the opacity of each material, 0..255; VARIES where it has a texture or vertex colours whose alpha is
    not the same everywhere. 255 for materials that no triangle has, and for those that do not blend."""
    constants = np.full(len(scene.materials), 255, np.uint16)
    for number in np.unique(scene.material_ids):
        material = scene.materials[number]
        if not blends(material):
            continue
        alphas = []
        if material.alpha_mode == "blend":
            alphas.append(scene.colours[scene.indices[scene.material_ids == number], 3])
            if material.base_texture >= 0:
                alphas.append(scene.textures[material.base_texture].texels[..., 3] / np.float32(255))
        if any(alpha.min() != alpha.max() for alpha in alphas):
            constants[number] = VARIES
            continue
        share = _surface_row(material)[0] * _surface_row(material)[3]
        for alpha in alphas:
            share *= np.float32(alpha.flat[0])
        constants[number] = np.uint16(np.clip(share, 0, 1) * np.float32(255) + np.float32(0.5))
    return constants


def _surface_row(material: BlendedMaterial) -> Floats:
    """A row of `Opacity.surfaces`."""
    has_alpha = material.alpha_mode == "blend"
    alpha, texture = (material.base_colour[3], material.base_texture + 1) if has_alpha else (1, 0)
    kind = 2 if has_alpha else int(blends(material))
    return np.array([alpha, texture, kind, 1 - TRANSMITTANCE * material.transmission], np.float32)


@dataclass(frozen=True)
class Opacity:
    """What a scene's fragments need: per material and per vertex, on the device and on the host.

    indices: int32 (T, 3), vertices. faces: int32 (T, 2), see face_rows.
    surfaces: float32 (M, 4), alpha, texture (0: none), what blends it (0: nothing, 1: light that it lets through,
        2: its alpha), share of light kept from passing through.
    corners: float32 (V, 4), u, v and vertex alpha.
    constants: uint16 (M), on the host, as from `constant_opacities`.
    """

    device: Device
    indices: Array
    faces: Array
    textures: TextureBuffers
    surfaces: Array
    corners: Array
    constants: NDArray[np.uint16]

    @property
    def varies(self) -> bool:
        """Whether some triangle's opacity is not the same all over it."""
        return bool((self.constants == VARIES).any())

    @classmethod
    def of_scene(cls, triangles: Triangles, shader: Shader, scene: BlendedScene) -> Opacity:
        """Upload what materials and vertices say; the shader lends textures and the triangles' materials."""
        materials, device = scene.materials, shader.device
        surfaces = np.array([_surface_row(material) for material in materials], np.float32)
        alphas = np.stack([scene.colours[:, 3], np.zeros(len(scene.uvs))], axis=1)
        corners = np.concatenate([scene.uvs, alphas], axis=1).astype(np.float32)
        return cls(
            device,
            triangles.indices,
            shader.faces,
            shader.textures,
            device.upload(surfaces),
            device.upload(corners),
            constant_opacities(scene),
        )

    def of(self, samples: Samples, stage: str) -> Array:
        """int32 (n), 0 (invisible) to 255 (hides what is behind): alpha times texture alpha times vertex alpha for
        blended materials, less what a transmissive one lets through; 255 for all others."""
        opacity = self.device.recycled(len(samples.texel), np.int32)
        inputs = (samples.triangle, samples.bary1, samples.bary2, samples.footprint)
        tables = (self.indices, self.faces, self.surfaces, self.corners, opacity)
        textures = (self.textures.textures, self.textures.levels, self.textures.texels)
        kernel = self.device.build("fragments/opacity.cl").fragment_opacity
        self.device.launch(stage, kernel, -(-samples.count // 8), samples.count, *inputs, *tables, *textures)
        return opacity

    def write(self, samples: Samples, target: Array, stage: str) -> None:
        """Write the opacity of every sample at its texel of `target`, uint8 (H, W, 4), into red, green and blue."""
        kernel = self.device.build("fragments/opacity.cl").write_opacity
        self.device.launch(stage, kernel, samples.count, samples.count, samples.texel, self.of(samples, stage), target)


def opacity_twin(opacity: Opacity, triangle: arrays.Array, bary: Doubles, footprint: Doubles) -> Doubles:
    """The same for triangle int (n), bary (n, 2), footprint (n), before rounding: float64 (n), 0 to 255.

    A texture is looked up at one mip level, that nearest to the footprint.
    """
    corners = opacity.corners.get().astype(np.float64)[opacity.indices.get()[triangle]]
    weights = np.stack([1 - bary.sum(axis=1), bary[:, 0], bary[:, 1]], axis=1)
    u, v, alpha, _ = np.einsum("ni,nif->nf", weights, corners).T
    faces = opacity.faces.get()[triangle]
    base, texture, blended, kept = opacity.surfaces.get().astype(np.float64)[faces[:, 0]].T
    scale = faces[:, 1].copy().view(np.float32).astype(np.float64)
    first, last, wrap, size = opacity.textures.host_textures[texture.astype(int)].T
    across = np.maximum(footprint * scale * size, 1e-9)
    level = np.clip(np.where(across > 1, np.floor(np.log2(across) + 0.5), 0), 0, last).astype(int)
    texel = bilinear(opacity.textures, first + level, u, v, wrap)[:, 3]
    share = base * kept * np.where(blended > 1, alpha, 1) * np.where(texture > 0, texel, 1)
    return 255 * np.where(blended > 0, np.clip(share, 0, 1), 1)
