"""A scene on the device: everything the server holds for it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Floats, Ints
from shading_atlas_bench.harness.workload.environment import cached_environment_map, standpoint
from shading_atlas_bench.harness.workload.shadows import cached_shadow_maps
from shading_atlas_bench.kernels.fragments.layered import LayeredRasteriser
from shading_atlas_bench.kernels.fragments.layers import Layers
from shading_atlas_bench.kernels.fragments.opacity import Opacity, blends
from shading_atlas_bench.kernels.raster.rasteriser import Rasteriser
from shading_atlas_bench.kernels.shade.capture import scene_around, sky_around
from shading_atlas_bench.kernels.shade.environment import environment_map
from shading_atlas_bench.kernels.shade.shader import Shader
from shading_atlas_bench.kernels.shade.shadow import ShadowMaps
from shading_atlas_bench.kernels.shade.tables import Lighting, Surface
from shading_atlas_bench.kernels.texture.buffers import TextureBuffers
from shading_atlas_bench.kernels.texture.mask import AlphaMask
from shading_atlas_bench.kernels.triangles import Triangles
from shading_atlas_bench.packers.interface import ServerScene
from shading_atlas_bench.packers.skips import Skips

if TYPE_CHECKING:
    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.scenes.model import Scene


NEAREST = 0.05  # metres; what is nearer to the point of an environment map is not in it

# Defines of the shading function by the skip that leaves them out, with the feature that needs them.
SHADING = {
    "textures": ("textures", ("TEXTURES",)),
    "normal maps": ("normal_maps", ("NORMAL_MAPS", "TEXTURES")),
    "shadows": ("shadows", ("SHADOWS",)),
}


def upload_scene(device: Device, scene: Scene, skips: Skips | None = None) -> ServerScene:
    """Copy `scene` to the device: triangles, alpha masks, textures with mip chains, shadow maps and environment map;
    outside all timers.

    What the scene does not need is left out, unless `skips` says otherwise.
    """
    features, skips = scene.features, skips or Skips()
    keep_mask = not skips.leaves_out("alpha mask", not features.mask)
    keep_layers = not skips.leaves_out("blending", not features.blend)
    culls = skips.leaves_out("clusters", True)
    keep = [
        define
        for name, (feature, defines) in SHADING.items()
        if not getattr(features, feature) and not skips.leaves_out(name, True)
        for define in defines
    ]
    triangles = upload_triangles(device, scene)
    mask = AlphaMask.upload(
        device,
        scene.indices,
        scene.uvs,
        scene.material_ids,
        scene.materials,
        scene.textures,
        keep_mask,
        scene.colours[:, 3],
    )
    textures = TextureBuffers.upload(device, scene.textures, hidden_below(scene))
    rasteriser = Rasteriser(device, triangles, mask, cull=culls)
    shadows = _shadow_maps(device, scene, triangles, mask)
    surface = surface_of(scene, "NORMAL_MAPS" in keep)
    shader = Shader(device, triangles, surface, lighting_of(scene), textures, shadows, keep)
    if not skips.leaves_out("environment map", not features.glossy):
        seen = cached_environment_map(device, scene, lambda: _drawn_environment_map(scene, triangles, mask, shader))
        shader = shader.reflecting(seen)
    layers = None
    if keep_layers:
        opacity = Opacity.of_scene(triangles, shader, scene)
        layers = Layers(LayeredRasteriser(device, triangles, mask, culls), opacity)
    skips.always = skips.take()
    return ServerScene(scene, device, triangles, rasteriser, shader, mask, layers, skips)


def hidden_below(scene: Scene) -> dict[int, float]:
    """The alpha (0..1) below which no material shows a texture, by texture of masked and blended materials; 0 for one
    that others show everywhere."""
    lowest: dict[int, float] = {}
    for m in scene.materials:
        cutoff = {"mask": m.alpha_cutoff / max(m.base_colour[3], 1e-6), "blend": 0.5 / 255}.get(m.alpha_mode, 0.0)
        for slot, texture in m.textures.items():
            alpha = cutoff if slot == "base" else 0.0
            lowest[texture] = min(lowest.get(texture, alpha), alpha)
    cut = {m.base_texture for m in scene.materials if m.alpha_mode != "opaque"}
    return {texture: lowest[texture] for texture in cut if texture >= 0}


def _shadow_maps(device: Device, scene: Scene, triangles: Triangles, mask: AlphaMask | None) -> ShadowMaps:
    """Shadow maps of everything that is not see-through: light passes blended surfaces and transmissive ones."""
    if not any(light.shadows and light.kind != "point" for light in scene.lights):
        return ShadowMaps.none(device, len(scene.lights))
    return cached_shadow_maps(device, scene, lambda: _drawn_shadow_maps(device, scene, triangles, mask))


def _drawn_shadow_maps(device: Device, scene: Scene, triangles: Triangles, mask: AlphaMask | None) -> ShadowMaps:
    casters, mask, _ = _not_see_through(device, scene, triangles, mask)
    cameras = [camera.position for camera in scene.cameras]
    focus = np.asarray(np.mean(cameras, axis=0) if cameras else np.median(scene.positions, axis=0), np.float64)
    return ShadowMaps.render(device, casters, mask, scene.lights, focus, scene.metres_per_unit)


def _not_see_through(
    device: Device, scene: Scene, triangles: Triangles, mask: AlphaMask | None
) -> tuple[Triangles, AlphaMask | None, Ints | None]:
    """The triangles that are not see-through, with their mask and their numbers in the scene; None where all are."""
    opaque = np.array([not blends(m) for m in scene.materials], bool)
    ids = np.flatnonzero(opaque[scene.material_ids]).astype(np.int32)
    if len(ids) == triangles.count:
        return triangles, mask, None
    part = Triangles.upload(device, scene.positions, scene.indices[ids], triangles.host_flags[ids])
    return part, mask.of_triangles(device, ids) if mask else None, ids


def _drawn_environment_map(scene: Scene, triangles: Triangles, mask: AlphaMask | None, shader: Shader) -> Floats:
    """What a place's surfaces reflect is the place, without what is see-through; what an object's do, the sky."""
    point = standpoint(scene)
    if point is None:
        return environment_map(sky_around(shader))
    device = shader.device
    part, mask, ids = _not_see_through(device, scene, triangles, mask)
    rasteriser = Rasteriser(device, part, mask)
    near = NEAREST / scene.metres_per_unit
    return environment_map(scene_around(device, rasteriser, ids, shader, point, near))


def upload_triangles(device: Device, scene: Scene) -> Triangles:
    """The scene's triangles with their flags."""
    by_material = np.array(
        [
            Triangles.DOUBLE_SIDED * m.double_sided
            + Triangles.MASKED * (m.alpha_mode == "mask")
            + Triangles.BLENDED * blends(m)
            for m in scene.materials
        ],
        np.uint8,
    )
    flags = by_material[scene.material_ids]
    if (scene.colours[:, 3] < 1).any():
        faded = (scene.colours[:, 3][scene.indices] < 1).any(axis=1) & ((flags & Triangles.MASKED) > 0)
        flags |= (Triangles.FADED * faded).astype(np.uint8)
    return Triangles.upload(device, scene.positions, scene.indices, flags)


def surface_of(scene: Scene, keep_tangents: bool = False) -> Surface:
    """What shading reads of the scene's surface; colours and tangents only where they make a difference, or to keep."""
    tangents = scene.tangents if any(m.normal_texture >= 0 for m in scene.materials) else None
    if keep_tangents and tangents is None:
        tangents = np.tile(np.array([1, 0, 0, 1], np.float32), (len(scene.positions), 1))
    return Surface(
        scene.normals,
        scene.uvs,
        scene.material_ids,
        scene.materials,
        scene.colours if np.any(scene.colours[:, :3] != 1) else None,
        tangents,
        scene.further_uvs,
    )


def lighting_of(scene: Scene) -> Lighting:
    """The scene's lights, sky and exposure."""
    return Lighting(scene.lights, scene.sky, scene.exposure, scene.metres_per_unit)
