"""OBJ, PLY, STL and OFF files, `cameras.json`, units, places and objects."""

import json

import numpy as np
import pytest

from shading_atlas_bench.scenes.load import load_scene
from shading_atlas_bench.scenes.model import SceneError
from shading_atlas_bench.scenes.polygons import triangulate
from tests.scenes.checks import area, inputs_of

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"


def box(size: float, inwards: bool) -> str:
    """An OBJ box from the origin, its fronts outside or inside."""
    corners = [(x, y, z) for x in (0, size) for y in (0, size) for z in (0, size)]
    faces = [(1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)]
    lines = [f"v {x} {y} {z}" for x, y, z in corners]
    return "\n".join(lines + ["f " + " ".join(map(str, face[::-1] if inwards else face)) for face in faces])


@pytest.mark.parametrize(
    "text",
    [
        "v\t0 0  0\r\nv\t1 0 0\r\nv\t1 1 0 # corner\r\nv 0\t1 0\r\nf 1 2 3 4\r\n",
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf -4 -3 -2\nf -4 -2 -1\nv 9 9 9\n",
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 \\\n 3 4\n",
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvn 0 0 1\nf 1//1 2//1 3//1 4//1\n",
    ],
    ids=["tabs", "backwards", "continued", "normals"],
)
def test_obj_dialects(tmp_path, text):
    (tmp_path / "a.obj").write_text(text, encoding="utf-8")
    scene = load_scene(str(tmp_path / "a.obj"))
    assert scene.triangle_count == 2
    assert area(scene) == pytest.approx(1)
    assert scene.normals == pytest.approx(np.tile([0, 0, 1], (len(scene.normals), 1)))


def test_obj_materials_textures_and_masks(tmp_path, png):
    (tmp_path / "picture one.png").write_bytes(png)
    library = "newmtl glass\nKd 0.1 0.2 0.3\nd 0.5\n\nnewmtl\tleaf\nKd 0 0 0\nmap_Kd -s 1 1 1 picture one.png\n"
    (tmp_path / "a.mtl").write_text(library + "map_d picture one.png\nnewmtl lost\nmap_Kd gone.png\n", encoding="utf-8")
    faces = (
        "vt 0 0\nvt 1 0\nvt 0 1\nusemtl glass\nf 1/1 2/2 3/3\nusemtl leaf\nf 1/1 2/2 3/3\nusemtl lost\nf 1/1 2/2 3/3\n"
    )
    (tmp_path / "a.obj").write_text(
        f"mtllib a.mtl\nmtllib none.mtl\n{TRIANGLE}{faces}usemtl who\nf 1/1 2/2 3/3\n", encoding="utf-8"
    )
    scene = load_scene(str(tmp_path / "a.obj"))
    by_name = {scene.materials[index].name: scene.materials[index] for index in scene.material_ids}
    assert by_name["glass"].base_colour == (0.1, 0.2, 0.3, 0.5)
    assert by_name["glass"].alpha_mode == "blend"
    assert by_name["leaf"].base_colour[:3] == (1, 1, 1)
    assert by_name["leaf"].alpha_mode == "mask"
    assert by_name["lost"].base_texture == -1
    assert "who" in by_name
    assert scene.textures[0].texels[0, 1].tolist() == [0, 0, 255, 128]
    assert any("none.mtl is missing" in note for note in scene.notes)
    assert any("gone.png is left out: the file is missing" in note for note in scene.notes)
    assert scene.uvs[:3, 1].tolist() == [1, 1, 0]  # row 0 of an image is its upper edge


def test_concave_polygons_are_not_filled(tmp_path):
    """An L of area 3 in the square of side 2, and a square ring of area 12 with a bridge between its outlines."""
    shape = [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]
    (tmp_path / "l.obj").write_text("\n".join(f"v 0 {x} {y}" for x, y in shape) + "\nf 1 2 3 4 5 6\n", encoding="utf-8")
    assert area(load_scene(str(tmp_path / "l.obj"))) == pytest.approx(3)
    outer, inner = [(0, 0), (4, 0), (4, 4), (0, 4)], [(1, 1), (1, 3), (3, 3), (3, 1)]
    ring = np.array([(*p, 0) for p in [*outer, outer[0], inner[0], *inner[1:], inner[0]]], float)
    corners = ring[np.array(triangulate(ring))]
    assert np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2].sum() / 2 == pytest.approx(12)


@pytest.mark.parametrize("kind", ["stl", "ply", "off"])
def test_other_formats_with_sharp_and_smooth_edges(tmp_path, kind):
    """A cube keeps its flat faces, a fine sphere is smooth, both without normals in the file."""
    import trimesh

    file = tmp_path / f"a.{kind}"
    trimesh.creation.box((1, 2, 3)).export(file)
    cube = load_scene(str(file))
    assert area(cube) == pytest.approx(22, rel=1e-5)
    assert np.abs(cube.normals).max(axis=1) == pytest.approx(np.ones(24))
    trimesh.creation.icosphere(3).export(file)
    ball = load_scene(str(file))
    centred = ball.positions / np.linalg.norm(ball.positions, axis=1, keepdims=True)
    assert len(ball.positions) == 642
    assert np.einsum("vi,vi->v", centred, ball.normals).min() > 0.999


def test_ply_colours_are_linear(tmp_path):
    rows = "0 0 0 255 0 188\n1 0 0 255 0 188\n0 1 0 255 0 188\n"
    names = "".join(f"property float {axis}\n" for axis in "xyz")
    names += "".join(f"property uchar {colour}\n" for colour in ("red", "green", "blue"))
    header = f"ply\nformat ascii 1.0\nelement vertex 3\n{names}element face 1\n"
    (tmp_path / "a.ply").write_text(
        f"{header}property list uchar int vertex_indices\nend_header\n{rows}3 0 1 2\n", encoding="utf-8"
    )
    assert load_scene(str(tmp_path / "a.ply")).colours[0] == pytest.approx([1, 0, 0.503, 1], abs=1e-3)


def test_cameras_json_gives_cameras_and_scale(tmp_path):
    (tmp_path / "room.obj").write_text(box(8, inwards=True), encoding="utf-8")
    camera = {"eye": [4, 2, 4], "dir": [0, 0, -2], "fov_x_deg": 70}
    (tmp_path / "cameras.json").write_text(json.dumps({"metres_per_unit": 0.5, "cameras": [camera]}), encoding="utf-8")
    scene = load_scene(str(tmp_path / "room.obj"))
    assert scene.metres_per_unit == 0.5
    assert scene.place
    assert np.array(scene.cameras[0].position) + scene.origin == pytest.approx([4, 2, 4])
    assert scene.cameras[0].direction == (0, 0, -1)
    assert [light.kind for light in scene.lights] == ["spot"] * 3
    low, high = scene.bounds
    assert all(((low < light.position) & (light.position < high)).all() for light in scene.lights)


@pytest.mark.parametrize(("inwards", "size", "place"), [(True, 8, True), (False, 8, False), (True, 2, False)])
def test_rooms_are_places_and_blocks_are_objects(tmp_path, inwards, size, place):
    (tmp_path / "a.obj").write_text(box(size, inwards), encoding="utf-8")
    scene = load_scene(str(tmp_path / "a.obj"))
    assert scene.place == place
    assert {light.kind for light in scene.lights} == ({"spot"} if place else {"directional"})


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("{\n 1", "is no valid JSON: line 2, column 2"),
        ("[]", "cannot be used"),
        ('{"metres_per_unit": -1}', "above 0"),
        ('{"metres_per_unit": "cubit"}', '"cubit": give a number above 0, or one of m, cm'),
        ('{"cameras": {}}', "expected array, got object, at cameras"),
        ('{"cameras": [[]]}', "expected object, got array, at cameras.0."),
        ('{"cameras": [{"eye": [0, 0]}]}', "array of length 3, got 2, at cameras.0..eye"),
        ('{"cameras": [{"eye": [0, 0, 0]}]}', "missing required field dir, at cameras.0."),
        ('{"cameras": [{"eye": [0, 0, true], "dir": [0, 0, 1]}]}', "expected float, got bool, at cameras.0..eye.2."),
        ('{"cameras": [{"eye": [0, 0, "1"], "dir": [0, 0, 1]}]}', "expected float, got str, at cameras.0..eye.2."),
        ('{"cameras": [{"eye": [0, 0, 1e999], "dir": [0, 0, 1]}]}', "camera 0 has no usable eye"),
        ('{"cameras": [{"eye": [0, 0, 0], "dir": [0, 0, 1], "fov": 9}]}', "unknown field fov, .*may be eye.*fov_x_deg"),
        ('{"cameras": [{"eye": [0, 0, 0], "dir": [0, 0, 1], "fov_x_deg": NaN}]}', "fov_x_deg of nan, not between"),
        ('{"metres_per_unit": true}', "got bool, at metres_per_unit"),
        ('{"metres_per_unit": 1e999}', "above 0"),
        (f'{{"metres_per_unit": 1{"0" * 400}}}', "cannot be used"),
        ('{"meters_per_unit": 2}', "unknown field meters_per_unit.*there may be metres_per_unit, cameras"),
        ('{"cameras": [{"eye": [0,0,0], "dir": [0,0,0]}]}', "no usable dir"),
    ],
)
def test_unusable_cameras_json_is_named(tmp_path, content, words):
    (tmp_path / "a.obj").write_text(f"{TRIANGLE}f 1 2 3\n", encoding="utf-8")
    (tmp_path / "cameras.json").write_text(content, encoding="utf-8")
    with pytest.raises(SceneError, match=rf"cameras\.json .*{words}"):
        load_scene(str(tmp_path / "a.obj"))


def test_backslashes_in_obj_and_mtl_files(tmp_path, png):
    (tmp_path / "textures").mkdir()
    (tmp_path / "textures" / "a.png").write_bytes(png)
    (tmp_path / "textures" / "a.mtl").write_text("newmtl m\nmap_Kd ..\\textures\\a.png\n", encoding="utf-8")
    text = "mtllib textures\\a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n"
    (tmp_path / "a.obj").write_text(text, encoding="utf-8")
    scene = load_scene(str(tmp_path / "a.obj"))
    assert scene.textures[0].texels[0, 1].tolist() == [0, 0, 255, 128]
    assert inputs_of(tmp_path / "a.obj") == {
        "textures\\a.mtl": "textures/a.mtl",
        "..\\textures\\a.png": "textures/../textures/a.png",
        "cameras.json": None,
    }


def test_backslashes_in_gltf_files(tmp_path):
    (tmp_path / "data").mkdir()
    corners = b"\0\0\0\0" * 3 + b"\0\0\x80\x3f" + b"\0\0\0\0" * 3 + b"\0\0\x80\x3f" + b"\0\0\0\0"
    (tmp_path / "data" / "a b.bin").write_bytes(corners)
    document = {
        "asset": {"version": "2.0"},
        "buffers": [{"uri": "data\\a%20b.bin", "byteLength": 36}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
    }
    (tmp_path / "a.gltf").write_text(json.dumps(document), encoding="utf-8")
    assert load_scene(str(tmp_path / "a.gltf")).triangle_count == 1
    assert inputs_of(tmp_path / "a.gltf") == {"data\\a b.bin": "data/a b.bin", "cameras.json": None}
