"""A scene on the device: everything the server holds for it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kernels.raster.rasteriser import Rasteriser
from kernels.shade.shader import Shader
from kernels.shade.tables import Lighting, Surface
from kernels.texture.buffers import TextureBuffers
from kernels.triangles import Triangles
from packers.interface import ServerScene

if TYPE_CHECKING:
    from kernels.device import Device
    from scenes.model import Scene


def upload_scene(device: Device, scene: Scene) -> ServerScene:
    """Copy `scene` to the device: triangles, textures with mip chains, shadow maps; outside every timer."""
    triangles = upload_triangles(device, scene)
    masked = {m.base_texture for m in scene.materials if m.alpha_mode == "mask"}
    textures = TextureBuffers.upload(device, scene.textures, masked)
    rasteriser = Rasteriser(device, triangles)
    shader = Shader(device, triangles, surface_of(scene), lighting_of(scene), textures)
    return ServerScene(scene, device, triangles, rasteriser, shader)


def upload_triangles(device: Device, scene: Scene) -> Triangles:
    """The scene's triangles with their flags."""
    by_material = np.array(
        [
            Triangles.DOUBLE_SIDED * m.double_sided + Triangles.MASKED * (m.alpha_mode == "mask")
            for m in scene.materials
        ],
        np.uint8,
    )
    return Triangles.upload(device, scene.positions, scene.indices, by_material[scene.material_ids])


def surface_of(scene: Scene) -> Surface:
    """What shading reads of the scene's surface; colours and tangents only where they make a difference."""
    normal_maps = any(m.normal_texture >= 0 for m in scene.materials)
    return Surface(
        scene.normals,
        scene.uvs,
        scene.material_ids,
        scene.materials,
        scene.colours if np.any(scene.colours[:, :3] != 1) else None,
        scene.tangents if normal_maps else None,
    )


def lighting_of(scene: Scene) -> Lighting:
    """The scene's lights, sky and exposure."""
    return Lighting(scene.lights, scene.sky, scene.exposure, scene.metres_per_unit)
