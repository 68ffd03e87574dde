"""glTF 2.0 files (.glb, .gltf), flattened straight from their accessors.

trimesh reads glTF too, but drops skins, morph targets, instancing (EXT_mesh_gpu_instancing), wrap modes, second UV
sets, cameras, lights and animations, and loops over nodes in Python; so this format has its own reader here, and
scenes/mesh_files.py reads the others.

Conventions: matrices are float64 (4, 4) for column vectors; quaternions are x, y, z, w; times become milliseconds.
"""

from __future__ import annotations

from functools import cache, partial
from pathlib import Path

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Array, Doubles
from shading_atlas_bench.arithmetic.functions import arctan, tan
from shading_atlas_bench.arithmetic.matrices import matvec, product
from shading_atlas_bench.scenes.files import SceneFiles
from shading_atlas_bench.scenes.gltf_document import GltfDocument
from shading_atlas_bench.scenes.gltf_materials import GltfMaterials, UvSource
from shading_atlas_bench.scenes.gltf_motion import camera_animations
from shading_atlas_bench.scenes.gltf_nodes import AT_REST, GltfNodes
from shading_atlas_bench.scenes.gltf_values import JsonObject, number, numbers, picked, whole
from shading_atlas_bench.scenes.gltf_vertices import Vertices, attribute
from shading_atlas_bench.scenes.model import Camera, Indices, Light
from shading_atlas_bench.scenes.raw import Part, RawScene
from shading_atlas_bench.scenes.transforms import compose, normal_matrices

_INSTANCE_BYTES = 8 * (16 + 10)  # of a matrix, and of what it is made of


def read_gltf(path: Path, files: SceneFiles, raw: RawScene) -> None:
    """All triangles, materials, textures, cameras, camera animations and lights of a glTF file, at rest pose.

    Raises SceneError for what cannot be read at all, and KeyError, IndexError, TypeError or ValueError for damage.
    """
    document = GltfDocument(path, files, raw)
    for name in document.ignored_extensions():
        raw.note(f"The file uses {name}, which is not supported and ignored.")
    materials = GltfMaterials(document, raw)
    nodes = GltfNodes(document)
    _add_parts(document, nodes, materials, raw)
    cameras = [_camera(document, nodes, node, raw) for node in nodes.drawn if "camera" in nodes.entries[node]]
    raw.cameras = sorted(cameras, key=lambda camera: -round(camera.up[1], 1))  # upright ones first: people walk upright
    raw.lights = _lights(document, nodes, raw)
    raw.animations = camera_animations(document, nodes, raw)
    if document.items("animations"):
        raw.note(
            "Animations in the file, of which only those of cameras are used: {}.", len(document.items("animations"))
        )


def _add_parts(document: GltfDocument, nodes: GltfNodes, materials: GltfMaterials, raw: RawScene) -> None:
    """One part per primitive, with the transforms of all nodes that draw it; skinned and morphed ones of their own."""
    placed: dict[int, list[Doubles]] = {}
    joints_of = cache(partial(_joint_matrices, document, nodes))
    for node in nodes.drawn:
        entry = nodes.entries[node]
        if "mesh" not in entry:
            continue
        if "skin" in entry:
            document.entry("skins", entry["skin"])
            joints = joints_of(entry["skin"])
            raw.parts += _primitives(document, materials, raw, entry["mesh"], entry.get("weights"), joints)
        elif "weights" in entry:
            instances = _instances(document, entry, nodes.world[node], raw)
            for part in _primitives(document, materials, raw, entry["mesh"], entry["weights"], None):
                part.transforms = instances
                raw.parts.append(part)
        else:
            placed.setdefault(entry["mesh"], []).append(_instances(document, entry, nodes.world[node], raw))
    for mesh, transforms in placed.items():
        stacked = np.concatenate(transforms)
        for part in _primitives(document, materials, raw, mesh, None, None):
            part.transforms = stacked
            raw.parts.append(part)


def _instances(document: GltfDocument, node: JsonObject, world: Doubles, raw: RawScene) -> Doubles:
    """World matrices (N, 4, 4) of a node's instances (EXT_mesh_gpu_instancing), or its own one."""
    extension = node.get("extensions", {}).get("EXT_mesh_gpu_instancing")
    if extension is None:
        return world[None]
    attributes = extension["attributes"]
    count = max((whole(document.entry("accessors", index), "count", 0) for index in attributes.values()), default=0)
    raw.take(count * _INSTANCE_BYTES, f"{count:,} instances")
    at_rest = {name: np.tile(np.array(value, np.float64), (count, 1)) for name, value in AT_REST.items()}
    placed = (attribute(document, attributes, name.upper(), count) for name in AT_REST)
    values = (rest if own is None else own for own, rest in zip(placed, at_rest.values(), strict=True))
    return product(world, compose(*values))


def _joint_matrices(document: GltfDocument, nodes: GltfNodes, index: int) -> Doubles:
    """Joint matrices (J, 4, 4) at rest: world matrix of each joint times its inverse bind matrix (3.7.3)."""
    skin = document.entry("skins", index)
    for joint in skin["joints"]:
        document.entry("nodes", joint)
    world: Doubles = nodes.world[skin["joints"]]
    if "inverseBindMatrices" not in skin:
        return world
    inverse = document.accessor(skin["inverseBindMatrices"], "inverseBindMatrices", "MAT4")
    if len(inverse) < len(world):
        raise ValueError(f"a skin has {len(world)} joints but {len(inverse)} inverse bind matrices")
    return product(world, inverse[: len(world)])


def _primitives(
    document: GltfDocument,
    materials: GltfMaterials,
    raw: RawScene,
    mesh: int,
    weights: list[float] | None,
    joints: Doubles | None,
) -> list[Part]:
    """The parts of one mesh, morphed by its default weights and skinned by the joint matrices where given."""
    entry = document.entry("meshes", mesh)
    given = weights if weights is not None else entry.get("weights", [])
    shares = numbers({"weights": given}, "weights", (0.0,) * len(given))
    parts = []
    for primitive in entry["primitives"]:
        compressed = "KHR_draco_mesh_compression" in primitive.get("extensions", {})
        if compressed and not document.has_data(primitive["attributes"]["POSITION"]):
            raise ValueError("its meshes are only there as KHR_draco_mesh_compression; export it without")
        if primitive.get("mode", 4) not in (4, 5, 6) or "POSITION" not in primitive["attributes"]:
            raw.note("Primitives of points or lines, left out: {}.")
            continue
        part = _part(document, materials, Vertices(document, primitive, shares, raw))
        raw.take(part.own_bytes, "all its primitives")
        if joints is not None and "JOINTS_0" in primitive["attributes"]:
            _skin(document, primitive["attributes"], joints, part)
        parts.append(part)
    return parts


def _part(document: GltfDocument, materials: GltfMaterials, vertices: Vertices) -> Part:
    primitive = vertices.primitive
    positions, material = vertices.moved("POSITION"), materials.default
    if "material" in primitive:
        document.entry("materials", primitive["material"])
        material = primitive["material"]
    indices: Indices = np.arange(len(positions))
    if "indices" in primitive:
        indices = document.whole_numbers(
            primitive["indices"], "the accessor of a primitive's indices", "SCALAR"
        ).astype(np.int64)
    part = Part(positions, _triangles(indices, primitive.get("mode", 4)), material)
    part.normals, part.tangents, part.colours = vertices.get("NORMAL"), vertices.get("TANGENT"), vertices.colours()
    part.uvs, *further = (_uvs(vertices, source) for source in materials.sources[material])
    part.further_uvs = tuple(further)
    vertices.note_unused()
    return part


def _uvs(vertices: Vertices, source: UvSource) -> Array | None:
    """A texture's coordinates (V, 2), transformed; None where the primitive has not its set."""
    uvs = vertices.get(f"TEXCOORD_{source.channel}")
    return None if uvs is None else source.apply(uvs)


def _triangles(indices: Indices, mode: int) -> Indices:
    """Triangle lists (T, 3) from a list, strip or fan; an odd strip triangle is turned (3.7.2.1)."""
    if mode == 4:
        return indices[: len(indices) // 3 * 3].reshape(-1, 3)
    count = max(0, len(indices) - 2)
    if mode == 6:
        return np.stack([indices[1:-1], indices[2:], np.broadcast_to(indices[:1], count)], axis=1)
    odd = np.arange(count) % 2
    step = np.arange(count)
    return np.stack([indices[step], indices[step + 1 + odd], indices[step + 2 - odd]], axis=1)


def _skin(document: GltfDocument, attributes: JsonObject, joints: Doubles, part: Part) -> None:
    """Move a part into world space by its weighted joint matrices; its node's transform does not count (3.7.3.3)."""
    blended = np.zeros((len(part.positions), 4, 4))
    total = np.zeros(len(part.positions))
    for set_number in range(len(attributes)):
        indices = attribute(document, attributes, f"JOINTS_{set_number}", len(part.positions))
        if indices is None:
            break
        weights = attribute(document, attributes, f"WEIGHTS_{set_number}", len(part.positions))
        if weights is None:
            raise ValueError(f"a primitive has JOINTS_{set_number} but no WEIGHTS_{set_number}")
        weights = weights.astype(np.float64)
        for column in range(4):
            blended += weights[:, column, None, None] * joints[indices[:, column]]
        total += weights.sum(axis=1)
    blended /= np.where(total > 0, total, 1)[:, None, None]
    part.positions = matvec(blended[:, :3, :3], part.positions) + blended[:, :3, 3]
    if part.normals is not None:
        part.normals = matvec(normal_matrices(blended[:, :3, :3]), part.normals)
    if part.tangents is not None:
        along = matvec(blended[:, :3, :3], part.tangents[:, :3])
        part.tangents = np.concatenate([along, part.tangents[:, 3:]], axis=1)


def _camera(document: GltfDocument, nodes: GltfNodes, node: int, raw: RawScene) -> Camera:
    entry = document.entry("cameras", nodes.entries[node]["camera"])
    matrix, fov = nodes.world[node], None
    raw.note("Orthographic cameras, used as perspective ones: {}.", entry.get("type") == "orthographic")
    if "yfov" in (lens := entry.get("perspective", {})):
        high, aspect = number(lens, "yfov", 1.0), number(lens, "aspectRatio", 16 / 9)
        usable = 0 < high < np.pi and 0 < aspect < np.inf
        raw.note("Cameras whose field of view is none, used with the usual one: {}.", not usable)
        fov = float(np.degrees(2 * arctan(tan(high / 2) * aspect))) if usable else None
    direction, up = _unit(-matrix[:3, 2]), _unit(matrix[:3, 1])
    name = entry.get("name") or nodes.entries[node].get("name") or f"camera {node}"
    return Camera(tuple(matrix[:3, 3].tolist()), tuple(direction.tolist()), tuple(up.tolist()), fov, str(name))


def _light_index(node: JsonObject) -> int | None:
    index: int | None = node.get("extensions", {}).get("KHR_lights_punctual", {}).get("light")
    return index


def _lights(document: GltfDocument, nodes: GltfNodes, raw: RawScene) -> list[Light]:
    """The lights of KHR_lights_punctual that nodes place; what of them is not used is counted."""
    entries = document.json.get("extensions", {}).get("KHR_lights_punctual", {}).get("lights", [])
    lights = []
    for node in nodes.drawn:
        if (index := _light_index(nodes.entries[node])) is None:
            continue
        entry = picked(entries, index, "lights")
        if entry["type"] not in ("directional", "point", "spot"):
            raw.note(f"Lights of the unknown type {entry['type']}, left out: {{}}.")
            continue
        raw.note("Ranges of lights, not used: {}.", "range" in entry)
        raw.note(
            "Inner cones of spot lights, not used (they fade from 0.8 of the outer one): {}.",
            "innerConeAngle" in entry.get("spot", {}),
        )
        lights.append(_light(entry, nodes.world[node]))
    return lights


def _light(entry: JsonObject, matrix: Doubles) -> Light:
    """A light by its node's world matrix; lux and candela are taken as they are, the exposure settles the scale."""
    intensity = number(entry, "intensity", 1.0)
    red, green, blue = numbers(entry, "color", (1, 1, 1))
    colour = (red * intensity, green * intensity, blue * intensity)
    cone = float(np.degrees(number(entry.get("spot", {}), "outerConeAngle", np.pi / 4)))
    direction = tuple(_unit(-matrix[:3, 2]).tolist())
    return Light(entry["type"], colour, tuple(matrix[:3, 3].tolist()), direction, cone, entry["type"] != "point")


def _unit(vector: Doubles) -> Doubles:
    length = np.linalg.norm(vector, axis=-1)
    return vector / length if length > 0 else np.array([0.0, 0.0, -1.0])
