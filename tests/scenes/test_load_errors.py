"""Whatever is wrong with a file or a name ends in one sentence, never in another exception."""

import contextlib
import struct

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from shading_atlas_bench.scenes.load import list_scenes, load_scene, real_scenes
from shading_atlas_bench.scenes.model import SceneError
from tests.scenes.glb_files import square_scene

OBJ = b"mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nvn 0 0 1\nusemtl m\nf 1/1/1 2/1/1 3/1/1\nf -1 1 2\n"
OFF = b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
PLY = (
    b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    b"element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    + np.array([0, 0, 0, 1, 0, 0, 0, 1, 0], np.float32).tobytes()
    + struct.pack("<B3i", 3, 0, 1, 2)
)
STL = b"\0" * 80 + struct.pack("<I", 1) + np.array([0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0], np.float32).tobytes() + b"\0\0"
TEXT_PLY = (
    b"ply\nformat ascii 1.0\ncomment TextureFile a.png\nelement vertex 4\nproperty float x\nproperty float y\n"
    b"property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nelement face 2\n"
    b"property list uchar int vertex_indices\nproperty list uchar float texcoord\nelement tristrips 1\n"
    b"property list int int vertex_indices\nend_header\n0 0 0 1 2 3\n1 0 0 1 2 3\n1 1 0 1 2 3\n0 1 0 1 2 3\n"
    b"4 0 1 2 3 8 0 0 1 0 1 1 0 1\n3 0 1 2 6 0 0 1 0 1 1\n5 0 1 2 -1 3\n"
)
COFF = b"STCNOFF\n3 2 0\n" + b"".join(b"%s 0 0 0 1 255 0 0 255 0 1\n" % corner for corner in (b"0 0", b"1 0", b"1 1"))
COFF += b"4 0 1 2 0 1 0 0\n3 0 1 2\n"
WHOLE = {"glb": square_scene().bytes(), "obj": OBJ, "off": OFF, "ply": PLY, "stl": STL}
WHOLE |= {"text.ply": TEXT_PLY, "more.off": COFF}

FOUR_CORNERS = b"solid a\nfacet normal 0 0 1\nouter loop\n" + b"".join(
    b"vertex %s 0\n" % corner for corner in (b"0 0", b"1 0", b"1 1", b"0 1")
)
FOUR_CORNERS += b"endloop\nendfacet\nendsolid a\n"


@pytest.mark.parametrize("kind", WHOLE)
def test_whole_files_load(tmp_path, kind):
    (tmp_path / f"a.{kind}").write_bytes(WHOLE[kind])
    assert load_scene(str(tmp_path / f"a.{kind}")).triangle_count >= 1


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.glb", None, "no scene file"),
        ("a.fbx", b"x", "cannot be read; readable are"),
        ("a.obj", b"", r"a\.obj has no usable triangles"),
        ("a.obj", b"v 0 0 10\nv 0 0 1\n# x\nv 1 0 x # y\nf 1 2 9\n", r"a\.obj .*line 4: x is not a number"),
        ("a.obj", b"v 0 0 0\nv 0 0 1\nv 1 0 0\nf 1/1 2/1 3/1\nf 1/1 2/1 z/1\n", "line 5: z is not a number"),
        ("a.obj", b"v 0 0 0\nv 0 \\\n0 w\nf 1 1 1\n", "the line v 0  0 w: w is not a number"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", "no triangle of positive area"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "does not have"),
        ("a.obj", b"v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "not a number, dropped: 1"),
        ("a.stl", b"solid nothing\nendsolid\n", "."),
        ("a.stl", FOUR_CORNERS, "not every facet in it has three vertices"),
        ("a.glb", b"glTF", "cut off"),
        ("a.gltf", b"[]", "not an object"),
        ("a.stl", b"endsolid a\nsolid a\n", "its lines do not follow each other as the format has them"),
        ("a.ply", b"ply\n", "a.ply"),
        ("a.ply", PLY.replace(b"float y", b"flkat y"), "a line that cannot be read: property flkat y"),
        ("a.ply", PLY.replace(b"list uchar", b"list ochar"), "cannot be read: property list ochar int vertex_indices"),
        ("a.ply", PLY.replace(b"vertex 3", b"vertex x"), "a line that cannot be read: element vertex x"),
        ("a.off", b"OFF\n3 1 0\n0 0 0\n", "a.off"),
    ],
)
def test_bad_files_give_one_sentence(tmp_path, name, content, words):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(SceneError, match=words) as caught:
        load_scene(str(tmp_path / name))
    assert "\n" not in str(caught.value)


def test_unknown_names_are_answered_with_the_nearest(tmp_path):
    with pytest.raises(SceneError, match=r"did you mean 'hall'.*village"):
        load_scene("hal")
    with pytest.raises(SceneError, match="is a folder"):
        load_scene(str(tmp_path))
    assert set(list_scenes()) == {"hall", "shells", "village"}


@pytest.mark.parametrize("options", [{"unit": 0.0}, {"unit": float("nan")}, {"decimate": 1.5}, {"detail": 0}])
def test_unusable_options_are_named(tmp_path, options):
    (tmp_path / "a.obj").write_bytes(OBJ)
    with pytest.raises(SceneError, match="must be"):
        load_scene(str(tmp_path / "a.obj"), **options)


@pytest.mark.parametrize("kind", WHOLE)
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture], derandomize=True)
@given(data=st.data())
def test_damaged_files_raise_nothing_else(tmp_path, kind, data):
    """Cut off anywhere, with bits flipped anywhere: a scene or a SceneError."""
    content = bytearray(WHOLE[kind])
    length = data.draw(st.one_of(st.just(len(content)), st.integers(0, len(content))))
    flips = data.draw(st.lists(st.tuples(st.integers(0, len(content) - 1), st.integers(0, 7)), max_size=6))
    for position, bit in flips:
        content[position] ^= 1 << bit
    file = tmp_path / f"a.{kind}"
    file.write_bytes(content[:length])
    with contextlib.suppress(SceneError):
        scene = load_scene(str(file))
        assert np.isfinite(scene.positions).all()
        assert scene.indices.max() < len(scene.positions)
        assert np.abs(np.linalg.norm(scene.normals, axis=1) - 1).max() < 1e-3


def test_a_scene_that_is_not_here_is_looked_for_among_the_real_ones(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("BENCH_SCENES", str(tmp_path / "real"))
    with pytest.raises(SceneError, match="real"):
        load_scene("lane/street.obj")
    for folder, size in ((tmp_path / "real", 1), (tmp_path, 2)):  # a file that is here comes first
        (folder / "lane").mkdir(parents=True)
        (folder / "lane" / "street.obj").write_text(f"v 0 0 0\nv {size} 0 0\nv 0 1 0\nf 1 2 3\n", encoding="utf-8")
        wide, high, _ = np.ptp(load_scene("lane/street.obj").positions, axis=0)
        assert wide == size * high


def test_without_a_folder_of_real_scenes_none_is_searched(tmp_path, monkeypatch):
    (tmp_path / "shared" / "scenes").mkdir(parents=True)
    (tmp_path / "shared" / "scenes" / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", encoding="utf-8")
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    for named in (None, ""):
        monkeypatch.delenv("BENCH_SCENES", raising=False)
        if named is not None:
            monkeypatch.setenv("BENCH_SCENES", named)
        assert real_scenes() is None
        with pytest.raises(SceneError, match=r"^There is no scene file a\.obj\.$"):
            load_scene("a.obj")
