"""A file that is not there, or that may not be read, is named, and what is wrong with it is said as it is."""

import base64
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from shading_atlas_bench.scenes.cameras import read_cameras
from shading_atlas_bench.scenes.head_motion import HeadMotion
from shading_atlas_bench.scenes.load import load_scene
from shading_atlas_bench.scenes.model import SceneError
from shading_atlas_bench.scenes.paths import PathError, read_path
from tests.scenes.test_outside import CORNERS, OBJ, PLY, gltf

needs_posix = pytest.mark.skipif(sys.platform == "win32", reason="names and rights of POSIX")
URL = "https://example.org/data.bin"


@pytest.fixture
def scene(tmp_path, png) -> Path:
    """A folder with what is no file, and what is one."""
    (tmp_path / "folder").mkdir()
    (tmp_path / "a.bin").write_bytes(CORNERS)
    (tmp_path / "a.png").write_bytes(png)
    (tmp_path / "loose").symlink_to("gone")
    os.mkfifo(tmp_path / "pipe")
    return tmp_path


ABSENT = {
    "gone.bin": "is missing",
    "folder": "is a folder, which is not read",
    "pipe": "is a pipe, which is not read",
    "/dev/zero": "is a device, which is not read",
    "loose": "is a link to gone, which is missing",
    URL: "is on the network, and nothing is fetched",
}


@needs_posix
@pytest.mark.parametrize("name", ABSENT)
def test_what_is_no_file_is_said_to_be_what_it_is(scene, name):
    why = ABSENT[name]
    (scene / "a.gltf").write_text(gltf(name), encoding="utf-8")
    with pytest.raises(SceneError) as caught:
        load_scene(str(scene / "a.gltf"))
    assert str(caught.value).endswith(f" cannot be read as GLTF: it is damaged or incomplete ({name} {why}).")
    (scene / "a.gltf").write_text(gltf("a.bin", name), encoding="utf-8")
    assert f"Image 0 ({name}) is left out: {name} {why}." in load_scene(str(scene / "a.gltf")).notes
    (scene / "a.obj").write_text(f"mtllib {name}\n{OBJ}", encoding="utf-8")
    notes = load_scene(str(scene / "a.obj")).notes
    assert f"The material library {name} {why}; its materials are grey." in notes
    (scene / "a.obj").write_text(f"mtllib a.mtl\n{OBJ}", encoding="utf-8")
    (scene / "a.mtl").write_text(f"newmtl m\nmap_Kd {name}\n", encoding="utf-8")
    (scene / "a.ply").write_text(PLY.format(name), encoding="utf-8")
    for file in ("a.obj", "a.ply"):
        assert f"The texture {name} is left out: the file {why}." in load_scene(str(scene / file)).notes


@needs_posix
def test_scenes_and_paths_that_are_no_files(scene):
    os.mkfifo(scene / "b.obj")
    with pytest.raises(SceneError, match=r"b\.obj is a pipe, which is not read; name a scene file \(\.glb"):
        load_scene(str(scene / "b.obj"))
    with pytest.raises(PathError, match=r"pipe is a pipe, which is not read\.$"):
        HeadMotion.recorded(scene / "pipe")


@contextmanager
def without_rights() -> Iterator[Path]:
    """A folder to read and write in, for a process that has no rights of an administrator."""
    folder = Path(tempfile.mkdtemp())
    administrator = os.geteuid() == 0
    try:
        folder.chmod(0o777)
        if administrator:
            os.seteuid(65534)  # nobody
        yield folder
    finally:
        if administrator:
            os.seteuid(0)
        shutil.rmtree(folder)


def load_in(folder: Path, name: str, content: str, **options: Any) -> list[str]:
    (folder / name).write_text(content, encoding="utf-8")
    return load_scene(str(folder / name), **options).notes


@needs_posix
def test_files_that_may_not_be_read(tmp_path, png):
    (tmp_path / "a.png").write_bytes(png)
    (tmp_path / "a.mtl").write_text("newmtl m\nmap_Kd a.png\n", encoding="utf-8")
    load_in(tmp_path, "a.obj", f"mtllib a.mtl\n{OBJ}")  # so that all modules are there
    load_in(tmp_path, "a.ply", PLY.format("a.png"))
    with without_rights() as folder:
        choices: list[dict[str, Any]] = [{}, {"cache": folder / "cache"}]
        for name in ("a.png", "a.bin", "secret.mtl", "secret.obj", "secret.gltf", "secret.stl", "secret.txt"):
            (folder / name).write_bytes(b"secret")
            (folder / name).chmod(0)
        for name in ("secret.obj", "secret.gltf", "secret.stl"):
            for options in choices:
                with pytest.raises(SceneError) as caught:
                    load_scene(str(folder / name), **options)
                assert str(caught.value) == f"{folder / name} cannot be read: permission is denied."
        for options in choices:
            with pytest.raises(SceneError) as caught:
                load_in(folder, "a.obj", f"mtllib secret.mtl\n{OBJ}", **options)
            reason = f"permission is denied ({folder / 'secret.mtl'})"
            assert str(caught.value) == f"{folder / 'a.obj'} cannot be read: {reason}."
        why = "the image cannot be read: permission is denied."
        assert f"The texture a.png is left out: {why}" in load_in(folder, "a.ply", PLY.format("a.png"))
        with pytest.raises(SceneError, match=r"a\.gltf cannot be read: permission is denied \(.*a\.bin\)\.$"):
            load_in(folder, "a.gltf", gltf("a.bin"))
        data = f"data:;base64,{base64.b64encode(CORNERS).decode()}"
        assert "Image 0 (a.png) is left out: permission is denied." in load_in(folder, "a.gltf", gltf(data, "a.png"))
        for read in (lambda file: read_path(file, np.zeros(3)), HeadMotion.recorded, read_cameras):
            with pytest.raises((PathError, SceneError)) as denied:
                read(folder / "secret.txt")
            assert str(denied.value) == f"{folder / 'secret.txt'} cannot be read: permission is denied."
        (folder / "closed").mkdir()
        (folder / "closed" / "a.png").write_bytes(png)
        (folder / "closed").chmod(0)
        notes = load_in(folder, "a.ply", PLY.format("closed/a.png"))
        assert "The texture closed/a.png is left out: the file cannot be reached: permission is denied." in notes
        with pytest.raises(SceneError, match=r"a\.obj cannot be reached: permission is denied; name a scene file"):
            load_scene(str(folder / "closed" / "a.obj"))


SECRETS = "root:x:0:0:root:/root:/bin/bash\nmarten:hunter2:1 2 3\n"


@pytest.mark.parametrize("content", [SECRETS, "x\n" + SECRETS, "x\n" * 2 + "0 hunter2 1 2 3 4 5 6\n"])
def test_what_is_no_path_is_not_shown(tmp_path, content):
    """A path may be named in a file of settings from a stranger, and lead to any file."""
    file = tmp_path / "passwd"
    file.write_text(content, encoding="utf-8")
    for read in (lambda: read_path(file, np.zeros(3)), lambda: HeadMotion.recorded(file)):
        with pytest.raises(PathError) as caught:
            read()
        sentence = str(caught.value).replace(str(file), "")
        assert "line " in sentence
        assert not any(word in sentence for word in ("root", "hunter", "marten", "bash"))


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ("0 1 2 3 0 0 1", r"expected 8 numbers \(t_ms, x, y, z, qx, qy, qz, qw\), found 7\."),
        ("0 1 2 3 0 0 O 1", r"expected 8 numbers \(.*\), value 7 is no finite number\."),
        ("0 1 inf 3 0 0 0 1", r"value 3 is no finite number\."),
    ],
)
def test_a_wrong_row_is_named_by_what_is_wrong_with_it(tmp_path, row, words):
    (tmp_path / "a.txt").write_text(f"# poses\n{row}\n", encoding="utf-8")
    with pytest.raises(PathError, match=rf"a\.txt, line 2: .*{words}$"):
        read_path(tmp_path / "a.txt", np.zeros(3))
    (tmp_path / "a.txt").write_bytes(b"0 1 2 3 0 0 0 1 # \xff\n")
    with pytest.raises(PathError, match=r"a\.txt cannot be read as text: it is not UTF-8\.$"):
        read_path(tmp_path / "a.txt", np.zeros(3))
