"""glTF files: what a node tree, instances, skins, morph targets, materials, cameras and lights become."""

import numpy as np
import pytest

from shading_atlas_bench.scenes.load import load_scene
from shading_atlas_bench.scenes.model import Material, SceneError
from tests.scenes.glb_files import SQUARE, SQUARE_INDICES, Glb, square_scene


def world(scene) -> np.ndarray:
    """Triangle corners (T, 3, 3) in the file's coordinates."""
    return scene.positions[scene.indices] + scene.origin


def facing(scene) -> np.ndarray:
    corners = scene.positions[scene.indices].astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def test_nested_transforms_and_mirrored_nodes_keep_fronts(tmp_path):
    parent = {"translation": [10, 0, 0], "scale": [2, 2, 2], "children": [1]}
    scene = load_scene(square_scene(parent, {"mesh": 0, "scale": [-1, 1, 1]}).write(tmp_path / "a.glb"))
    assert world(scene).reshape(-1, 3).min(axis=0) == pytest.approx([8, 0, 0])
    assert world(scene).reshape(-1, 3).max(axis=0) == pytest.approx([10, 2, 0])
    assert facing(scene) == pytest.approx(np.tile([0, 0, 1], (2, 1)))
    assert scene.normals == pytest.approx(np.tile([0, 0, 1], (4, 1)))


def test_large_offsets_keep_precision(tmp_path):
    scene = load_scene(square_scene({"mesh": 0, "translation": [1e7, 0, 0]}).write(tmp_path / "a.glb"))
    assert scene.origin[0] == pytest.approx(1e7 + 0.5, abs=1e-9)
    assert scene.positions[:, 0].tolist() == [-0.5, 0.5, 0.5, -0.5]


def test_gpu_instancing_is_expanded(tmp_path):
    glb = square_scene({})
    attributes = {
        "TRANSLATION": glb.accessor(np.array([[0, 0, 0], [5, 0, 0], [0, 0, 7]], np.float32)),
        "ROTATION": glb.accessor(np.array([[0, 0, 0, 1], [0, 1, 0, 0], [0, 0, 0, 1]], np.float32)),
        "SCALE": glb.accessor(np.array([[1, 1, 1], [1, 1, 1], [3, 3, 3]], np.float32)),
    }
    glb.json["nodes"] = [{"mesh": 0, "extensions": {"EXT_mesh_gpu_instancing": {"attributes": attributes}}}]
    scene = load_scene(glb.write(tmp_path / "a.glb"))
    assert scene.triangle_count == 6
    assert facing(scene)[[0, 2, 4], 2] == pytest.approx([1, -1, 1])
    assert world(scene)[4:].reshape(-1, 3).max(axis=0) == pytest.approx([3, 3, 7])


def test_skin_at_rest_ignores_the_mesh_node(tmp_path):
    """Joint 1 stands 4 higher than where it was bound, joint 0 where it was: half the square moves up by 4."""
    glb = Glb(nodes=[{"mesh": 0, "skin": 0, "translation": [99, 0, 0]}, {"children": [2]}, {"translation": [0, 5, 0]}])
    joints = np.array([[0, 0, 0, 0], [0, 0, 0, 0], [1, 0, 0, 0], [1, 0, 0, 0]], np.uint8)
    weights = np.array([[1, 0, 0, 0]] * 4, np.float32)
    glb.json["meshes"] = [{"primitives": [glb.square(JOINTS_0=joints, WEIGHTS_0=weights)]}]
    binds = np.tile(np.eye(4, dtype=np.float32), (2, 1, 1))
    binds[1, 1, 3] = -1
    glb.json["skins"] = [{"joints": [1, 2], "inverseBindMatrices": glb.accessor(binds)}]
    points = world(load_scene(glb.write(tmp_path / "a.glb"))).reshape(-1, 3)
    assert np.unique(points, axis=0) == pytest.approx(np.array([[0.0, 0, 0], [0, 5, 0], [1, 0, 0], [1, 5, 0]]))


def test_morph_targets_with_default_weights(tmp_path):
    glb = square_scene()
    target = {"POSITION": glb.accessor(np.array([[0, 0, 2]] * 4, np.float32))}
    glb.json["meshes"][0]["primitives"][0]["targets"] = [target]
    glb.json["meshes"][0]["weights"] = [0.5]
    assert world(load_scene(glb.write(tmp_path / "a.glb")))[..., 2] == pytest.approx(1)


def test_a_node_s_weights_override_its_mesh_s(tmp_path):
    glb = square_scene({"mesh": 0, "weights": [0.25]}, {"mesh": 0, "translation": [5, 0, 0]})
    target = {"POSITION": glb.accessor(np.array([[0, 0, 2]] * 4, np.float32))}
    glb.json["meshes"][0]["primitives"][0]["targets"] = [target]
    glb.json["meshes"][0]["weights"] = [1.0]
    points = world(load_scene(glb.write(tmp_path / "a.glb"))).reshape(-1, 3)
    assert points[points[:, 0] < 2, 2] == pytest.approx(0.5)
    assert points[points[:, 0] > 2, 2] == pytest.approx(2)


def test_only_the_default_scene_is_drawn(tmp_path):
    glb = square_scene({"mesh": 0}, {"mesh": 0, "translation": [5, 0, 0]})
    glb.json |= {"scene": 1, "scenes": [{"nodes": [0]}, {"nodes": [1]}]}
    scene = load_scene(glb.write(tmp_path / "a.glb"))
    assert scene.triangle_count == 2
    assert world(scene)[..., 0].min() == pytest.approx(5)


@pytest.mark.parametrize(("kind", "largest"), [(np.uint8, 255), (np.uint16, 65535)])
def test_whole_numbers_as_coordinates_and_colours(tmp_path, png, kind, largest):
    glb = Glb(nodes=[{"mesh": 0}], textures=[{"source": 0}])
    glb.json["images"] = [{"bufferView": glb.view(png)}]
    glb.json["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
    primitive = glb.square()
    whole = {"TEXCOORD_0": SQUARE[:, :2] * largest, "COLOR_0": np.tile([largest, 0, largest // 5, largest], (4, 1))}
    for name, values in whole.items():
        primitive["attributes"][name] = glb.accessor(values.astype(kind), normalized=True)
    glb.json["meshes"] = [{"primitives": [{**primitive, "material": 0}]}]
    scene = load_scene(glb.write(tmp_path / "a.glb"))
    assert scene.uvs == pytest.approx(SQUARE[:, :2])
    assert scene.colours == pytest.approx(np.tile([1, 0, 0.2, 1], (4, 1)))


@pytest.mark.parametrize(("mode", "order"), [(5, [0, 1, 3, 2]), (6, [0, 1, 2, 3])])
def test_strips_and_fans(tmp_path, mode, order):
    glb = square_scene()
    primitive = glb.json["meshes"][0]["primitives"][0]
    primitive |= {"mode": mode, "indices": glb.accessor(np.array(order, np.uint16))}
    assert facing(load_scene(glb.write(tmp_path / "a.glb"))) == pytest.approx(np.tile([0, 0, 1], (2, 1)))


def test_sparse_and_normalised_accessors(tmp_path):
    glb = square_scene()
    sparse = {
        "count": 1,
        "indices": {"bufferView": glb.view(np.array([2], np.uint16).tobytes()), "componentType": 5123},
        "values": {"bufferView": glb.view(np.array([1, 3, 0], np.float32).tobytes())},
    }
    glb.json["accessors"][0]["sparse"] = sparse
    colours = glb.accessor(np.array([[255, 0, 51, 255]] * 4, np.uint8), normalized=True)
    glb.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = colours
    scene = load_scene(glb.write(tmp_path / "a.glb"))
    assert world(scene)[..., 1].max() == 3
    assert scene.colours[0] == pytest.approx([1, 0, 0.2, 1])
    assert scene.features.vertex_colours


def test_materials_wrap_modes_and_second_uv_set(tmp_path, png):
    glb = Glb(nodes=[{"mesh": 0}], samplers=[{"wrapS": 33071, "wrapT": 33648}], textures=[{"source": 0, "sampler": 0}])
    glb.json["images"] = [{"bufferView": glb.view(png), "mimeType": "image/png"}]
    transform = {"KHR_texture_transform": {"scale": [2, 3], "offset": [0.5, 0]}}
    pbr = {"baseColorTexture": {"index": 0, "texCoord": 1, "extensions": transform}, "metallicFactor": 0.25}
    glass = {"KHR_materials_transmission": {"transmissionFactor": 0.9, "transmissionTexture": {"index": 0}}}
    entry = {"pbrMetallicRoughness": pbr, "alphaMode": "MASK", "alphaCutoff": 0.3, "doubleSided": True}
    glb.json["materials"] = [
        {**entry, "extensions": glass, "emissiveFactor": [0, 2, 0], "emissiveTexture": {"index": 0}}
    ]
    uvs = {"TEXCOORD_0": np.array([[9, 9]] * 4, np.float32), "TEXCOORD_1": SQUARE[:, :2]}
    glb.json["meshes"] = [{"primitives": [{**glb.square(**uvs), "material": 0}]}]
    scene = load_scene(glb.write(tmp_path / "a.glb"))
    material, texture = scene.materials[0], scene.textures[0]
    assert (material.alpha_mode, material.alpha_cutoff, material.double_sided) == ("mask", 0.3, True)
    assert (material.metallic, material.transmission) == (0.25, 0.45)  # half of the texture's red
    assert any("Textures of transmission" in note for note in scene.notes)
    assert (texture.wrap_s, texture.wrap_t, texture.srgb) == ("clamp", "mirror", True)
    assert texture.texels.tolist() == [[[255, 0, 0, 255], [0, 0, 255, 128]]]
    assert scene.uvs == pytest.approx(SQUARE[:, :2] * (2, 3) + (0.5, 0))
    assert (material.emissive, material.emissive_texture, material.emissive_uv) == ((0, 2, 0), 0, 1)
    assert scene.further_uvs == pytest.approx(np.full((1, 4, 2), 9))
    assert any("let light through" in note for note in scene.notes)


def test_every_texture_has_its_own_set_and_transform(tmp_path, png):
    """Base, normals and emission differ; occlusion is looked up where the normals are; a set is kept once."""
    glb = Glb(nodes=[{"mesh": 0}], textures=[{"source": 0}])
    glb.json["images"] = [{"bufferView": glb.view(png)}]
    turn = {"extensions": {"KHR_texture_transform": {"rotation": np.pi / 2, "texCoord": 1}}}
    glb.json["materials"] = [
        {
            "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicRoughnessTexture": {"index": 0}},
            "normalTexture": {"index": 0, "texCoord": 1},
            "emissiveTexture": {"index": 0, **turn},
            "emissiveFactor": [1, 1, 1],
            "occlusionTexture": {"index": 0, "texCoord": 1, "strength": 0.25},
        }
    ]
    first, second = SQUARE[:, :2], np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32)
    primitive = {**glb.square(TEXCOORD_0=first, TEXCOORD_1=second), "material": 0}
    glb.json["meshes"] = [{"primitives": [primitive]}]
    scene = load_scene(glb.write(tmp_path / "a.glb"))
    material = scene.materials[0]
    assert [material.uv_of(slot) for slot in ("base", "surface", "normal", "occlusion", "emissive")] == [0, 0, 2, 2, 1]
    assert (material.occlusion_strength, material.metallic, material.roughness) == (0.25, 1.0, 1.0)
    assert scene.uvs == pytest.approx(first)
    assert scene.further_uvs is not None
    assert scene.further_uvs[1] == pytest.approx(second)
    turned = np.stack([second[:, 1], -second[:, 0]], axis=1)  # (u, v) by the matrix of the extension's text
    assert scene.further_uvs[0] == pytest.approx(turned, abs=1e-6)
    assert scene.tangents == pytest.approx(np.tile([1, 0, 0, 1], (4, 1)))  # those of the normal map's own UVs
    assert len(scene.textures) == 2  # as colours and as numbers
    features = scene.features
    assert [features.further_uvs, features.occlusion, features.surface_maps, features.unlit] == [True] * 3 + [False]


def test_a_part_without_one_of_two_sets_loses_the_textures_of_that_set_only(tmp_path, png):
    glb = Glb(nodes=[{"mesh": 0}], textures=[{"source": 0}])
    glb.json["images"] = [{"bufferView": glb.view(png)}]
    emission = {"emissiveTexture": {"index": 0, "texCoord": 1}, "emissiveFactor": [1, 1, 1]}
    glb.json["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, **emission}]
    glb.json["meshes"] = [{"primitives": [{**glb.square(TEXCOORD_0=SQUARE[:, :2]), "material": 0}]}]
    scene = load_scene(glb.write(tmp_path / "a.glb"))
    material = scene.materials[scene.material_ids[0]]
    assert (material.base_texture, material.emissive_texture, material.emissive) == (0, -1, (0, 0, 0))
    assert any("without texture coordinates" in note for note in scene.notes)


def test_unlit_materials_keep_their_base_colour_only(tmp_path, png):
    glb = Glb(nodes=[{"mesh": 0}], textures=[{"source": 0}], extensionsUsed=["KHR_materials_unlit"])
    glb.json["images"] = [{"bufferView": glb.view(png)}]
    pbr = {"baseColorTexture": {"index": 0}, "baseColorFactor": [0.5, 0.6, 0.7, 1], "roughnessFactor": 0.1}
    extras = {"emissiveFactor": [1, 1, 1], "normalTexture": {"index": 0}, "extensions": {"KHR_materials_unlit": {}}}
    glb.json["materials"] = [{"pbrMetallicRoughness": pbr, **extras}]
    glb.json["meshes"] = [{"primitives": [{**glb.square(TEXCOORD_0=SQUARE[:, :2]), "material": 0}]}]
    scene = load_scene(glb.write(tmp_path / "a.glb"))
    assert scene.materials[0] == Material("", (0.5, 0.6, 0.7, 1.0), base_texture=0, unlit=True)
    assert scene.features.unlit
    assert scene.tangents is None
    assert not any("nlit" in note for note in scene.notes)


def test_tangents_follow_the_image(tmp_path, png):
    """u grows to the right and v downwards on the square, as on an image that is seen upright: w is 1."""
    glb = Glb(nodes=[{"mesh": 0}], textures=[{"source": 0}])
    glb.json["images"] = [{"bufferView": glb.view(png)}]
    glb.json["materials"] = [{"normalTexture": {"index": 0}}]
    uvs = np.stack([SQUARE[:, 0], 1 - SQUARE[:, 1]], axis=1)
    glb.json["meshes"] = [{"primitives": [{**glb.square(TEXCOORD_0=uvs), "material": 0}]}]
    scene = load_scene(glb.write(tmp_path / "a.glb"))
    assert scene.tangents == pytest.approx(np.tile([1, 0, 0, 1], (4, 1)))
    assert not scene.textures[0].srgb


def test_textures_without_coordinates_are_ignored(tmp_path, png):
    glb = square_scene(
        textures=[{"source": 0}], materials=[{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
    )
    glb.json["images"] = [{"bufferView": glb.view(png)}]
    glb.json["meshes"][0]["primitives"][0]["material"] = 0
    scene = load_scene(glb.write(tmp_path / "a.glb"))
    assert scene.materials[scene.material_ids[0]].base_texture == -1
    assert any("without texture coordinates" in note for note in scene.notes)


def test_missing_and_damaged_images_are_reported(tmp_path):
    glb = square_scene(textures=[{"source": 0}, {"source": 1}, {"source": 2}])
    empty = b"\0\0\2" + b"\0" * 13 + b"\x18\0"  # a TGA of 0x0 texels
    embedded = [{"bufferView": glb.view(data)} for data in (b"\x89PNG nonsense", empty)]
    glb.json["images"] = [{"uri": "gone.png"}, *embedded]
    slots = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": index}}} for index in range(3)]
    glb.json["materials"] = slots
    scene = load_scene(glb.write(tmp_path / "a.glb"))
    assert [material.base_texture for material in scene.materials[:3]] == [-1] * 3
    assert sum("is left out" in note for note in scene.notes) == 3


def test_cameras_and_their_animation(tmp_path):
    half = np.sqrt(0.5)
    glb = square_scene({"mesh": 0}, {"translation": [0.5, 0.5, 4], "camera": 0})
    glb.json["cameras"] = [{"type": "perspective", "perspective": {"yfov": 1.0, "aspectRatio": 1.5, "znear": 0.1}}]
    times = glb.accessor(np.array([0, 2], np.float32))
    moves = glb.accessor(np.array([[0, 0, 0], [0, 8, 0]], np.float32))
    turns = glb.accessor(np.array([[0, 0, 0, 1], [0, half, 0, half]], np.float32))
    samplers = [{"input": times, "output": moves}, {"input": times, "output": turns}]
    channels = [
        {"sampler": 0, "target": {"node": 1, "path": "translation"}},
        {"sampler": 1, "target": {"node": 1, "path": "rotation"}},
    ]
    glb.json["animations"] = [{"samplers": samplers, "channels": channels}]
    scene = load_scene(glb.write(tmp_path / "a.glb"))
    camera, animation = scene.cameras[0], scene.animations[0]
    assert camera.position == pytest.approx((0, 0, 4))
    assert camera.direction == pytest.approx((0, 0, -1))
    assert camera.fov_x == pytest.approx(np.degrees(2 * np.arctan(1.5 * np.tan(0.5))))
    assert animation.times[-1] == pytest.approx(2000)
    middle = len(animation.times) // 2
    assert animation.positions[middle] == pytest.approx(np.array([0, 4, 0]) - scene.origin)
    assert abs(animation.orientations[middle] @ [0, np.sin(np.pi / 8), 0, np.cos(np.pi / 8)]) == pytest.approx(1)


def test_lights_of_the_file_are_used(tmp_path):
    glb = square_scene({"mesh": 0}, {"extensions": {"KHR_lights_punctual": {"light": 0}}})
    glb.json["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "directional", "intensity": 5e4}]}}
    scene = load_scene(glb.write(tmp_path / "a.glb"))
    assert [light.kind for light in scene.lights] == ["directional"]
    assert scene.lights[0].direction == pytest.approx((0, 0, -1))
    assert scene.exposure * 5e4 < 20  # daylight in lux is brought to the range of the pictures


def test_thousands_of_nodes(tmp_path):
    nodes = [{"mesh": 0, "translation": [column * 2, row * 2, 0]} for row in range(60) for column in range(60)]
    assert load_scene(square_scene(*nodes).write(tmp_path / "a.glb")).triangle_count == 7200


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"nodes": [{"mesh": 0, "children": [1]}, {"children": [0]}]}, "cycle"),
        ({"nodes": [{"children": [2]}, {"children": [2]}, {"mesh": 0}]}, "two parents"),
        ({"nodes": [{"mesh": 7}]}, "damaged"),
        ({"asset": {"version": "1.0"}}, "only glTF 2.0"),
        *(
            ({"extensionsRequired": ["KHR_mesh_quantization", name]}, f"needs {name}, which cannot be read")
            for name in ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_texture_basisu", "MY_own")
        ),
        ({"extensionsRequired": ["A_one", "B_two"]}, "needs A_one and B_two, which"),
        ({"nodes": []}, "no usable triangles"),
    ],
)
def test_unusable_documents_are_named(tmp_path, change, words):
    glb = square_scene()
    glb.json |= change
    with pytest.raises(SceneError, match=words):
        load_scene(glb.write(tmp_path / "a.glb"))


def test_extensions_that_are_only_used_are_noted_by_name(tmp_path):
    glb = square_scene()
    glb.json |= {"extensionsUsed": ["KHR_draco_mesh_compression", "KHR_materials_sheen", "KHR_mesh_quantization"]}
    primitive = glb.json["meshes"][0]["primitives"][0]
    primitive["extensions"] = {"KHR_draco_mesh_compression": {}}  # with uncompressed data beside it
    scene = load_scene(glb.write(tmp_path / "a.glb"))
    assert scene.triangle_count == 2
    ignored = [note for note in scene.notes if "not supported" in note]
    assert [note.split()[3] for note in ignored] == ["KHR_draco_mesh_compression,", "KHR_materials_sheen,"]


@pytest.mark.parametrize("name", ["KHR_draco_mesh_compression", "EXT_meshopt_compression"])
def test_compressed_meshes_without_a_copy_are_refused_by_name(tmp_path, name):
    glb = square_scene()
    if "draco" in name:
        glb.json["meshes"][0]["primitives"][0]["extensions"] = {name: {}}
        del glb.json["accessors"][0]["bufferView"]
    else:
        glb.json["bufferViews"][0] |= {"buffer": 1, "extensions": {name: {}}}
    file = glb.write(tmp_path / "a.glb", [{"byteLength": 48, "extensions": {name: {"fallback": True}}}])
    with pytest.raises(SceneError, match=name):
        load_scene(file)


def test_required_extensions_that_are_read(tmp_path):
    """Quantised corners; a scale in the node brings them back, as exporters have it."""
    required = ["KHR_mesh_quantization", "EXT_texture_webp", "KHR_texture_transform", "KHR_materials_unlit"]
    glb = Glb(nodes=[{"mesh": 0, "scale": [0.01] * 3}], extensionsRequired=required, extensionsUsed=required)
    attributes = {"POSITION": glb.accessor(np.array(SQUARE * 100, np.int16))}
    attributes["NORMAL"] = glb.accessor(np.array([[0, 0, 127]] * 4, np.int8), normalized=True)
    glb.json["meshes"] = [{"primitives": [{"attributes": attributes, "indices": glb.accessor(SQUARE_INDICES)}]}]
    scene = load_scene(glb.write(tmp_path / "a.glb"))
    assert world(scene).max(axis=(0, 1)) == pytest.approx([1, 1, 0])
    assert scene.normals == pytest.approx(np.tile([0, 0, 1], (4, 1)))
    assert not any("not supported" in note for note in scene.notes)


def test_lights_of_unknown_types_are_left_out_by_name(tmp_path):
    glb = square_scene(
        {"mesh": 0}, *({"extensions": {"KHR_lights_punctual": {"light": number}}} for number in range(2))
    )
    spot = {"type": "spot", "range": 5.0, "spot": {"innerConeAngle": 0.1}}
    glb.json["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "area"}, spot]}}
    scene = load_scene(glb.write(tmp_path / "a.glb"))
    assert [light.kind for light in scene.lights] == ["spot"]
    for words in ("unknown type area", "Ranges of lights", "Inner cones"):
        assert any(words in note and "1." in note for note in scene.notes), words


def test_a_surface_of_no_area_is_refused(tmp_path):
    glb = square_scene({"mesh": 0, "scale": [1, 0, 0]})
    with pytest.raises(SceneError, match="no triangle of positive area"):
        load_scene(glb.write(tmp_path / "a.glb"))


def test_bad_vertices_and_indices_are_dropped_and_counted(tmp_path):
    glb = Glb(nodes=[{"mesh": 0}])
    points = np.concatenate([SQUARE, np.array([[np.nan, 0, 0], [0, np.inf, 0], [1e38, 0, 0]], np.float32)])
    extra = np.array([0, 1, 4, 0, 1, 5, 0, 1, 6, 0, 1, 99, 0, 0, 1, 1, 1, 1], np.uint16)
    attributes = {"POSITION": glb.accessor(points)}
    indices = glb.accessor(np.concatenate([SQUARE_INDICES, extra]))
    glb.json["meshes"] = [{"primitives": [{"attributes": attributes, "indices": indices}]}]
    scene = load_scene(glb.write(tmp_path / "a.glb"))
    assert scene.triangle_count == 2
    assert len(scene.positions) == 4
    expected = {"missing vertices": 1, "not a number": 2, "float32": 1, "without any area": 2}
    for words, count in expected.items():
        assert any(words in note and note.endswith(f" {count}.") for note in scene.notes), words
