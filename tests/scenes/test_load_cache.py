"""The cache of loaded scenes, repair and decimation."""

import dataclasses
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier
from typing import Any

import numpy as np
import pytest
import trimesh

from shading_atlas_bench.scenes import load
from shading_atlas_bench.scenes.cache import fetch, store
from shading_atlas_bench.scenes.load import load_scene
from shading_atlas_bench.scenes.model import Camera, CameraAnimation, Scene, SceneError
from tests.scenes.glb_files import SQUARE, square_scene


def assert_same(a, b) -> None:
    for item in dataclasses.fields(a):
        one, other = getattr(a, item.name), getattr(b, item.name)
        if item.name in ("textures", "animations"):
            one, other = ([vars(entry) for entry in entries] for entries in (one, other))
            np.testing.assert_equal(one, other)
        else:
            np.testing.assert_equal(np.asarray(one) if isinstance(one, np.ndarray) else one, other)


def textured_obj(folder, png: bytes):
    (folder / "a.png").write_bytes(png)
    (folder / "a.mtl").write_text("newmtl m\nmap_Kd a.png\n", encoding="utf-8")
    text = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n"
    (folder / "a.obj").write_text(text, encoding="utf-8")
    return folder / "a.obj"


def test_cached_scenes_are_the_same_and_mapped(tmp_path, png):
    file, cache = textured_obj(tmp_path, png), tmp_path / "cache"
    first, second = (load_scene(str(file), cache=cache) for _ in range(2))
    assert_same(first, second)
    assert isinstance(second.positions, np.memmap)
    assert len(second.content_hash) == 16
    assert second.positions.ctypes.data % 64 == 0
    assert [entry.suffix for entry in cache.iterdir()] == [""]


def test_every_field_of_a_scene_is_kept(tmp_path):
    scene = load_scene(square_scene().write(tmp_path / "a.glb"))
    animation = CameraAnimation("flight", np.arange(2.0), np.ones((2, 3)), np.ones((2, 4)))
    array_fields: dict[str, Any] = {"route": np.arange(6.0).reshape(2, 3), "tangents": np.ones((4, 4), np.float32)}
    array_fields["further_uvs"] = np.ones((2, 4, 2), np.float32)
    camera = Camera((1.0, 2.0, 3.0), (0.0, 0.0, -1.0), name="eye")
    whole = dataclasses.replace(scene, **array_fields, animations=[animation], cameras=[camera], place=False)
    empty = [name for name, value in vars(whole).items() if value is None or (isinstance(value, str) and not value)]
    assert not empty, "give every field a value, so that losing one is seen"
    store(tmp_path / "entry", whole)
    assert_same(fetch(tmp_path / "entry"), whole)


@dataclasses.dataclass
class Cached:
    """A scene that is loaded through a cache. loads: how often its file was read."""

    file: Path
    cache: Path
    loads: int = 0

    def load(self, **options: Any) -> Scene:
        return load_scene(str(self.file), cache=self.cache, **options)


@pytest.fixture
def cached(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[Path], Cached]:
    def make(file: Path) -> Cached:
        scene, real = Cached(file, tmp_path / "cache"), load._load_file

        def counting(*arguments: Any) -> Scene:
            scene.loads += 1
            return real(*arguments)

        monkeypatch.setattr(load, "_load_file", counting)
        return scene

    return make


@pytest.mark.parametrize("changed", ["a.obj", "a.mtl", "a.png", "cameras.json"])
def test_every_input_file_counts(tmp_path, png, cached, changed):
    scene = cached(textured_obj(tmp_path, png))
    for loads in (1, 2):
        for _ in range(2):
            scene.load()
            assert scene.loads == loads
        extra = b"{}" if changed == "cameras.json" else b"\n"
        with (tmp_path / changed).open("ab") as target:
            target.write(extra)


HEADS = {
    "a comment with a header's last word": "comment writes end_header itself\n",
    "a header of more than 64 KiB": f"comment {'x' * 90}\n" * 800,
}


@pytest.mark.parametrize("head", HEADS)
def test_a_texture_named_late_in_a_header_counts(tmp_path, png, cached, head):
    (tmp_path / "t.png").write_bytes(png)
    columns = "".join(f"property float {name}\n" for name in ("x", "y", "z", "u", "v"))
    lines = f"ply\nformat ascii 1.0\n{HEADS[head]}comment TextureFile t.png\nelement vertex 3\n{columns}"
    body = (
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n"
    )
    (tmp_path / "a.ply").write_text(lines + body, encoding="utf-8")
    scene = cached(tmp_path / "a.ply")
    assert len(scene.load().textures) == 1
    (tmp_path / "t.png").unlink()
    assert not scene.load().textures
    assert scene.loads == 2


def test_a_library_named_in_a_line_that_goes_on_counts(tmp_path, png, cached):
    scene = cached(textured_obj(tmp_path, png))
    scene.file.write_bytes(scene.file.read_bytes().replace(b"mtllib ", b"mtllib \\\n"))
    assert len(scene.load().textures) == 1
    (tmp_path / "a.mtl").write_text("newmtl m\nKd 1 0 0\n", encoding="utf-8")
    assert not scene.load().textures


def test_what_was_missing_counts_where_it_appears(tmp_path, png, cached):
    """Under any name that stands for it; files that nobody asks for do not count."""
    scene = cached(textured_obj(tmp_path, png))
    (tmp_path / "a.png").rename(tmp_path / "b.png")
    assert not scene.load().textures
    (tmp_path / "c.png").write_bytes(png)
    assert not scene.load().textures
    assert scene.loads == 1
    (tmp_path / "b.png").rename(tmp_path / "A.PNG")
    assert len(scene.load().textures) == 1


def test_a_file_that_is_put_before_another_counts(tmp_path, png, cached):
    """A name to the letter comes before one in another case, though that one's file stays."""
    if not (tmp_path / "x").touch() and (tmp_path / "X").exists():
        pytest.skip("this file system knows no upper and lower case")
    scene = cached(textured_obj(tmp_path, png))
    (tmp_path / "a.png").rename(tmp_path / "A.png")
    scene.load()
    (tmp_path / "a.png").write_bytes(b"no picture")
    assert not scene.load().textures


def test_what_lies_outside_counts_as_it_may_be_read(tmp_path, png, cached):
    (tmp_path / "in").mkdir()
    scene = cached(textured_obj(tmp_path / "in", png))
    (tmp_path / "in" / "a.png").rename(tmp_path / "a.png")
    (tmp_path / "in" / "a.mtl").write_text("newmtl m\nmap_Kd ../a.png\n", encoding="utf-8")
    assert scene.load(allow_outside=True).textures
    with pytest.raises(SceneError, match="--allow-outside"):
        scene.load()


def test_a_file_that_changes_while_it_is_read_counts_as_changed(tmp_path, png, cached, monkeypatch):
    scene, real = cached(textured_obj(tmp_path, png)), Path.read_bytes

    def late(path: Path) -> bytes:
        content = real(path)
        if path.suffix == ".mtl":
            path.write_text("newmtl m\nKd 1 0 0\n", encoding="utf-8")
        return content

    with monkeypatch.context() as patch:
        patch.setattr(Path, "read_bytes", late)
        assert scene.load().textures
    assert not scene.load().textures


def test_copies_of_a_scene_in_other_folders_have_files_of_their_own(tmp_path, png, cached):
    for name in ("one", "other"):
        (tmp_path / name).mkdir()
        scene = cached(textured_obj(tmp_path / name, png))
    (tmp_path / "one" / "a.mtl").write_text("newmtl m\nKd 1 0 0\n", encoding="utf-8")
    for _ in range(2):
        assert [
            len(load_scene(str(tmp_path / name / "a.obj"), cache=scene.cache).textures) for name in ("one", "other")
        ] == [0, 1]
    assert len(list(scene.cache.iterdir())) == 2


@pytest.mark.parametrize("name", ["a.glb", "a.gltf"])
@pytest.mark.parametrize("changed", ["far.bin", "far.png"])
def test_files_that_gltf_names_count_in_either_container(tmp_path, png, name, changed):
    """What is in a file, not what it is called, says whether it is a container."""
    glb, cache = square_scene(textures=[{"source": 0}], images=[{"uri": "far.png"}]), tmp_path / "cache"
    glb.json["bufferViews"][0]["buffer"] = 1  # the positions
    glb.json["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
    (tmp_path / "far.png").write_bytes(png)
    (tmp_path / "far.bin").write_bytes(SQUARE.tobytes())
    file = glb.write(tmp_path / name, [{"byteLength": SQUARE.nbytes, "uri": "far.bin"}])
    small = load_scene(file, cache=cache)
    (tmp_path / changed).write_bytes((SQUARE * 5).tobytes() if changed == "far.bin" else png + b"\n")
    large = load_scene(file, cache=cache)
    assert len(list(cache.iterdir())) == 1
    assert np.ptp(large.positions, axis=0)[0] == np.ptp(small.positions, axis=0)[0] * (5 if "bin" in changed else 1)


def test_options_count(tmp_path):
    file, cache = square_scene().write(tmp_path / "a.glb"), tmp_path / "cache"
    whole = load_scene(file, cache=cache)
    assert load_scene(file, unit=2.0, cache=cache).content_hash != whole.content_hash
    assert len(list(cache.iterdir())) == 2


@pytest.mark.filterwarnings("ignore:The scene .* was damaged")
def test_runs_at_once_heal_the_same_scene(tmp_path, png):
    """All find it damaged; what one has mapped stays good while another replaces the file."""
    file, cache = textured_obj(tmp_path, png), tmp_path / "cache"
    whole = load_scene(str(file), cache=cache)
    (entry,) = cache.iterdir()
    runs = 4
    together = Barrier(runs)

    def heal(run):
        for _ in range(10):
            if run == 0:
                entry.unlink()
                (entry / "within").mkdir(parents=True)
            together.wait(timeout=60)
            scenes = [load_scene(str(file), cache=cache) for _ in range(2)]
            together.wait(timeout=60)
            for scene in scenes:
                assert_same(scene, whole)
            assert fetch(entry) is not None
            together.wait(timeout=60)

    with ThreadPoolExecutor(runs) as pool:
        list(pool.map(heal, range(runs)))
    assert list(cache.iterdir()) == [entry]


@pytest.mark.usefixtures("pymeshlab")
def test_repair_counts_what_it_drops(tmp_path):
    """A box with a doubled face, a collapsed one and a fin on an edge that two faces share already."""
    box = trimesh.creation.box()
    vertices = np.vstack([box.vertices, [[2, 2, 2]]])
    edge = box.faces[0][:2]
    faces = np.vstack([box.faces, box.faces[:1], [[1, 1, 2]], [[*edge, 8]]])
    text = "\n".join(["v {} {} {}".format(*v) for v in vertices] + ["f {} {} {}".format(*f) for f in faces + 1])
    (tmp_path / "a.obj").write_text(text, encoding="utf-8")
    assert load_scene(str(tmp_path / "a.obj")).triangle_count == 14
    scene = load_scene(str(tmp_path / "a.obj"), repair=True)
    assert scene.triangle_count == 12
    notes = " ".join(scene.notes)
    assert "duplicate triangles: 1." in notes
    assert "degenerate triangles: 1." in notes
    assert "non-manifold edges: 1." in notes


@pytest.mark.usefixtures("pymeshlab")
def test_repair_of_a_sound_scene_drops_nothing(tmp_path):
    file = square_scene().write(tmp_path / "a.glb")
    assert "Repair found nothing to drop." in load_scene(file, repair=True).notes


@pytest.mark.usefixtures("pymeshlab")
def test_decimation_keeps_shape_and_texture_coordinates(tmp_path):
    """A textured 40x40 grid with a bump: a fifth of the triangles, u and v still follow x and y."""
    steps = np.linspace(0, 1, 41)
    points = [(x, y, 0.1 * np.exp(-40 * ((x - 0.5) ** 2 + (y - 0.5) ** 2))) for x in steps for y in steps]
    number = np.arange(41 * 41).reshape(41, 41) + 1
    corners = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1).reshape(-1, 4)
    lines = [f"v {x} {y} {z}\nvt {x} {y}" for x, y, z in points]
    lines += ["f " + " ".join(f"{corner}/{corner}" for corner in face) for face in corners]
    (tmp_path / "a.obj").write_text("\n".join(lines), encoding="utf-8")
    scene = load_scene(str(tmp_path / "a.obj"), decimate=0.2)
    assert 500 <= scene.triangle_count <= 660
    positions = scene.positions + scene.origin
    assert np.abs(scene.uvs - np.stack([positions[:, 0], 1 - positions[:, 1]], axis=1)).max() < 0.02
    assert any("Decimation removed" in note for note in scene.notes)
