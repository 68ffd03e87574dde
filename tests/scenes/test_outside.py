"""A scene file has its own folder and what is below; other files are read where the user says so."""

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from shading_atlas_bench.scenes.load import load_scene
from shading_atlas_bench.scenes.model import SceneError

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32).tobytes()
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n"
PLY = (
    "ply\nformat ascii 1.0\ncomment TextureFile {}\nelement vertex 3\nproperty float x\nproperty float y\n"
    "property float z\nproperty float u\nproperty float v\nelement face 1\nproperty list uchar int vertex_indices\n"
    "end_header\n0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n"
)


def gltf(buffer: str, image: str | None = None) -> str:
    """A triangle whose corners and texture are in files of these names."""
    document: dict = {
        "asset": {"version": "2.0"},
        "buffers": [{"uri": buffer, "byteLength": 36}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]}],
        "materials": [{}],
        "nodes": [{"mesh": 0}],
    }
    if image is not None:
        texture = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
        document |= {"images": [{"uri": image}], "textures": [{"source": 0}], "materials": [texture]}
    return json.dumps(document)


@pytest.fixture
def inside(tmp_path, png) -> Path:
    """The folder of a scene; beside it are a buffer, an image and a material library."""
    folder = tmp_path / "scene"
    (folder / "sub").mkdir(parents=True)
    for place in (tmp_path, folder / "sub"):
        (place / "a.bin").write_bytes(CORNERS)
        (place / "a.png").write_bytes(png)
        (place / "a.mtl").write_text("newmtl m\nmap_Kd a.png\n", encoding="utf-8")
    return folder


# Name and text of a scene file that names something in the folder {}, and what it names there.
NAMING = {
    "buffer": ("a.gltf", lambda folder: gltf(f"{folder}a.bin"), "a.bin"),
    "image": ("a.gltf", lambda folder: gltf("sub/a.bin", f"{folder}a.png"), "a.png"),
    "library": ("a.obj", lambda folder: f"mtllib {folder}a.mtl\n{OBJ}", "a.mtl"),
    "texture of a PLY file": ("a.ply", lambda folder: PLY.format(f"{folder}a.png"), "a.png"),
}


def written(folder: Path, kind: str, place: str) -> tuple[str, str]:
    """A scene file that names something in a place, and that name."""
    name, text, named = NAMING[kind]
    (folder / name).write_text(text(place), encoding="utf-8")
    return str(folder / name), f"{place}{named}"


def refused(file: str, name: str, end: Path | None = None, **options: Any) -> None:
    """The file that is named is refused; end: where a link leads to, if it is one."""
    with pytest.raises(SceneError) as caught:
        load_scene(file, **options)
    place = f"which leads by a link to {end}," if end else "a file"
    sentence = f"{file} names {name}, {place} outside of its folder: --allow-outside reads such files too."
    assert str(caught.value) == sentence


def what_was_read(file: str, **options: Any) -> tuple[int, list[list[list[int]]]]:
    scene = load_scene(file, **options)
    return scene.triangle_count, [texture.texels.tolist() for texture in scene.textures]


@pytest.mark.parametrize("kind", NAMING)
def test_files_elsewhere_are_read_where_they_are_allowed_only(inside, tmp_path, kind):
    within = what_was_read(written(inside, kind, "sub/")[0])
    assert within[0] == 1
    assert len(within[1]) == (kind != "buffer")
    for place in (f"{inside}/sub/", "../scene/sub/"):
        assert what_was_read(written(inside, kind, place)[0]) == within
    for place in ("../", f"{tmp_path}/", "sub/../../", f"{'../' * 20}{tmp_path}/".replace("//", "/")):
        file, name = written(inside, kind, place)
        refused(file, name)
        refused(file, name, cache=tmp_path / "cache")
        assert what_was_read(file, allow_outside=True, cache=tmp_path / "cache") == within
        refused(file, name, cache=tmp_path / "cache")  # which holds it now


@pytest.mark.parametrize("kind", NAMING)
def test_links_are_followed_first(inside, tmp_path, kind):
    (inside / "link").symlink_to(tmp_path, target_is_directory=True)
    file, name = written(inside, kind, "link/")
    refused(file, name, tmp_path / Path(name).name)
    (inside / Path(name).name).symlink_to(f"../{Path(name).name}")
    file, name = written(inside, kind, "")
    refused(file, name, tmp_path / name)
    (inside / name).unlink()
    (inside / "within").symlink_to(inside / "sub", target_is_directory=True)
    assert load_scene(written(inside, kind, "within/")[0]).triangle_count == 1
    (tmp_path / "other").symlink_to(inside, target_is_directory=True)  # the same scene by another name
    assert load_scene(written(tmp_path / "other", kind, "sub/")[0]).triangle_count == 1


def test_a_material_library_names_from_where_it_is(inside):
    (inside / "sub" / "b.mtl").write_text("newmtl m\nmap_Kd ../top.png\n", encoding="utf-8")
    (inside / "top.png").write_bytes((inside / "sub" / "a.png").read_bytes())
    (inside / "a.obj").write_text(f"mtllib sub/b.mtl\n{OBJ}", encoding="utf-8")
    assert len(load_scene(str(inside / "a.obj")).textures) == 1
    (inside / "sub" / "b.mtl").write_text("newmtl m\nmap_Kd ..\\..\\a.png\n", encoding="utf-8")
    refused(str(inside / "a.obj"), "..\\..\\a.png")


def test_folders_elsewhere_are_not_listed(inside, tmp_path, monkeypatch):
    """Names in another case are looked for in the scene's own folder, from wherever a name leads back to it."""
    listed: list[Path] = []
    listing = Path.iterdir

    def noted(folder: Path) -> Iterator[Path]:
        listed.append(folder.resolve())
        return iter(list(listing(folder)))

    monkeypatch.setattr(Path, "iterdir", noted)
    for name, there in (
        ("../A.PNG", False),
        ("../../scene/SUB/a.png", False),
        ("../SCENE/SUB/A.PNG", True),
        (f"{inside}/SUB/A.PNG", False),
    ):
        (inside / "a.mtl").write_text(f"newmtl m\nmap_Kd {name}\n", encoding="utf-8")
        (inside / "a.obj").write_text(f"mtllib a.mtl\n{OBJ}", encoding="utf-8")
        scene = load_scene(str(inside / "a.obj"))
        assert len(scene.textures) == there, name
        assert there or f"The texture {name} is left out: the file is missing." in scene.notes
    assert listed
    assert all(folder.is_relative_to(inside) for folder in listed)
    (inside / "a.mtl").write_text("newmtl m\nmap_Kd ../A.PNG\n", encoding="utf-8")
    assert len(load_scene(str(inside / "a.obj"), allow_outside=True).textures) == 1
    assert tmp_path in listed


def test_cameras_are_the_scenes_own(inside, tmp_path):
    (tmp_path / "cameras.json").write_text('{"metres_per_unit": 3}', encoding="utf-8")
    (inside / "cameras.json").symlink_to(tmp_path / "cameras.json")
    (inside / "a.obj").write_text(OBJ, encoding="utf-8")
    refused(str(inside / "a.obj"), "cameras.json", tmp_path / "cameras.json")
    assert load_scene(str(inside / "a.obj"), allow_outside=True).metres_per_unit == 3


def test_what_is_not_there_is_missing_wherever_it_is(inside):
    (inside / "a.mtl").write_text("newmtl m\nmap_Kd /home/artist/wood.png\n", encoding="utf-8")
    (inside / "a.obj").write_text(f"mtllib a.mtl\n{OBJ}", encoding="utf-8")
    notes = load_scene(str(inside / "a.obj")).notes
    assert "The texture /home/artist/wood.png is left out: the file is missing." in notes


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes with names here")
@pytest.mark.parametrize("kind", NAMING)
def test_pipes_and_devices_are_no_files(inside, kind):
    for name, special in (("pipe/", None), ("device/", "/dev/zero")):
        words = f"is a {name[:-1]}, which is not read"
        (inside / name).mkdir()
        for file in ("a.bin", "a.png", "a.mtl"):
            os.symlink(special, inside / name / file) if special else os.mkfifo(inside / name / file)
        file, _ = written(inside, kind, name)
        choices: list[dict[str, Any]] = [{}, {"allow_outside": True}]
        for options in choices:
            if kind == "buffer":
                with pytest.raises(SceneError, match=words):
                    load_scene(file, **options)
            else:
                assert any(words in note for note in load_scene(file, **options).notes)
    os.mkfifo(inside / "cameras.json")
    assert load_scene(written(inside, kind, "sub/")[0]).cameras == []


def test_files_that_no_memory_holds_are_refused(inside):
    """Files with holes: as large as one likes, and of no size on the disk."""
    for kind, name in (("buffer", "a.bin"), ("library", "a.mtl")):
        with (inside / "sub" / name).open("r+b") as file:
            file.truncate(1 << 43)
        with pytest.raises(SceneError, match=rf": the file {name} takes 8,796\.1 GB, more than half of this machine's"):
            load_scene(written(inside, kind, "sub/")[0])
        (inside / "sub" / name).unlink()
    with (inside / "b.stl").open("wb") as file:
        file.truncate(1 << 43)
    with pytest.raises(SceneError, match=r"The file .*b\.stl takes 8,796\.1 GB"):
        load_scene(str(inside / "b.stl"))


def test_few_bytes_of_gltf_do_not_fill_the_memory(tmp_path):
    """Accessors without data, of which a file may say any number, as corners and as instances."""
    document = json.loads(gltf("data:application/octet-stream;base64," + "A" * 48))
    without = {"componentType": 5126, "count": 1 << 40, "type": "VEC3"}
    for change, words in (
        ({"accessors": [without]}, "an accessor of 1,099,511,627,776 entries without data, takes"),
        (
            {
                "accessors": [*document["accessors"], without],
                "nodes": [
                    {"mesh": 0, "extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 1}}}},
                ],
            },
            "1,099,511,627,776 instances, takes",
        ),
    ):
        (tmp_path / "a.gltf").write_text(json.dumps(document | change), encoding="utf-8")
        with pytest.raises(SceneError, match=words):
            load_scene(str(tmp_path / "a.gltf"))


def test_required_extensions_are_refused_by_name(tmp_path):
    document = json.loads(gltf("a.bin"))
    (tmp_path / "a.bin").write_bytes(CORNERS)
    for required, words in (
        (["KHR_texture_transform", "ACME_rockets"], "needs ACME_rockets, which cannot be read"),
        (["ACME_a", "ACME_b", "ACME_a"], "needs ACME_a and ACME_b, which"),
        (["ACME_\ud800"], r"needs ACME_\?, which"),
        ("ACME_rockets", "its extensionsRequired is not a list of names"),
        ([5], "its extensionsRequired is not a list of names"),
    ):
        (tmp_path / "a.gltf").write_text(json.dumps(document | {"extensionsRequired": required}), encoding="utf-8")
        with pytest.raises(SceneError, match=words) as caught:
            load_scene(str(tmp_path / "a.gltf"))
        assert str(caught.value).encode()
