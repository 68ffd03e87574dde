"""What OBJ, MTL, PLY, OFF and STL files may hold: read as their formats say, or named in a note."""

import os
import struct
from pathlib import Path

import numpy as np
import pytest

from shading_atlas_bench.scenes.load import load_scene
from shading_atlas_bench.scenes.model import Material, Scene, SceneError
from shading_atlas_bench.scenes.mtl import map_statement
from shading_atlas_bench.scenes.polygons import triangulated
from shading_atlas_bench.scenes.raw import RawScene
from tests.conftest import REAL_SCENES
from tests.scenes.checks import area, inputs_of

CASES = REAL_SCENES.parent / "cases"
SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
FACE = "f 1/1 2/2 3/3 4/4\n"
CHEVRON = [(-1, 1, 0), (0, -1, 0), (1, 1, 0), (0, -0.5, 0)]  # area 0.5
PENTAGON = [(1, 1, 0), (0, -0.8, 0), (-1, 1, 0), (-1, -1, 0), (1, -1, 0)]  # area 2.2
RED, BLUE = (1, 0, 0, 1), (0, 0, 1, 1)


def load(path: Path, content: str | bytes) -> Scene:
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return load_scene(str(path))


def load_with(folder: Path, library: str | bytes, body: str = SQUARE + "usemtl m\n" + FACE) -> Scene:
    """An OBJ file, by default one textured square, with a library."""
    (folder / "a.mtl").write_bytes(library if isinstance(library, bytes) else library.encode())
    return load(folder / "a.obj", f"mtllib a.mtl\n{body}")


def used(scene: Scene) -> list[Material]:
    """The materials of the triangles, in their order."""
    return [scene.materials[index] for index in scene.material_ids]


def notes(scene: Scene) -> str:
    return " ".join(scene.notes)


def ply(vertex: str, rows: str, face: str = "", faces: str = "3 0 1 2\n", more: str = "") -> str:
    """A PLY text of properties ("float x, ...") and rows; `more` comes before the elements."""
    properties = [[f"property {line}\n" for line in text.split(", ") if line] for text in (vertex, face)]
    return (
        f"ply\nformat ascii 1.0\n{more}element vertex {len(rows.splitlines())}\n{''.join(properties[0])}"
        f"element face {len(faces.splitlines())}\nproperty list uchar int vertex_indices\n{''.join(properties[1])}"
        f"end_header\n{rows}{faces}"
    )


XYZ = "float x, float y, float z"
CORNERS = "0 0 0\n1 0 0\n0 1 0\n"


def coloured(kind: str, values: str) -> str:
    rows = "".join(f"{row} {values}\n" for row in CORNERS.splitlines())
    return ply(f"{XYZ}, {kind} red, {kind} green, {kind} blue", rows)


@pytest.mark.parametrize(("points", "size"), [(CHEVRON, 0.5), (CHEVRON[1:] + CHEVRON[:1], 0.5), (PENTAGON, 2.2)])
@pytest.mark.parametrize("kind", ["obj", "ply", "off"])
def test_concave_polygons_in_every_format(tmp_path, kind, points, size):
    rows, many = "".join("{} {} {}\n".format(*point) for point in points), len(points)
    corners = " ".join(map(str, range(many)))
    text = {
        "obj": "".join(f"v {row}\n" for row in rows.splitlines()) + f"f {' '.join(str(i + 1) for i in range(many))}\n",
        "ply": ply(XYZ, rows, faces=f"{many} {corners}\n"),
        "off": f"OFF\n{many} 1 0\n{rows}{many} {corners}\n",
    }[kind]
    assert area(load(tmp_path / f"a.{kind}", text)) == pytest.approx(size)


def test_polygons_keep_their_order_and_crossing_ones_are_counted():
    points = np.array([*CHEVRON, *PENTAGON, (0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)], float)
    counts = np.array([3, 4, 5, 4, 3])
    corners = np.array([0, 1, 2, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 9, 10, 12])
    raw = RawScene()
    triangles, polygon = triangulated(points, corners, counts, raw)
    assert polygon.tolist() == [0, 1, 1, 2, 2, 2, 3, 3, 4]
    assert raw.notes() == ["Polygons whose edges cross or that are too intricate, cut into fans: 1."]
    first = np.cumsum(counts) - counts
    assert ((triangles >= first[polygon, None]) & (triangles < (first + counts)[polygon, None])).all()


def test_obj_faces_without_texture_coordinates_do_not_take_them_from_others(tmp_path, png):
    (tmp_path / "a.png").write_bytes(png)
    scene = load_with(tmp_path, "newmtl m\nmap_Kd a.png\n", f"{SQUARE}usemtl m\nf 1 2 3\nf 1/1 3/3 4/4\nf 1/1 2 3/3\n")
    assert sorted(material.base_texture for material in used(scene)) == [-1, -1, 0]
    textured = scene.uvs[scene.indices[[material.base_texture == 0 for material in used(scene)]]]
    assert textured.tolist() == [[[0, 1], [1, 0], [0, 0]]]
    assert "Faces with texture coordinates that are missing at some corners, drawn without them: 1." in scene.notes
    plain = load_with(tmp_path, "newmtl m\n", f"{SQUARE}usemtl m\nf 1 2 3\nf 1/1 3/3 4/4\n")
    assert len(plain.positions) == 4  # coordinates that nothing needs do not take faces apart


@pytest.mark.parametrize(
    ("statement", "expected"),
    [
        ("a b.png", ((1, 1), (0, 0), False, [])),
        ("-s 2 3 1 a b.png", ((2, 3), (0, 0), False, [])),
        ("-s 2 3 a b.png", ((2, 3), (0, 0), False, [])),
        ("-s 2 a b.png", ((2, 1), (0, 0), False, [])),
        ("-o .5 -1e-1 0 -s 2 a b.png", ((2, 1), (0.5, -0.1), False, [])),
        ("-clamp on a b.png", ((1, 1), (0, 0), True, [])),
        ("-CLAMP off a b.png", ((1, 1), (0, 0), False, [])),
        ("-blendu on -blendv on -mm 0 1 -bm 1 -cc off -boost 0 -t 0 0 a b.png", ((1, 1), (0, 0), False, [])),
        (
            "-blendu off -blendv off -mm 0 2 -bm 2 a b.png",
            ((1, 1), (0, 0), False, ["-blendu", "-blendv", "-mm", "-bm"]),
        ),
        ("-cc on -boost 2 -t 1 -texres 512 a b.png", ((1, 1), (0, 0), False, ["-cc", "-boost", "-t", "-texres"])),
        ("-imfchan r -type sphere a b.png", ((1, 1), (0, 0), False, ["-imfchan", "-type"])),
        ("-clamp a b.png", ((1, 1), (0, 0), False, [])),
        ("-s 1 1 1 5", ((1, 1), (0, 0), False, [])),
    ],
)
def test_options_of_maps_never_swallow_the_name(statement, expected):
    found = map_statement(statement.encode())
    assert found.name == (b"5" if statement.endswith("5") else b"a b.png")
    assert (found.scale, found.offset, found.clamped, found.ignored) == expected


def test_map_options_are_applied_or_named(tmp_path, png):
    (tmp_path / "a.png").write_bytes(png)
    scene = load_with(
        tmp_path, "newmtl m\nmap_Kd -s 2 3 -o 0.5 0.25 -clamp on -boost 2 a.png\nKs 1 1 1\nmap_Bump b.png\n"
    )
    texture = scene.textures[used(scene)[0].base_texture]
    assert (texture.wrap_s, texture.wrap_t) == ("clamp", "clamp")
    by_place = dict(zip(map(tuple, (scene.positions[:, :2] + 0.5).tolist()), scene.uvs.tolist(), strict=True))
    assert by_place == {(0, 0): [0.5, 0.75], (1, 0): [2.5, 0.75], (1, 1): [2.5, -2.25], (0, 1): [0.5, -2.25]}
    assert "The option -boost of map_Kd of the material m is left out." in scene.notes
    assert "Statements of materials in a.mtl that are not supported, left out: Ks (1), map_bump (1)." in scene.notes


def test_maps_that_lie_differently_are_named(tmp_path, png):
    (tmp_path / "a.png").write_bytes(png)
    scene = load_with(tmp_path, "newmtl m\nKe 1 1 1\nmap_Kd -s 2 2 a.png\nmap_Ke a.png\n")
    assert used(scene)[0].emissive_texture == -1
    assert "map_Ke of the material m is left out" in notes(scene)
    same = load_with(tmp_path, "newmtl m\nKe 1 1 1\nmap_Kd -s 2 2 a.png\nmap_Ke -s 2 2 a.png\n")
    assert used(same)[0].emissive_texture == used(same)[0].base_texture == 0


def test_a_mask_without_a_picture_and_a_picture_without_its_mask(tmp_path, png):
    (tmp_path / "a.png").write_bytes(png)
    mask = load_with(tmp_path, "newmtl m\nKd 0 0.5 0\nmap_d a.png\n")
    assert used(mask)[0].alpha_mode == "mask"
    assert mask.textures[0].texels.tolist() == [[[255, 255, 255, 255], [255, 255, 255, 0]]]
    picture = load_with(tmp_path, "newmtl m\nmap_Kd a.png\nmap_d gone.png\n")
    assert used(picture)[0].alpha_mode == "opaque"
    assert used(picture)[0].base_texture == 0
    assert "The texture gone.png is left out: the file is missing." in picture.notes


def test_unusual_statements_of_materials_are_named(tmp_path):
    scene = load_with(tmp_path, "newmtl m\nKd xyz 1 1 1\nd -halo 0.5\nmap_Kd\nmap_Ke -s 2\nTf 1 0 1\nKs 0 0 0\n")
    assert used(scene)[0].base_colour == (0.8, 0.8, 0.8, 0.5)
    assert "Kd of the material m is not three numbers and left out." in scene.notes
    assert "The option -halo of d of the material m is left out." in scene.notes
    assert "The texture 2 is left out: the file is missing." in scene.notes
    assert "Statements of materials in a.mtl that are not supported, left out: Tf (1)." in scene.notes
    solid = load_with(tmp_path, "newmtl m\nKd 1 0 0 # red\nd solid\n")
    assert used(solid)[0].base_colour == RED
    assert "The opacity of the material m is no number and left out." in solid.notes


@pytest.mark.parametrize(
    ("defined", "asked"),
    [
        (["Material #25", "Material #26"], ["Material #25", "Material #26"]),
        (["a", "b"], ["a  ", "b # comment"]),
        (["a # comment", "b"], ["a", "b\t"]),
        (["a b", "a  b"], ["a b", "a  b"]),
        (["M\xf6", "M\xe4"], ["M\xf6", "M\xe4"]),
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8", "latin-1"])
def test_names_of_materials(tmp_path, defined, asked, encoding):
    (tmp_path / "a.mtl").write_bytes(f"newmtl {defined[0]}\nKd 1 0 0\nnewmtl {defined[1]}\nKd 0 0 1\n".encode(encoding))
    text = f"mtllib a.mtl\n{SQUARE}usemtl {asked[0]}\nf 1 2 3\nusemtl {asked[1]}\nf 1 3 4\n"
    scene = load(tmp_path / "a.obj", text.encode(encoding))
    assert [material.base_colour for material in used(scene)] == [RED, BLUE]
    assert "no library defines" not in notes(scene)


@pytest.mark.parametrize("encoding", ["utf-8", "latin-1", "cp932"])
@pytest.mark.parametrize("on_disk", ["utf-8", "same"])
def test_names_of_files_in_other_encodings(tmp_path, png, encoding, on_disk):
    """The second name ends in a byte that is a backslash on its own, and the line in another."""
    library, picture = ("Möbel.mtl", "Stück.png") if encoding != "cp932" else ("家ソ.mtl", "表ソ.png")
    stored = "utf-8" if on_disk == "utf-8" else encoding
    material = "ö" if encoding != "cp932" else "ソ"
    try:
        for name, content in ((library, f"newmtl {material}\nmap_Kd {picture}\n".encode(encoding)), (picture, png)):
            Path(os.fsdecode(os.fsencode(tmp_path) + b"/" + name.encode(stored))).write_bytes(content)
    except (OSError, UnicodeDecodeError):
        pytest.skip("this file system holds no such names")
    scene = load(tmp_path / "a.obj", f"mtllib {library}\n{SQUARE}usemtl {material}\n{FACE}".encode(encoding))
    assert used(scene)[0].base_texture == 0
    assert [found for found in inputs_of(tmp_path / "a.obj").values() if not found] == [None]  # cameras.json
    for _ in range(2):
        assert load_scene(str(tmp_path / "a.obj"), cache=tmp_path / "cache").content_hash == scene.content_hash
    notes(scene).encode()


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_byte_order_marks(tmp_path, encoding):
    (tmp_path / "ä.mtl").write_bytes("newmtl ö\nKd 1 0 0\n".encode(encoding))
    scene = load(tmp_path / "a.obj", f"mtllib ä.mtl\r\n{SQUARE}usemtl ö\r\n{FACE}".encode(encoding))
    assert used(scene)[0].base_colour == RED
    assert "ä.mtl" in inputs_of(tmp_path / "a.obj").values()


@pytest.mark.parametrize(
    "statements",
    ["mtllib a.mtl b.mtl", "mtllib a.mtl\nmtllib b.mtl", "mtllib gone.mtl a.mtl  b.mtl", "mtllib a.mtl a b.mtl"],
)
def test_several_libraries(tmp_path, statements):
    (tmp_path / "a.mtl").write_text("newmtl a\nKd 1 0 0\n", encoding="utf-8")
    second = "a b.mtl" if statements.endswith("a b.mtl") else "b.mtl"
    (tmp_path / second).write_text("newmtl b\nKd 0 0 1\nnewmtl a\nKd 0 1 0\n", encoding="utf-8")
    scene = load(tmp_path / "a.obj", f"# mtllib c.mtl\n{statements}\n{SQUARE}usemtl a\nf 1 2 3\nusemtl b\nf 1 3 4\n")
    assert [material.base_colour for material in used(scene)] == [RED, BLUE]
    assert "The material a is defined in several libraries; the first of them counts." in scene.notes
    assert ("The material library gone.mtl is missing; its materials are grey." in scene.notes) == (
        "gone" in statements
    )


@pytest.mark.parametrize(
    "name", ["Textures\\A.PNG", "textures/a.png", '"textures/a.png"', ".\\textures\\A.png", "textures/a.png # it"]
)
def test_upper_and_lower_case_of_file_names(tmp_path, png, name):
    (tmp_path / "textures").mkdir()
    (tmp_path / "textures" / "a.png").write_bytes(png)
    scene = load_with(tmp_path, f"newmtl m\nmap_Kd {name}\n")
    assert used(scene)[0].base_texture == 0
    assert ("is read from a.png" in notes(scene)) == ("A" in name or "#" in name)


def test_two_files_of_nearly_the_same_name_are_none(tmp_path, png):
    (tmp_path / "a.png").write_bytes(png)
    (tmp_path / "A.PNG").write_bytes(png)
    if len(list(tmp_path.iterdir())) < 2:
        pytest.skip("this file system does not tell upper and lower case apart")
    scene = load_with(tmp_path, "newmtl m\nmap_Kd A.png\n")
    assert used(scene)[0].base_texture == -1
    assert "The texture A.png is left out: the file is one of several: A.PNG, a.png." in scene.notes


def test_names_with_blanks_and_quotes(tmp_path, png):
    folder = tmp_path / 'it\'s a "folder"' if os.name == "posix" else tmp_path / "it's a folder"
    folder.mkdir()
    (folder / "b c's.png").write_bytes(png)
    (folder / "my library's.mtl").write_text("newmtl m\nmap_Kd b c's.png\n", encoding="utf-8")
    scene = load(folder / "a.obj", f"mtllib my library's.mtl\n{SQUARE}usemtl m\n{FACE}")
    assert used(scene)[0].base_texture == 0


def test_materials_go_on_over_objects_and_unknown_ones_are_named(tmp_path):
    scene = load_with(
        tmp_path,
        "newmtl m\nKd 1 0 0\nnewmtl m\nKd 0 1 0\n",
        f"{SQUARE}f 1 2 3\nusemtl m\no one\nf 1 2 3\no two\ng three\nf 1 3 4\nusemtl who\nf 1 2 4\nusemtl\nf 1 2 3\n",
    )
    assert sorted(material.name for material in used(scene)) == ["default", "default", "m", "m", "who"]
    assert "Materials that no library defines, grey: who." in scene.notes
    assert "The material m is defined again in a.mtl; the first of them counts." in scene.notes


def test_obj_statements_that_are_left_out_are_named(tmp_path):
    text = f"s 1\n{SQUARE}f 1 2 3\nf 1 2\nl 1 2\nl 2 3\np 1\ncurv 0 1 1 2\nvp 0 1\n"
    scene = load(tmp_path / "a.obj", text)
    assert "Statements of the OBJ file that are not supported, left out: l (2), p (1), curv (1), vp (1)." in scene.notes
    assert "Faces of fewer than three corners, dropped: 1." in scene.notes
    assert "Triangles in smoothing groups, made smooth by their angles instead: 1." in scene.notes


def test_obj_colours_of_vertices_and_numbers_that_are_none(tmp_path):
    scene = load(tmp_path / "a.obj", "v 0 0 0 1 0 0.5\nv 1 0 0\nv\t0 1 0 1\nv 1 1 0 2\nf 1 2 3\nf 2 4 3\n")
    place = {
        tuple(point): colour
        for point, colour in zip((scene.positions + 0.5)[:, :2].tolist(), scene.colours, strict=True)
    }
    assert place[0, 0] == pytest.approx([1, 0, 0.214, 1], abs=1e-3)
    assert place[1, 0].tolist() == place[0, 1].tolist() == place[1, 1].tolist() == [1, 1, 1, 1]
    assert "neither a colour nor 1, left out: 1." in notes(scene)
    whole = load(tmp_path / "a.obj", "v 0 0 0 255 0 188\nv 1 0 0 255 0 188\nv 0 1 0 255 0 188 # last\nf 1 2 3\n")
    assert whole.colours[0] == pytest.approx([1, 0, 0.503, 1], abs=1e-3)


def test_obj_indices_count_backwards_from_their_line(tmp_path):
    text = "v 0 0 0\nvt 0 0\nv 1 0 0\nvt 1 0\nv 0 1 0\nvt 0 1\nf -3/-3 -2/-2 -1/-1\nv 9 9 9\nvt 9 9\nf 1/1 -1/-1 3/3\n"
    scene = load(tmp_path / "a.obj", text)
    assert sorted(scene.uvs.tolist()) == [[0, 0], [0, 1], [1, 1], [9, -8]]
    with pytest.raises(SceneError, match="does not have"):
        load(tmp_path / "a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -4 -3 -2\n")


@pytest.mark.parametrize(
    "text", ["v 0 0 0\nv 1,5 0 0\nv 0 1 0\nf 1 2 3\n", "v 0 0\nv 1 0 0\nf 1 2 1\n", f"{SQUARE}f 1 b 3\n"]
)
def test_obj_numbers_that_are_none_are_no_scene(tmp_path, text):
    with pytest.raises(SceneError, match=r"1,5|than three numbers|b is not a number"):
        load(tmp_path / "a.obj", text)


@pytest.mark.parametrize(
    ("kind", "values", "expected", "note"),
    [
        ("uchar", "128 0 255", (0.2159, 0, 1), ""),
        ("ushort", "32768 0 65535", (0.214, 0, 1), ""),
        ("ushort", "128 0 255", (0.2159, 0, 1), "from 0 to 255"),
        ("int", "128 0 255", (0.2159, 0, 1), ""),
        ("uint", "2147483648 0 4294967295", (0.214, 0, 1), ""),
        ("float", "0.5 0 1", (0.214, 0, 1), ""),
        ("double", "127.5 0 255", (0.214, 0, 1), "from 0 to 255"),
        ("float", "1.5 0 0.5", (1, 0, 0.214), "outside 0 to 1, limited: 3"),
        ("uchar", "0.5 0 1", (0.214, 0, 1), ""),
    ],
)
def test_ply_colours_of_all_types(tmp_path, kind, values, expected, note):
    scene = load(tmp_path / "a.ply", coloured(kind, values))
    assert scene.colours[0] == pytest.approx([*expected, 1], abs=2e-4)
    assert note in notes(scene)
    assert bool(note) == any("olours" in sentence for sentence in scene.notes)


def test_ply_opacity_and_what_is_not_used_are_named(tmp_path):
    colours = ", ".join(f"uchar {name}" for name in ("red", "green", "blue", "alpha"))
    rows = "".join(f"{row} 7 255 0 0 {alpha}\n" for row, alpha in zip(CORNERS.splitlines(), (0, 255, 9), strict=True))
    text = ply(f"{XYZ}, float quality, {colours}", rows, "int flags", "3 0 1 2 5\n")
    text = (
        text.replace("end_header\n", "element edge 1\nproperty int vertex1\nproperty int vertex2\nend_header\n")
        + "0 1\n"
    )
    scene = load(tmp_path / "a.ply", text)
    assert scene.colours.tolist() == [[1, 0, 0, 1]] * 3
    assert "Vertices or faces with an opacity of their own, drawn opaque: 2." in scene.notes
    assert "Elements of the PLY file that are not supported, left out: edge (1)." in scene.notes
    assert "Properties of the PLY file that are not supported, left out: vertex quality, face flags." in scene.notes


@pytest.mark.parametrize(
    ("kinds", "values", "expected"),
    [
        ("uchar uchar uchar ushort", "128 0 255 65535", (0.2159, 0, 1)),
        ("float float float uchar", "0.5 0 1 255", (0.214, 0, 1)),
        ("double double double uchar", "0.5 0 1 255", (0.214, 0, 1)),
        ("uchar uchar uchar float", "1 0 0 1", (0.0003, 0, 0)),
        ("ushort ushort ushort uchar", "32768 0 65535 255", (0.214, 0, 1)),
        ("uchar float ushort float", "128 0.5 65535 1", (0.2159, 0.214, 1)),
        ("uchar uchar uchar uchar", "0.5 0 1 255", (0.214, 0, 1)),
    ],
)
def test_ply_colours_and_opacity_each_of_their_own_type(tmp_path, kinds, values, expected):
    names = ", ".join(" ".join(pair) for pair in zip(kinds.split(), ("red", "green", "blue", "alpha"), strict=True))
    rows = "".join(f"{row} {values}\n" for row in CORNERS.splitlines())
    scene = load(tmp_path / "a.ply", ply(f"{XYZ}, {names}", rows))
    assert scene.colours[0] == pytest.approx([*expected, 1], abs=2e-4)
    assert "olours" not in notes(scene)
    assert "opacity" not in notes(scene)


@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian"])
def test_ply_elements_without_properties_take_no_time_and_false_counts_are_refused(tmp_path, kind):
    text = ply(XYZ, CORNERS)
    header, rows = text.split("end_header\n")
    body = rows.encode() if kind == "ascii" else struct.pack("<9fB3i", *map(float, CORNERS.split()), 3, 0, 1, 2)
    header = header.replace("ascii", kind)
    for where in ("element vertex", "element face"):
        more = header.replace(where, f"element foo 2000000000\n{where}")
        scene = load(tmp_path / "a.ply", f"{more}end_header\n".encode() + body)
        assert scene.triangle_count == 1
        assert "not supported, left out: foo (2,000,000,000)." in notes(scene)
        more = header.replace(f"{where} ", f"{where} 999999999")
        with pytest.raises(SceneError, match=r"ends within the 9,999,999,99\d rows that it claims to have of"):
            load(tmp_path / "a.ply", f"{more}end_header\n".encode() + body)


@pytest.mark.parametrize(
    ("face", "words"),
    [
        ("3 0.9 1.2 2.4", "refers to vertex 0.9, which is no whole number"),
        ("3 0 nan 2", "refers to vertex nan, which is no whole number"),
        ("3.7 0 1 2", r"a (list|face) has 3.7 (values|corners)"),
        ("-3 0 1 2", r"a (list|face) has -3 (values|corners)"),
        ("nan 0 1 2", r"a (list|face) has nan (values|corners)"),
    ],
)
def test_vertices_and_lengths_that_are_no_whole_numbers_are_no_scene(tmp_path, face, words):
    for name, text in (("a.ply", ply(XYZ, CORNERS, faces=f"{face}\n")), ("a.off", f"OFF\n3 1 0\n{CORNERS}{face}\n")):
        with pytest.raises(SceneError, match=words):
            load(tmp_path / name, text)
    strips = ply(XYZ, CORNERS, faces="").replace(
        "end_header\n", "element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    )
    with pytest.raises(SceneError, match=words):
        load(tmp_path / "a.ply", f"{strips}{face}\n")


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("mixed", [False, True])
def test_ply_bytes_of_either_order(tmp_path, order, mixed):
    """Lists of different lengths, two in a row, with numbers before and after them; lines end as on Windows."""
    words = "binary_big_endian" if order == ">" else "binary_little_endian"
    header = (
        f"ply\r\nformat {words} 1.0\r\nelement vertex 5\r\nproperty double x\r\nproperty float y\r\n"
        "property short z\r\n"
        f"element face {2 if mixed else 1}\r\nproperty uchar red\r\nproperty list uchar ushort vertex_indices\r\n"
        "property uchar green\r\nproperty list int float texcoord\r\nproperty uchar blue\r\nend_header\r\n"
    )
    points = [(0, 0), (1, 0), (1, 1), (0, 1), (3, 0)]
    body = b"".join(struct.pack(order + "dfh", x, y, 10) for x, y in points)
    body += struct.pack(order + "BB4HBi8fB", 255, 4, 0, 1, 2, 3, 0, 8, 0, 0, 1, 0, 1, 1, 0, 1, 0)
    if mixed:
        body += struct.pack(order + "BB3HBi6fB", 0, 3, 1, 4, 2, 0, 6, 0, 0, 0.5, 0, 1, 1, 255)
    scene = load(tmp_path / "a.ply", header.encode() + body)
    assert scene.triangle_count == (3 if mixed else 2)
    assert area(scene) == pytest.approx(2 if mixed else 1)
    assert scene.origin[2] == 10
    assert scene.colours[scene.indices[:2]].reshape(-1, 4).tolist() == [[1, 0, 0, 1]] * 6
    assert scene.uvs[scene.indices[0]].tolist() == [[0, 1], [1, 1], [1, 0]]
    if mixed:
        assert scene.colours[scene.indices[2]].tolist() == [[0, 0, 1, 1]] * 3
        assert scene.uvs[scene.indices[2]].tolist() == [[0, 1], [0.5, 1], [1, 0]]


@pytest.mark.parametrize("cut", [1, 4])
def test_ply_files_of_the_wrong_length_are_no_scene(tmp_path, cut):
    text = ply(XYZ, CORNERS)
    for damaged in (text[: -2 * cut], text + "7\n"):
        with pytest.raises(SceneError, match=r"less or more|ends within|requires a buffer"):
            load(tmp_path / "a.ply", damaged)


def test_ply_strips_with_several_ends(tmp_path):
    text = ply(XYZ, "0 0 0\n1 0 0\n1 1 0\n0 1 0\n2 0 0\n2 1 0\n", faces="")
    text = text.replace("end_header\n", "element tristrips 2\nproperty list int int vertex_indices\nend_header\n")
    scene = load(tmp_path / "a.ply", f"{text}6 0 1 3 2 2 -1\n5 -1 1 4 2 5\n")
    assert scene.triangle_count == 4
    assert area(scene) == pytest.approx(2)
    corners = scene.positions[scene.indices]
    assert (np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] > 0).all()


def test_ply_wedges_and_several_pictures(tmp_path, png):
    (tmp_path / "a.png").write_bytes(png)
    more = "comment TextureFile a.png\ncomment TextureFile B b.png\n"
    faces = "3 0 1 2 6 0 0 1 0 0 1 0\n3 0 1 2 6 0.5 0 1 0 0 1 1\n3 0 1 2 6 0 0 1 0 0 1 -1\n"
    scene = load(tmp_path / "a.ply", ply(XYZ, CORNERS, "list uchar float texcoord, int texnumber", faces, more))
    materials = {material.name: material for material in used(scene)}
    assert materials["a.png"].base_texture == 0
    assert materials["B b.png"].base_texture == materials["default"].base_texture == -1
    assert "The texture B b.png is left out: the file is missing." in scene.notes
    assert sorted(scene.uvs.tolist()).count([0, 1]) == 2
    assert [0.5, 1] in scene.uvs.tolist()
    assert inputs_of(tmp_path / "a.ply") == {"a.png": "a.png", "B b.png": None, "cameras.json": None}


def test_ply_faces_that_refer_to_missing_vertices_are_dropped(tmp_path):
    faces = "3 0 1 2\n3 0 1 3\n4 0 1 2 -1\n2 0 1\n"
    scene = load(tmp_path / "a.ply", ply(XYZ, CORNERS, faces=faces))
    assert scene.triangle_count == 1
    assert "Faces that refer to missing vertices, dropped: 2." in scene.notes
    assert "Faces of fewer than three corners, dropped: 1." in scene.notes


@pytest.mark.parametrize(
    ("key", "extra", "colour"),
    [
        ("COFF", "255 0 0 255", (1, 0, 0)),
        ("COFF", "1 0 0 1", (1, 0, 0)),
        ("COFF", "0.5 0 0 1.0", (0.214, 0, 0)),
        ("COFF", "128 0 0", (0.2159, 0, 0)),
        ("CNOFF", "0 0 -1 255 0 0 255", (1, 0, 0)),
        ("STCNOFF", "0 0 -1 255 0 0 255 0.25 0.25", (1, 0, 0)),
        ("STOFF", "0.25 0.25", (1, 1, 1)),
        ("NOFF", "0 0 -1", (1, 1, 1)),
        ("OFF", "", (1, 1, 1)),
    ],
)
def test_off_vertices_as_their_first_word_tells(tmp_path, key, extra, colour):
    rows = "".join(f"{row} {extra}\n" for row in CORNERS.splitlines())
    scene = load(tmp_path / "a.off", f"{key} # kind\n\n3 1 0\n{rows}3 0 1 2\n")
    assert scene.colours[0] == pytest.approx([*colour, 1], abs=2e-4)
    assert scene.normals[0].tolist() == [0, 0, -1 if "N" in key else 1]
    assert scene.uvs[0].tolist() == ([0.25, 0.75] if "ST" in key else [0, 0])


def test_off_colours_of_faces(tmp_path):
    text = f"OFF 3 6 0\n{CORNERS}3 0 1 2 255 0 0\n3 0 1 2 0 0 255 128\n3 0 1 2 4\n3 0 1 2\n3 0 1 2 5 6\n2 0 1\n"
    scene = load(tmp_path / "a.off", text)
    assert scene.colours[scene.indices[:, 0]].tolist() == [[1, 0, 0, 1], [0, 0, 1, 1], *[[1, 1, 1, 1]] * 3]
    assert "opacity of their own, drawn opaque: 1." in notes(scene)
    assert "whose colour is a number in a table that is not in the OFF file, left out: 1." in notes(scene)
    assert "Faces with values that are no colour, left out: 1." in scene.notes
    floats = load(tmp_path / "a.off", f"3 1\n{CORNERS}3 0 1 2 0.5 0 1.0\n")
    assert floats.colours[0] == pytest.approx([0.214, 0, 1, 1], abs=2e-4)
    both = load(tmp_path / "a.off", "COFF 3 1\n" + CORNERS.replace("\n", " 0 0 255 255\n") + "3 0 1 2 255 0 0\n")
    assert both.colours[0].tolist() == [0, 0, 1, 1]
    assert "Faces with colours besides those of the vertices, left out: 1." in both.notes


@pytest.mark.parametrize(
    ("colours", "expected", "noted"),
    [
        (("1 1 0", "0 0 1"), ((0.0003, 0.0003, 0), (0, 0, 0.0003)), True),
        (("1.0 1 0", "0 0 1"), ((1, 1, 0), (0, 0, 1)), False),
        (("1 1 0", "0 0 1e0"), ((1, 1, 0), (0, 0, 1)), False),
        (("1 1 0", "0 0 255"), ((0.0003, 0.0003, 0), (0, 0, 1)), False),
    ],
)
def test_off_colours_of_faces_are_of_255_where_they_are_written_as_whole_numbers(tmp_path, colours, expected, noted):
    faces = "".join(f"3 0 1 2 {colour}\n" for colour in colours)
    scene = load(tmp_path / "a.off", f"OFF\n3 2 0\n{CORNERS.replace('1', '1.5')}{faces}")
    assert scene.colours[scene.indices[:, 0], :3] == pytest.approx(np.array(expected), abs=1e-4)
    assert ("the whole numbers 0 and 1, taken to be of 255, as OFF files have them: 2" in notes(scene)) == noted


@pytest.mark.parametrize(
    "text",
    [
        "OFF\n4 2 0\n0 0 0 1 0 0 1 1 0 0 1 0\n3 0 1 2 255 0 0\n3 0 2 3\n",
        "OFF\n4 2\n0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2 255 0 0\n3 0 2 3\n",
        "OFF\n4\n2\n0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2 255 0 0\n3 0 2 3\n",
        "OFF 4 2 0 0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2 255 0 0\n3 0 2 3\n",
        "OFF\n4 2 0\n0 0 0 1 0 0\n1 1 0 0\n1 0 3 0 1\n2 255 0 0\n3\n0\n2\n3",
        "OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 # broken\n1 2 255 0 0\n\n3 0 2\n3\n",
    ],
)
def test_off_numbers_stand_in_any_lines(tmp_path, text):
    scene = load(tmp_path / "a.off", text)
    assert area(scene) == pytest.approx(1)
    assert scene.colours[scene.indices[:, 0]].tolist() == [[1, 0, 0, 1], [1, 1, 1, 1]]
    assert "OFF file" not in notes(scene)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("OFF\n3 1 0\n0 0 0 1 0 0 0 1 0 5\n3 0 1 2\n", "do not have a line each, and number by number"),
        ("OFF\n3 1 0\n0 0 0 1 0 0 0 1 0\n3 0 1 2\n3 0 1 2\n", "different numbers of values"),
        ("OFF\n3 2 0\n0 0 0 1 0 0 0 1 0\n3 0 1 2\n", "number by number it ends before its last face"),
        ("OFF\n3 1 0\n0 0 0 1 0 0\n", "it ends before its last vertex"),
        (f"OFF\n3 2 0\n{CORNERS}3 0 1 2\n", "it ends before its last face"),
        ("OFF\n999999999999 1 0\n0 0 0\n", "it ends before its last vertex"),
        (f"OFF\n3 999999999999 0\n{CORNERS}3 0 1 2\n", "it ends before its last face"),
        ("4OFF\n3 1 0\n", "more than three dimensions"),
        ("OFF BINARY\n", "are binary"),
        ("FOO\n3 1 0\n", "does not begin with OFF"),
        (f"COFF\n3 1 0\n{CORNERS}3 0 1 2\n", "than its first word tells"),
        (f"OFF\n3 1 0\n{CORNERS}4 0 1 2\n", "fewer corners"),
    ],
)
def test_off_files_that_are_no_scene(tmp_path, text, words):
    with pytest.raises(SceneError, match=words):
        load(tmp_path / "a.off", text)


FACET = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"


def test_stl_attributes_are_named(tmp_path):
    triangle = np.array([0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0], np.float32).tobytes()
    scene = load(tmp_path / "a.stl", bytes(80) + struct.pack("<I", 2) + triangle + b"\xff\x80" + triangle + b"\0\0")
    assert scene.triangle_count == 2
    assert "Triangles with a colour in the STL file's attributes, left out: 1." in scene.notes


@pytest.mark.parametrize(
    ("count", "size", "words"),
    [
        (1, 124, "is cut off, or its count is wrong: it has 124 bytes where its count of 1 triangles needs 134"),
        (1, 136, "goes on behind its triangles, or its count is wrong: it has 136 bytes"),
        (2**32 - 1, 134, "of 4,294,967,295 triangles needs 214,748,364,834"),
        (0, 60, "has 60 bytes, fewer than a binary STL file's head of 84"),
    ],
)
@pytest.mark.parametrize("name", [b"solid x", b"COLOR="])
def test_stl_bytes_of_another_number_than_their_count_tells(tmp_path, name, count, size, words):
    triangle = np.array([0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0], np.float32).tobytes()
    data = name.ljust(80, b"\0") + struct.pack("<I", count) + triangle
    with pytest.raises(SceneError, match=words):
        load(tmp_path / "a.stl", data.ljust(size, b"\0")[:size])


@pytest.mark.parametrize(
    "text",
    [
        f"solid my vertex\n{FACET}endsolid a\nsolid b\n{FACET}",
        f"solid a\n{FACET}{FACET.replace('1 0 0', '1,5 0 0')}endsolid\n",
    ],
)
def test_stl_texts_are_read_whole_or_not_at_all(tmp_path, text):
    with pytest.raises(SceneError):
        load(tmp_path / "a.stl", text)
    assert (
        load(tmp_path / "a.stl", f"solid my vertex\n{FACET}endsolid a\nsolid b\n{FACET}endsolid\n").triangle_count == 2
    )


@pytest.mark.skipif(not CASES.is_dir(), reason="the folder of reported cases is not there")
@pytest.mark.parametrize(
    ("name", "size"),
    [("obj_concave4.obj", 0.5), ("ply_concave.ply", 2.2), ("ply_bin_mixed.ply", 4.5), ("ply_strips.ply", 4)],
)
def test_reported_areas(name, size):
    assert area(load_scene(str(CASES / name))) == pytest.approx(size)


@pytest.mark.parametrize(
    ("face", "words"),
    [
        ("f 0 1 2", "line 6: a face uses vertex 0, but OBJ files count from 1"),
        ("f 1/1 2/2 0/3", "line 6: a face uses vertex 0, but OBJ files count from 1"),
        ("f 1 2 4", "line 6: a face uses vertex 4, which the file does not have: it has 3"),
        ("f -4 -2 -1", "line 6: a face uses vertex -4, which the file does not have: it has 3"),
    ],
)
def test_faces_of_vertices_that_are_not_there_are_named(tmp_path, face, words):
    with pytest.raises(SceneError, match=words):
        load(tmp_path / "a.obj", f"v 0 0 0\nv 1 0 0\n# three\nv 0 1 0\nf 1 2 3\n{face}\n")
