"""Whatever of a scene can change a picture changes its `drawn_hash`, and nothing else does."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from shading_atlas_bench.harness.workload.cache_key import drawn_hash
from shading_atlas_bench.harness.workload.session import workload_hashes
from shading_atlas_bench.harness.workload.settings import Settings
from shading_atlas_bench.scenes.cache import fetch, store
from shading_atlas_bench.scenes.features import content_digest
from shading_atlas_bench.scenes.model import Camera, Light, Material, Scene, Texture

# Fields that say what is seen from where, what others say already, or what only people read.
NOT_DRAWN = {"name", "unit_from", "because", "notes", "animations", "features", "content_hash"}
INVISIBLE = {("textures", "name")}
CORNERS = np.eye(3, dtype=np.float32)
SCENE = Scene(
    "one triangle", CORNERS, np.array([[0, 1, 2]], np.int32), CORNERS, CORNERS[:, :2], np.ones((3, 4), np.float32),
    np.zeros(1, np.int32), [Material()], [Texture("bricks", np.zeros((2, 2, 4), np.uint8))],
    tangents=np.ones((3, 4), np.float32), further_uvs=np.zeros((1, 3, 2), np.float32),
    lights=[Light("spot", (1.0, 1.0, 1.0))],
    cameras=[Camera((0.0, 1.0, 0.0), (0.0, 0.0, -1.0), fov_x=60.0)], route=np.zeros((2000, 3)),
)  # fmt: skip


def hash_with(**changes: Any) -> str:
    """Of the scene with other values of some fields."""
    scene = replace(SCENE, **changes)
    return drawn_hash(replace(scene, content_hash=content_digest(scene)))


def edits(value: Any) -> Iterator[tuple[str, Any]]:
    """The least other values of a field, each with what was edited in it."""
    if isinstance(value, list):
        yield "one less", value[:-1]
        yield from ((what, [other, *value[1:]]) for what, other in edits(value[0]))
    elif is_dataclass(value) and not isinstance(value, type):
        for name in (field.name for field in fields(value)):
            yield from ((name, replace(value, **{name: other})) for _, other in edits(getattr(value, name)))
    elif isinstance(value, np.ndarray):
        other = value.copy()
        middle = tuple(length // 2 for length in other.shape)  # where a `repr` of many leaves them out
        other[middle] = other[middle] + 1 if value.dtype.kind in "iu" else np.nextafter(other[middle], 9)
        yield "an element", other
    elif isinstance(value, tuple):
        yield "a number", (np.nextafter(value[0], 9).item(), *value[1:])
    elif isinstance(value, str):
        yield "a text", f"{value}?"
    else:
        yield "a value", not value if isinstance(value, bool) else value + 1


CASES = [
    (field.name, what, other)
    for field in fields(Scene)
    if field.name not in NOT_DRAWN
    for what, other in edits(getattr(SCENE, field.name))
    if (field.name, what) not in INVISIBLE
]


@pytest.mark.parametrize(("field", "what", "other"), CASES, ids=[f"{field}: {what}" for field, what, _ in CASES])
def test_an_edit_of_anything_that_is_drawn_changes_the_hash(field: str, what: str, other: object) -> None:
    assert hash_with(**{field: other}) != hash_with()


@pytest.mark.parametrize("field", ["tangents", "further_uvs", "route"])
def test_what_is_missing_changes_the_hash(field: str) -> None:
    assert hash_with(**{field: None}) != hash_with()


@pytest.mark.parametrize("field", sorted(NOT_DRAWN - {"content_hash"}))
def test_what_is_never_drawn_does_not_count(field: str) -> None:
    other = f"{SCENE.name}?" if isinstance(getattr(SCENE, field), str) else [None]
    assert hash_with(**{field: other}) == hash_with()


def test_a_scene_from_the_cache_has_the_hash_of_the_one_that_was_made(tmp_path: Path) -> None:
    camera = Camera((np.float64(0.1), 1, 2.0), (0.0, 0.0, -1.0))  # as arrays give numbers
    made = replace(SCENE, cameras=[camera], place=np.True_, content_hash="a")  # type: ignore[arg-type]  # as NumPy compares
    store(tmp_path / "scene", replace(made, place=True))
    kept = fetch(tmp_path / "scene")
    assert kept is not None
    assert drawn_hash(kept) == drawn_hash(made)


def test_other_cameras_beside_a_file_are_another_workload(tmp_path: Path) -> None:
    """Scene and path hash are those of before: the triangles are, and the path is a file of its own."""
    corners = [(x, y, z) for x in (-3, 3) for y in (0, 3) for z in (-3, 3)]
    quads = ["1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4"]
    lines = [f"v {x} {y} {z}" for x, y, z in corners] + [f"f {quad}" for quad in quads]
    (tmp_path / "room.obj").write_text("\n".join(lines), encoding="utf-8")
    (tmp_path / "path.txt").write_text("0 0 1.6 0 0 0 0 1\n20 0.1 1.6 0 0 0 0 1\n", encoding="utf-8")
    settings = Settings(scene=str(tmp_path / "room.obj"), path=str(tmp_path / "path.txt"), frames=2)
    found = []
    for eye in (1.0, 2.0):
        cameras = [{"eye": at, "dir": [0, 0, -1]} for at in ([0, 1.6, 0], [eye, 1.6, 1])]  # the sun follows the first
        text = json.dumps({"metres_per_unit": 1, "cameras": cameras})
        (tmp_path / "cameras.json").write_text(text, encoding="utf-8")
        found.append(workload_hashes(settings))
    one, other = found
    assert [name for name in one if one[name] != other[name]] == ["drawn_hash"]
