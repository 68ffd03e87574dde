"""Values of a glTF file that cannot be right are refused in a sentence or noted; no index counts from behind."""

from __future__ import annotations

import copy
import json
import re

import numpy as np
import pytest

from shading_atlas_bench.scenes.load import load_scene
from shading_atlas_bench.scenes.model import Scene, SceneError
from tests.scenes.glb_files import SQUARE, Glb, full_scene, square_scene


def loaded(tmp_path, glb: Glb) -> Scene:
    return load_scene(glb.write(tmp_path / "a.glb"))


def refusal(tmp_path, glb: Glb) -> str:
    """The one sentence with which a file is refused."""
    with pytest.raises(SceneError) as caught:
        loaded(tmp_path, glb)
    sentence = str(caught.value)
    assert "\n" not in sentence
    return sentence


REFERENCES = [
    ("nodes[-1]", "scenes", 0, "nodes", 0),
    ("nodes[-1]", "nodes", 0, "children"),
    ("nodes[-1]", "skins", 0, "joints", 0),
    ("nodes[-1]", "animations", 0, "channels", 0, "target", "node"),
    ("an animation's samplers[-1]", "animations", 0, "channels", 0, "sampler"),
    ("scenes[-1]", "scene"),
    ("meshes[-1]", "nodes", 0, "mesh"),
    ("skins[-1]", "nodes", 1, "skin"),
    ("cameras[-1]", "nodes", 2, "camera"),
    ("lights[-1]", "nodes", 3, "extensions", "KHR_lights_punctual", "light"),
    ("materials[-1]", "meshes", 0, "primitives", 0, "material"),
    ("accessors[-1]", "meshes", 0, "primitives", 0, "attributes", "POSITION"),
    ("accessors[-1]", "meshes", 0, "primitives", 0, "indices"),
    ("textures[-1]", "materials", 0, "pbrMetallicRoughness", "baseColorTexture", "index"),
    ("samplers[-1]", "textures", 0, "sampler"),
    ("bufferViews[-1]", "accessors", 0, "bufferView"),
    ("buffers[-1]", "bufferViews", 0, "buffer"),
]


@pytest.mark.parametrize("reference", REFERENCES, ids=lambda reference: ".".join(map(str, reference[1:])))
@pytest.mark.parametrize("wrong", [-1, 99, 0.5, "0"])
def test_references_to_what_is_not_there_are_refused_by_name(tmp_path, png, reference, wrong):
    named, *path, last = reference
    glb = full_scene(png)
    if wrong == -1:
        assert loaded(tmp_path, copy.deepcopy(glb)).triangle_count == 4
    place = glb.json
    for key in path:
        place = place[key]
    place[last] = [wrong] if last == "children" else wrong
    assert f"has no {named}".replace("-1", repr(wrong)) in refusal(tmp_path, glb)


def test_a_texture_of_an_image_that_is_not_there_is_left_out(tmp_path, png):
    for source, words in (({"source": -1}, "has no images[-1]"), ({}, "Texture 0 names no image")):
        glb = full_scene(png)
        glb.json["textures"] = [source]
        scene = loaded(tmp_path, glb)
        assert not scene.textures
        assert any(words in note for note in scene.notes)
    glb = full_scene(png)
    glb.json["images"] = [{}]
    assert "Image 0 is left out: it has neither data nor the name of a file." in loaded(tmp_path, glb).notes


@pytest.mark.parametrize(
    ("material", "words"),
    [
        ({"pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0]}}, r"baseColorFactor is \[1, 0, 0\], not a list of 4"),
        ({"pbrMetallicRoughness": {"roughnessFactor": "rough"}}, "roughnessFactor is 'rough', not a number"),
        ({"pbrMetallicRoughness": {"metallicFactor": True}}, "metallicFactor is True, not a number"),
        ({"emissiveFactor": [1, 1]}, r"emissiveFactor is \[1, 1\], not a list of 3 numbers"),
        ({"emissiveFactor": 1}, "emissiveFactor is 1, not a list"),
        ({"alphaCutoff": [0.5]}, "alphaCutoff"),
        ({"extensions": {"KHR_materials_transmission": {"transmissionFactor": None}}}, "transmissionFactor is None"),
        ({"extensions": {"KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [1] * 3}}}, "diffuseFactor"),
        ({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "texCoord": -1}}}, "texCoord is -1"),
        *(
            (
                {
                    "pbrMetallicRoughness": {
                        "baseColorTexture": {"index": 0, "extensions": {"KHR_texture_transform": it}}
                    }
                },
                next(iter(it)),
            )
            for it in ({"offset": [1]}, {"scale": 2}, {"rotation": [1]})
        ),
    ],
)
def test_values_of_materials_of_the_wrong_kind_are_refused_by_name(tmp_path, png, material, words):
    glb = full_scene(png)
    glb.json["materials"] = [material]
    assert re.search(words, refusal(tmp_path, glb))


@pytest.mark.parametrize(
    ("node", "words"),
    [
        ({"matrix": [1] * 15}, "matrix is .* not a list of 16 numbers"),
        ({"translation": [1, 2]}, "translation"),
        ({"rotation": [0, 0, 1]}, "rotation"),
        ({"scale": 2}, "scale is 2"),
        ({"weights": ["1"]}, "weights"),
    ],
)
def test_values_of_nodes_of_the_wrong_kind_are_refused_by_name(tmp_path, node, words):
    assert re.search(words, refusal(tmp_path, square_scene({"mesh": 0, **node})))


@pytest.mark.parametrize(
    ("light", "words"),
    [
        ({"color": [1, 1]}, "color"),
        ({"intensity": "5"}, "intensity is '5'"),
        ({"spot": {"outerConeAngle": None}}, "outerConeAngle"),
    ],
)
def test_values_of_lights_of_the_wrong_kind_are_refused_by_name(tmp_path, png, light, words):
    glb = full_scene(png)
    glb.json["extensions"]["KHR_lights_punctual"]["lights"] = [{"type": "spot", **light}]
    assert re.search(words, refusal(tmp_path, glb))


@pytest.mark.parametrize(("lens", "noted"), [({"yfov": -1}, 1), ({"yfov": 4}, 1), ({"yfov": 1, "aspectRatio": 0}, 1)])
def test_cameras_without_a_usable_field_of_view_get_the_usual_one(tmp_path, png, lens, noted):
    glb = full_scene(png)
    glb.json["cameras"] = [{"type": "perspective", "perspective": lens}]
    scene = loaded(tmp_path, glb)
    assert scene.cameras[0].fov_x is None
    assert f"Cameras whose field of view is none, used with the usual one: {noted}." in scene.notes


def test_unknown_modes_are_noted(tmp_path, png):
    glb = full_scene(png)
    glb.json["materials"][0]["alphaMode"] = "mask"
    glb.json["samplers"] = [{"wrapS": 12345}]
    scene = loaded(tmp_path, glb)
    assert scene.materials[0].alpha_mode == "opaque"
    assert "An unknown alphaMode of mask is taken for opaque." in scene.notes
    assert "An unknown wrapS of 12345 is taken for repeat." in scene.notes


def test_orthographic_cameras_nearest_samplers_and_further_colours_are_noted(tmp_path, png):
    glb = full_scene(png)
    glb.json["cameras"] = [{"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1}}]
    glb.json["samplers"] = [{"minFilter": 9728}]
    attributes = glb.json["meshes"][0]["primitives"][0]["attributes"]
    attributes |= {"COLOR_0": glb.accessor(np.ones((4, 3), np.float32)), "COLOR_1": attributes["WEIGHTS_0"]}
    scene = loaded(tmp_path, glb)
    assert "Orthographic cameras, used as perspective ones: 1." in scene.notes
    assert "Textures whose sampler asks for the nearest texel, interpolated all the same: 1." in scene.notes
    assert "Primitives whose further colours COLOR_1 are not used: 2." in scene.notes


@pytest.mark.parametrize(
    ("name", "values", "words"),
    [
        ("POSITION", SQUARE[:, :2], "POSITION has entries of type VEC2, not VEC3"),
        ("POSITION", SQUARE[:, 0], "POSITION has entries of type SCALAR"),
        ("NORMAL", SQUARE[:, :2], "NORMAL"),
        ("TANGENT", SQUARE, "TANGENT has entries of type VEC3, not VEC4"),
        ("TEXCOORD_0", SQUARE, "TEXCOORD_0"),
        ("COLOR_0", SQUARE[:, :2], "COLOR_0 has entries of type VEC2, not VEC3 or VEC4"),
        ("COLOR_0", SQUARE[:3], "COLOR_0 has 3 entries where 4 belong"),
    ],
)
def test_attributes_of_the_wrong_kind_are_refused_by_name(tmp_path, name, values, words):
    glb = square_scene()
    glb.json["meshes"][0]["primitives"][0]["attributes"][name] = glb.accessor(np.ascontiguousarray(values))
    assert re.search(words, refusal(tmp_path, glb))


@pytest.mark.parametrize(
    ("indices", "words"),
    [
        (np.array([0, 1.5, 2], np.float32), "indices has entries of float32, not unsigned integers"),
        (np.array([0, 1, -1], np.int16), "int16"),
        (np.array([[0, 1, 2]], np.uint16), "indices has entries of type VEC3, not SCALAR"),
    ],
)
def test_indices_are_unsigned_integers(tmp_path, indices, words):
    glb = square_scene()
    glb.json["meshes"][0]["primitives"][0]["indices"] = glb.accessor(indices)
    assert re.search(words, refusal(tmp_path, glb))


def test_one_entry_does_not_stand_for_many(tmp_path):
    """One displacement for four vertices, one scale for two instances, one inverse bind matrix for two joints."""
    one = SQUARE[:1] + 1
    glb = square_scene(meshes=[])
    glb.json["meshes"] = [
        {"weights": [1], "primitives": [{**glb.square(), "targets": [{"POSITION": glb.accessor(one)}]}]}
    ]
    assert "POSITION has 1 entries where 4 belong" in refusal(tmp_path, glb)
    glb = square_scene()
    places = {"TRANSLATION": glb.accessor(SQUARE[:2]), "SCALE": glb.accessor(one)}
    glb.json["nodes"][0]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": places}}
    assert "SCALE has 1 entries where 2 belong" in refusal(tmp_path, glb)
    glb = square_scene({"mesh": 0, "skin": 0})
    glb.json["skins"] = [{"joints": [0, 0], "inverseBindMatrices": glb.accessor(np.eye(4, dtype=np.float32)[None])}]
    assert "2 joints but 1 inverse bind matrices" in refusal(tmp_path, glb)


def test_colours_that_are_not_marked_as_normalised_are_read_as_if_they_were(tmp_path):
    glb = square_scene()
    colours = glb.accessor(np.array([[255, 0, 51, 255]] * 4, np.uint8))
    glb.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = colours
    scene = loaded(tmp_path, glb)
    assert scene.colours[0] == pytest.approx([1, 0, 0.2, 1])
    assert any("COLOR_0 that are not marked as normalised" in note for note in scene.notes)


def test_morph_targets_move_colours_coordinates_and_tangents(tmp_path, png):
    """Coordinates before the texture's transform, colours within 0..1; the side of a tangent stays."""
    glb = full_scene(png)
    info = {"index": 0, "extensions": {"KHR_texture_transform": {"scale": [2, 2]}}}
    glb.json["materials"] = [{"normalTexture": info, "pbrMetallicRoughness": {"baseColorTexture": info}}]
    primitive = glb.json["meshes"][0]["primitives"][0]
    own = {"COLOR_0": [1, 1, 1, 1], "TANGENT": [1, 0, 0, -1]}
    moved = {"COLOR_0": [0.5, -0.5, -4], "TANGENT": [-2, 2, 0], "TEXCOORD_0": [0.5, 0.25], "COLOR_2": [1, 1, 1]}
    store = {name: glb.accessor(np.array([value] * 4, np.float32)) for name, value in own.items()}
    primitive["attributes"] |= store
    primitive["targets"] = [{name: glb.accessor(np.array([value] * 4, np.float32)) for name, value in moved.items()}]
    glb.json["meshes"][0]["weights"] = [0.5]
    scene = loaded(tmp_path, glb)
    assert scene.colours == pytest.approx(np.tile([1, 0.75, 0, 1], (8, 1)))
    assert scene.uvs[:4] == pytest.approx(2 * (SQUARE[:, :2] + [0.25, 0.125]))
    assert scene.tangents == pytest.approx(np.tile([0, 1, 0, -1], (8, 1)))
    assert "Morph targets of COLOR_2 where there is no COLOR_2 to move, not used: 2." in scene.notes


USING_IT = (
    '"bufferViews": [{"buffer": 0}], "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}], '
    '"accessors": [{"bufferView": 0, "componentType": 5126, "count": 1, "type": "VEC3"}], "nodes": [{"mesh": 0}]}'
)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", r"damaged or incomplete \(it is empty\)\.$"),
        ("\n{]", r"\(its JSON is wrong in line 2, column 2\)\.$"),
        (b'{"\xff": 1}', r"\(its JSON is not UTF-8\)\.$"),
        ('{"asset": 5}', r"it is damaged, a value in it is of another kind than its format has\.$"),
        ('{"buffers": [{"uri": "data:,AAA"}], ' + USING_IT, r"\(the text of a data URI is not base64\)\.$"),
        ("[" * 100_000, "nested too deeply"),
        ('{"asset": {"version": "2.0"}, "nodes": {"a": 1}}', "its nodes are not a list of objects"),
        ('{"asset": {"version": "2.0"}, "meshes": [3]}', "its meshes are not a list of objects"),
    ],
)
def test_json_of_another_shape_is_refused(tmp_path, text, words):
    (tmp_path / "a.gltf").write_bytes(text.encode() if isinstance(text, str) else text)
    with pytest.raises(SceneError, match=words):
        load_scene(str(tmp_path / "a.gltf"), cache=tmp_path / "cache")


def test_a_node_is_drawn_once_however_often_a_scene_names_it(tmp_path):
    glb = square_scene({"mesh": 0, "children": [1]}, {"mesh": 0, "translation": [2, 0, 0]})
    glb.json["scenes"] = [{"nodes": [1, 0, 1, 0]}]
    assert loaded(tmp_path, glb).triangle_count == 4


@pytest.mark.parametrize("length", [1, 10**15, -1, "36"])
def test_a_buffer_is_as_long_as_it_says(tmp_path, length):
    """Longer it may be: in a GLB container it is filled up to a multiple of 4 bytes."""
    glb = square_scene()
    claim = {**glb.json, "buffers": [{"byteLength": length, "uri": "a.bin"}]}
    (tmp_path / "a.bin").write_bytes(glb.data)
    (tmp_path / "a.gltf").write_text(json.dumps(claim), encoding="utf-8")
    if length == 1:
        assert load_scene(str(tmp_path / "a.gltf")).triangle_count == 2
        return
    found = f"{len(glb.data)} bytes, fewer than its byteLength of 1,000,000,000,000,000; the file is cut off or damaged"
    words = f"buffer 0 has {found}" if length == 10**15 else f"byteLength is {length!r}, not a whole number"
    with pytest.raises(SceneError, match=words):
        load_scene(str(tmp_path / "a.gltf"))


def test_a_broken_image_is_named(tmp_path):
    """By its file, or else by its own name."""
    (tmp_path / "wood.png").write_bytes(b"no image")
    data = "data:image/png;base64,AAAA"
    for image, named in (
        ({"uri": "wood.png", "name": "planks"}, " (wood.png)"),
        ({"uri": data, "name": "planks"}, " (planks)"),
        ({"uri": data}, ""),
        ({"uri": 5, "name": 6}, " (5)"),
    ):
        glb = full_scene(b"")
        glb.json["images"] = [image]
        (note,) = [note for note in loaded(tmp_path, glb).notes if "left out" in note]
        assert note.startswith(f"Image 0{named} is left out: the ")


@pytest.mark.parametrize("kind", [9, 5126.0, "5126", [5126]])
def test_an_unknown_type_of_numbers_is_named(tmp_path, kind):
    glb = square_scene()
    glb.json["accessors"][0]["componentType"] = kind
    assert f"componentType is {kind!r}, none of 5120, 5121, 5122, 5123, 5125, 5126" in refusal(tmp_path, glb)


def test_sentences_stay_short(tmp_path):
    """Where words belong, text of any length may stand."""
    for change in (
        {"asset": {"version": "9" * 10_000}},
        {"buffers": [{"uri": "n" * 10_000}]},
        {"extensionsRequired": ["n" * 10_000] * 100},
    ):
        glb = square_scene()
        text = json.dumps({**glb.json, "buffers": [{"uri": "data:;base64,AAAA", "byteLength": 3}], **change})
        (tmp_path / "a.gltf").write_text(text, encoding="utf-8")
        with pytest.raises(SceneError) as caught:
            load_scene(str(tmp_path / "a.gltf"))
        assert len(str(caught.value)) < 2000
    glb = square_scene()
    glb.json["accessors"][0]["type"] = "n" * 10_000
    assert len(refusal(tmp_path, glb)) < 2000
