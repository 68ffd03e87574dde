"""Scene files: a scene, or one sentence, whatever is in them."""

from __future__ import annotations

import base64
import copy
import json
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import psutil
import pytest
from hypothesis import given
from hypothesis import strategies as st

from shading_atlas_bench.scenes.load import load_scene
from shading_atlas_bench.scenes.model import Scene, SceneError
from tests.fuzz.cases import fuzzed, nothing_beside, one_sentence
from tests.scenes.glb_files import Glb, full_scene
from tests.scenes.test_load_errors import COFF, FOUR_CORNERS, OBJ, OFF, PLY, STL, TEXT_PLY

MEMORY = 256 << 20  # bytes that the machine is said to have: what would fill it is refused
MTL = b"newmtl m\nKd 0.5 0.5 1\nNs 10\nd 0.5\nmap_Kd -s 2 2 a.png\nmap_d a.png\nKe 1 0 0\nnewmtl n\nTr 0.2\n"
VIEW = {"eye": [0, 0, 1], "dir": [0, 0, -1], "up": [0, 1, 0], "fov_x_deg": 60, "fov_min_axis_deg": 40}
CAMERAS = {"metres_per_unit": 1.5, "cameras": [VIEW, {"eye": [0, 0, 0], "dir": [1, 0, 0]}]}
TEXT_STL = FOUR_CORNERS.replace(b"vertex 0 1 0\n", b"")
# What stands in for parts of files: numbers at every edge, names that lead away, and words of the formats.
NUMBERS = (0, 1, -1, 2, 3, 255, 65535, 2**31, 2**32 - 1, 2**53, -(2**63), 2**64, 10**400, 0.5, 1e-320, 1e38, -1e308)
WORDS = (
    b"0 -0 1 -1 2 9 4294967296 1e999 nan -inf 1e-320 0x10 1/1/1 1//1 // / 1/ # \\ ../a.png /dev/zero .. a.mtl a.png "
    b"v vt vn f usemtl mtllib newmtl map_Kd map_d -s -clamp on s ply element property list uchar int float double "
    b"end_header vertex face format ascii binary_little_endian comment TextureFile OFF STCNOFF BINARY solid facet "
    b"endfacet loop \xff\xfe \xe9 \x00 vertex_indices"
).split(b" ")
MOST_WORDS = 3000  # that doubling adds to a line
PACKED = [struct.pack(f"{order}I", n) for n in (0, 1, 3, 255, 65535, 2**31, 2**32 - 1) for order in "<>"]
PACKED += [struct.pack(f"<{kind}", n) for n in (1.0, 1e38, -np.inf, np.nan) for kind in "fd"]
VALUES: tuple[Any, ...] = (
    *NUMBERS, None, True, "", "a.png", "../a.png", "/dev/zero", "a\0b", "\ud800", "data:,", "data:;base64,AAAA",
    "SCALAR", "VEC3", "MAT4", "mesh", [], [[]], {}, {"a": {}}, float("nan"), float("inf"), [0, 0, 0], [1e38] * 16,
)  # fmt: skip


@pytest.fixture(autouse=True)
def small_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine with little memory, so that a case that takes much ends, and this one does not."""
    monkeypatch.setattr(psutil, "virtual_memory", lambda: SimpleNamespace(total=MEMORY))


def places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """The paths to all values within a JSON value."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in items:
        yield (*path, key)
        yield from places(inner, (*path, key))


def mutated_json(data: st.DataObject, document: dict[str, Any]) -> dict[str, Any]:
    """The document with a few values taken out, written over, doubled or put in place of others."""
    document = json.loads(json.dumps(document))
    for _ in range(data.draw(st.integers(1, 4))):
        paths = list(places(document))
        if not paths:
            break
        *path, last = data.draw(st.sampled_from(paths))
        parent: Any = document
        for key in path:
            parent = parent[key]
        change = data.draw(st.sampled_from(("write", "write", "drop", "double", "copy")))
        if change == "write":
            parent[last] = copy.deepcopy(data.draw(st.sampled_from(VALUES)))
        elif change == "drop":
            del parent[last]
        elif change == "double" and isinstance(parent, list):
            parent.append(parent[last])
        else:
            parent[last] = json.loads(json.dumps(parent))  # into itself, once
    return document


def mutated_words(data: st.DataObject, text: bytes) -> bytes:
    """The text with a few words taken out, written over, doubled or exchanged for lines' ends."""
    lines = [line.split(b" ") for line in text.split(b"\n")]
    for _ in range(data.draw(st.integers(1, 6))):
        line = data.draw(st.sampled_from(lines))
        place = data.draw(st.integers(0, max(0, len(line) - 1)))
        change = data.draw(st.sampled_from(("write", "write", "drop", "double", "lines")))
        if change == "write":
            line[place : place + 1] = [data.draw(st.sampled_from(WORDS))]
        elif change == "drop":
            del line[place : place + 1]
        elif change == "double":
            doubled = line[place:] * data.draw(st.sampled_from((1, 1, 300)))
            line[place:place] = doubled[:MOST_WORDS]  # those doubled again and again would take all memory
        else:
            lines.insert(data.draw(st.integers(0, len(lines))), list(line))
    return b"\n".join(b" ".join(line) for line in lines)


def mutated_bytes(data: st.DataObject, content: bytes) -> bytes:
    """The bytes cut off, with bits flipped and numbers written over others."""
    changed = bytearray(content)
    for _ in range(data.draw(st.integers(1, 6))):
        place = data.draw(st.integers(0, max(0, len(changed) - 1)))
        change = data.draw(st.sampled_from(("flip", "number", "cut", "insert")))
        if change == "flip" and changed:
            changed[place] ^= 1 << data.draw(st.integers(0, 7))
        elif change == "number":
            number = data.draw(st.sampled_from(PACKED))
            changed[place : place + len(number)] = number
        elif change == "cut":
            del changed[place : place + data.draw(st.sampled_from((1, 4, 50, len(changed))))]
        else:
            changed[place:place] = data.draw(st.binary(max_size=8))
    return bytes(changed)


def gltf_text(data: st.DataObject, glb: Glb) -> bytes:
    document = {"buffers": [{"byteLength": len(glb.data)}], **glb.json}
    document["buffers"][0]["uri"] = "data:;base64," + base64.b64encode(glb.data).decode()
    return json.dumps(mutated_json(data, document)).encode()


def glb_bytes(data: st.DataObject, glb: Glb) -> bytes:
    if data.draw(st.booleans()):
        return mutated_bytes(data, glb.bytes())
    changed = Glb(**mutated_json(data, glb.json))
    changed.json, changed.data = mutated_json(data, glb.json), glb.data
    return changed.bytes()


# The name of each kind of file, what it is made from, and how.
KINDS: dict[str, tuple[str, Callable[[st.DataObject, Any], bytes], Any]] = {
    "obj": ("a.obj", mutated_words, OBJ),
    "obj as bytes": ("a.obj", mutated_bytes, OBJ),
    "text ply": ("a.ply", mutated_words, TEXT_PLY),
    "ply": ("a.ply", mutated_bytes, PLY),
    "ply's header": ("a.ply", mutated_words, PLY),
    "off": ("a.off", mutated_words, OFF),
    "coloured off": ("a.off", mutated_words, COFF),
    "text stl": ("a.stl", mutated_words, TEXT_STL),
    "stl": ("a.stl", mutated_bytes, STL),
}


def loaded_or_refused(folder: Path, file: Path, options: dict[str, Any]) -> None:
    """Load a file; what is loaded is sound, and what is said can be printed and kept."""
    with nothing_beside(folder), one_sentence(SceneError):
        assert_whole(load_scene(str(file), **options))


def assert_whole(scene: Scene) -> None:
    assert json.dumps(scene.notes, ensure_ascii=False).encode()
    assert scene.triangle_count
    for array in (scene.positions, scene.normals, scene.uvs, scene.colours):
        assert len(array) == len(scene.positions)
        assert np.isfinite(array).all()
    assert scene.indices.min() >= 0
    assert scene.indices.max() < len(scene.positions)
    assert scene.material_ids.max() < len(scene.materials)
    assert 0 < scene.metres_per_unit < np.inf
    for material in scene.materials:
        assert json.dumps(material.name, ensure_ascii=False).encode()
        assert max(material.textures.values(), default=-1) < len(scene.textures)


def options_of(data: st.DataObject, folder: Path) -> dict[str, Any]:
    return {
        "unit": data.draw(st.sampled_from((None, None, 1.0, 1e-30, 1e30))),
        "max_texture": data.draw(st.sampled_from((8192, 1))),
        "cache": data.draw(st.sampled_from((None, folder / "cache"))),
    }


@pytest.fixture
def folder(tmp_path: Path, png: bytes) -> Path:
    folder = tmp_path / "scene"
    folder.mkdir()
    (tmp_path / "a.png").write_bytes(png)
    (folder / "a.png").write_bytes(png)
    (folder / "a.mtl").write_bytes(MTL)
    return folder


@fuzzed
@given(kind=st.sampled_from(list(KINDS)), data=st.data())
def test_mesh_files(folder: Path, kind: str, data: st.DataObject):
    name, mutated, content = KINDS[kind]
    (folder / name).write_bytes(mutated(data, content))
    loaded_or_refused(folder, folder / name, options_of(data, folder))


@fuzzed
@given(kind=st.sampled_from(["gltf", "glb"]), data=st.data())
def test_gltf_files(folder: Path, png: bytes, kind: str, data: st.DataObject):
    content = (gltf_text if kind == "gltf" else glb_bytes)(data, full_scene(png))
    (folder / f"a.{kind}").write_bytes(content)
    loaded_or_refused(folder, folder / f"a.{kind}", options_of(data, folder))


@fuzzed
@given(kind=st.sampled_from(["library", "texture", "cameras"]), data=st.data())
def test_files_beside_a_scene(folder: Path, png: bytes, kind: str, data: st.DataObject):
    content = {"a.obj": OBJ, "a.mtl": MTL, "a.png": png, "cameras.json": b"{}"}
    if kind == "library":
        content["a.mtl"] = data.draw(st.sampled_from((mutated_words, mutated_bytes)))(data, MTL)
    elif kind == "texture":
        content["a.png"] = mutated_bytes(data, png)
    else:
        text = json.dumps(mutated_json(data, CAMERAS)).encode()
        content["cameras.json"] = mutated_bytes(data, text) if data.draw(st.booleans()) else text
    for name, inner in content.items():
        (folder / name).write_bytes(inner)
    loaded_or_refused(folder, folder / "a.obj", options_of(data, folder))
