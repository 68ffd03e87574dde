"""Camera paths, recordings of head motion and camera animations: poses that can be drawn from, or one sentence."""

from __future__ import annotations

import functools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from shading_atlas_bench.arithmetic.arrays import Array
from shading_atlas_bench.harness.workload.session import hash_of_motion
from shading_atlas_bench.scenes.head_motion import HeadMotion
from shading_atlas_bench.scenes.load import load_scene
from shading_atlas_bench.scenes.model import Scene, SceneError
from shading_atlas_bench.scenes.paths import CameraPath, PathError, list_paths, make_path
from tests.fuzz.cases import fuzzed, nothing_beside, one_sentence
from tests.scenes.glb_files import Glb, square_scene

# What may stand where a number belongs: every edge, and what is none.
NUMBERS = st.one_of(
    st.floats().map(repr),
    st.integers().map(str),
    st.sampled_from(
        ["0", "-0", "1e999", "-1e308", "1e-320", "1e18", "1_0", "\u0663", "0x1", "", "#", ",", "nan", "\0"]
    ),
)
ENDS = st.sampled_from(["\n", "\r\n", "\r", "\u2028", "\x0c", ""])
NAMES = st.one_of(
    st.sampled_from([*list_paths(), "", ".", "walks", "a" * 300, "a\0b", "/dev/zero", "\ud800", "folder"]), st.text()
)


@functools.cache
def square() -> Glb:
    return square_scene({"mesh": 0})


def scene_of(folder: Path) -> Scene:
    return load_scene(square().write(folder / "square.glb"))


def table(data: st.DataObject, columns: int) -> bytes:
    """A table of rows that grow, then with some of it changed, in text that may be no UTF-8."""
    rows = []
    for row in range(data.draw(st.integers(0, 4))):
        cells = [str(row * 10), *data.draw(st.lists(NUMBERS, min_size=columns - 1, max_size=columns - 1))]
        if data.draw(st.integers(0, 3)) == 0:
            cells[data.draw(st.integers(0, len(cells) - 1))] = data.draw(NUMBERS)
        if data.draw(st.integers(0, 7)) == 0:
            del cells[-1]
        rows.append(data.draw(st.sampled_from([" ", ",", "\t", " , "])).join(cells) + data.draw(ENDS))
    text = "".join(rows).encode(errors="surrogatepass")
    return text + data.draw(st.binary(max_size=3)) if data.draw(st.integers(0, 7)) == 0 else text


def assert_drawable(path: CameraPath, head: HeadMotion | None = None) -> None:
    """Poses at all times are finite, and turns are unit quaternions."""
    assert path.frames
    assert json.dumps(path.notes).encode()
    first, last = path.times_ms[0], path.times_ms[-1]
    for time in (first - 1, first, (first + last) / 2, last, last + 50, last + 1000):
        assert_pose(*path.pose_at(float(time)))
    for time in path.times_ms[:4].tolist():
        assert_pose(*(head or HeadMotion.synthetic(1)).offset(time, 50.0))
    assert hash_of_motion(path, head or HeadMotion.synthetic(1), 50.0)


def assert_pose(position: Array, turn: Array) -> None:
    assert np.isfinite(position).all()
    assert abs(np.linalg.norm(turn) - 1) < 1e-6


@fuzzed
@given(data=st.data())
def test_files_of_poses(tmp_path: Path, data: st.DataObject):
    folder = tmp_path / "case"
    folder.mkdir(exist_ok=True)
    scene = scene_of(folder)
    (folder / "a.path").write_bytes(table(data, 8))
    frames = data.draw(st.sampled_from([None, 1, 2, 0, -1, 10**6]))
    with nothing_beside(folder), one_sentence(PathError):
        assert_drawable(make_path(scene, str(folder / "a.path"), frames))


@fuzzed
@given(data=st.data())
def test_recordings_of_head_motion(tmp_path: Path, data: st.DataObject):
    folder = tmp_path / "case"
    folder.mkdir(exist_ok=True)
    scene = scene_of(folder)
    (folder / "head.txt").write_bytes(data.draw(st.sampled_from([b"a header\n", b""])) + table(data, 7))
    with nothing_beside(folder), one_sentence(PathError):
        assert_drawable(make_path(scene, "orbit", 3), HeadMotion.recorded(folder / "head.txt"))


@fuzzed
@given(name=NAMES, head=st.booleans())
def test_names(tmp_path: Path, name: str, head: bool):
    folder = tmp_path / "case"
    (folder / "folder").mkdir(parents=True, exist_ok=True)
    scene = scene_of(folder)
    with pytest.MonkeyPatch.context() as patch, nothing_beside(folder), one_sentence(PathError):
        patch.chdir(folder)
        if head:
            HeadMotion.recorded(name)
        else:
            assert_drawable(make_path(scene, name))


def animated(data: st.DataObject) -> Glb:
    """A square and a camera that an animation moves, with numbers of any kind in it."""
    numbers = st.floats(width=32) if data.draw(st.booleans()) else st.floats(-100, 100, width=32)
    count = data.draw(st.integers(1, 4))

    def values(columns: int, rows: int) -> np.ndarray:
        drawn = data.draw(st.lists(numbers, min_size=columns * rows, max_size=columns * rows))
        return np.array(drawn, np.float32).reshape(rows, columns)

    glb = square_scene({"mesh": 0}, {"camera": 0})
    times = values(1, count).ravel()
    glb.json["cameras"] = [{"type": "perspective", "perspective": {"yfov": data.draw(st.floats())}}]
    mode = data.draw(st.sampled_from(["LINEAR", "STEP", "CUBICSPLINE"]))
    rows = count * (3 if mode == "CUBICSPLINE" else 1)
    samplers: list[dict[str, Any]] = []
    channels: list[dict[str, Any]] = []
    for path, columns in (("translation", 3), ("rotation", 4), ("scale", 3)):
        if data.draw(st.booleans()):
            channels.append({"sampler": len(samplers), "target": {"node": 1, "path": path}})
            output = glb.accessor(values(columns, rows))
            samplers.append({"input": glb.accessor(np.sort(times)), "output": output, "interpolation": mode})
    glb.json["animations"] = [{"samplers": samplers, "channels": channels}]
    return glb


@fuzzed
@given(data=st.data())
def test_cameras_and_animations_of_scenes(tmp_path: Path, data: st.DataObject):
    folder = tmp_path / "case"
    folder.mkdir(exist_ok=True)
    content = animated(data).bytes()
    (folder / "a.glb").write_bytes(content)
    with nothing_beside(folder), one_sentence(PathError, SceneError):
        scene = load_scene(str(folder / "a.glb"))
        for name in ("animation", "orbit", "walk", "turntable"):
            with one_sentence(PathError):
                assert_drawable(make_path(scene, name, 2))


def camera(data: st.DataObject) -> dict[str, Any]:
    vector = st.lists(st.one_of(st.floats(), st.integers()), min_size=3, max_size=3)
    entry = {"eye": data.draw(vector), "dir": data.draw(vector), "up": data.draw(vector)}
    kinds = st.sampled_from(["fov_x_deg", "fov_min_axis_deg"])
    return entry | data.draw(st.dictionaries(kinds, st.one_of(st.floats(), st.just("wide"), st.just(60))))


@fuzzed
@given(data=st.data())
def test_cameras_beside_scenes(tmp_path: Path, data: st.DataObject):
    folder = tmp_path / "case"
    folder.mkdir(exist_ok=True)
    content = {"cameras": [camera(data)], "metres_per_unit": data.draw(st.one_of(st.just(1.0), st.floats()))}
    (folder / "cameras.json").write_text(json.dumps(content), encoding="utf-8")
    with nothing_beside(folder), one_sentence(PathError, SceneError):
        scene = scene_of(folder)
        for name in ("orbit", "walk"):
            assert_drawable(make_path(scene, name, 2))
