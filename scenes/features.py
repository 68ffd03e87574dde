"""What a scene has, found once (`Features`), and the digest of its content."""

from __future__ import annotations

import hashlib
from dataclasses import astuple, fields

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Array, Doubles
from shading_atlas_bench.scenes.model import Features, Material, Scene

_CHUNK = 1 << 18  # triangles at a time: temporaries stay in the processor's cache
MATT = 0.8  # roughness from which on a surface shows the sky's light only, see kernels/shade/environment.py
_SLANTED = 3.0  # longest edge over height, as in the atlas papers' notion of slanted triangles


def find_features(scene: Scene) -> Features:
    """The features of the materials that triangles use, and the shape statistics of the triangles."""
    used = [scene.materials[index] for index in np.unique(scene.material_ids)]
    area, longest = triangle_shapes(scene)
    with np.errstate(divide="ignore", invalid="ignore"):
        slanted = np.count_nonzero(longest > _SLANTED * 2 * area / longest) / len(area)
    count = max(1, len(area) // 100)
    return Features(
        textures=any(m.textures.keys() - {"normal"} for m in used),
        normal_maps=scene.tangents is not None and any(m.normal_texture >= 0 for m in used),
        vertex_colours=bool((scene.colours != 1).any()),
        mask=any(m.alpha_mode == "mask" for m in used),
        blend=any(m.alpha_mode == "blend" or m.transmission > 0 for m in used),
        varying_opacity=_opacity_varies(scene),
        shadows=any(light.shadows and light.kind != "point" for light in scene.lights),
        specular=any(m.roughness < 1 or m.metallic > 0 or m.surface_texture >= 0 for m in used),
        glossy=any(not m.unlit and _smoothest(scene, m) < MATT for m in used),
        emissive=any(max(m.emissive) > 0 for m in used),
        surface_maps=any(m.surface_texture >= 0 for m in used),
        occlusion=any(m.occlusion_texture >= 0 for m in used),
        unlit=any(m.unlit for m in used),
        further_uvs=scene.further_uvs is not None,
        single_sided=any(not m.double_sided for m in used),
        slanted=float(slanted),
        largest=float(np.partition(area, -count)[-count:].sum() / area.sum()),
    )


def _smoothest(scene: Scene, material: Material) -> float:
    """The least roughness that a material has anywhere."""
    if material.roughness < MATT or material.surface_texture < 0:
        return material.roughness
    return material.roughness * int(scene.textures[material.surface_texture].texels[..., 1].min()) / 255


def _opacity_varies(scene: Scene) -> bool:
    """Whether a see-through material's triangles do not cover the same everywhere: by its texture or their vertices."""
    blended = np.array([material.alpha_mode == "blend" for material in scene.materials])
    triangles = np.flatnonzero(blended[scene.material_ids])
    if not len(triangles):
        return False
    triangles = triangles[np.argsort(scene.material_ids[triangles], kind="stable")]
    owners, alphas = scene.material_ids[triangles], scene.colours[scene.indices[triangles], 3]
    starts = np.flatnonzero(np.diff(owners, prepend=-1))
    lowest = np.minimum.reduceat(alphas.min(axis=1), starts)
    if (lowest != np.maximum.reduceat(alphas.max(axis=1), starts)).any():
        return True
    used = {scene.materials[owner].base_texture for owner in owners[starts].tolist()} - {-1}
    return any(np.ptp(scene.textures[texture].texels[..., 3]) > 0 for texture in used)


def content_digest(scene: Scene) -> str:
    """16 hex digits over a scene's arrays, materials, textures, lights, sky, exposure and scale.

    Not over its cameras, its route and whether it is a place, from which its shadow and environment maps are drawn:
    `drawn_hash` of the harness counts these, too.
    """
    digest = hashlib.blake2b(digest_size=8)
    tangents = scene.tangents if scene.tangents is not None else np.zeros(0, np.float32)
    arrays: list[Array] = [
        scene.positions,
        scene.indices,
        scene.normals,
        scene.uvs,
        scene.colours,
        scene.material_ids,
        tangents,
    ]
    arrays += [] if scene.further_uvs is None else [scene.further_uvs]
    for array in [*arrays, np.asarray(scene.origin, np.float64), *(texture.texels for texture in scene.textures)]:
        digest.update(f"{array.dtype}{array.shape}".encode())
        digest.update(np.ascontiguousarray(array).data)
    settings = [_settings(m) for m in scene.materials] + [astuple(light) for light in scene.lights]
    settings += [(t.srgb, t.wrap_s, t.wrap_t) for t in scene.textures]
    digest.update(repr((settings, astuple(scene.sky), scene.exposure, scene.metres_per_unit)).encode())
    return digest.hexdigest()


def _settings(material: Material) -> tuple[object, ...]:
    """A material's values; from `unlit` on only those that say anything, with their names.

    So a scene without these keeps the digest that it had before there were any.
    """
    values = tuple(getattr(material, field.name) for field in fields(Material))
    rare = next(number for number, field in enumerate(fields(Material)) if field.name == "unlit")
    said = zip(fields(Material)[rare:], values[rare:], strict=True)
    return values[:rare] + tuple((field.name, value) for field, value in said if value != field.default)


def triangle_shapes(scene: Scene) -> tuple[Doubles, Doubles]:
    """Area and longest edge of every triangle, float64 (T), in scene units."""
    area, longest = np.empty(scene.triangle_count), np.empty(scene.triangle_count)
    for start in range(0, scene.triangle_count, _CHUNK):
        rows = slice(start, start + _CHUNK)
        a, b, c = (scene.positions[scene.indices[rows, corner]].astype(np.float64) for corner in range(3))
        (px, py, pz), (qx, qy, qz), (rx, ry, rz) = (b - a).T, (c - a).T, (c - b).T
        x, y, z = py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx
        area[rows] = np.sqrt(x * x + y * y + z * z) / 2
        sides = (px * px + py * py + pz * pz, qx * qx + qy * qy + qz * qz, rx * rx + ry * ry + rz * rz)
        longest[rows] = np.sqrt(np.maximum.reduce(sides))
    return area, longest
