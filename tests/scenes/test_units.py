"""A unit that a file states is kept, what is asked for wins, and a guess says that it is one."""

import json

import pytest

from shading_atlas_bench.scenes.load import load_scene
from shading_atlas_bench.scenes.model import SceneError
from tests.scenes.glb_files import square_scene
from tests.scenes.test_load_files import TRIANGLE, box


def _obj(folder, size=1.0, inwards=False):
    file = folder / "a.obj"
    file.write_text(box(size, inwards), encoding="utf-8")
    return str(file)


def _state(folder, unit):
    (folder / "cameras.json").write_text(json.dumps({"metres_per_unit": unit}), encoding="utf-8")


def _notes(scene, word):
    return [note for note in scene.notes if word in note]


def test_gltf_is_in_metres(tmp_path):
    scene = load_scene(square_scene().write(tmp_path / "a.glb"))
    assert (scene.metres_per_unit, scene.place) == (1.0, False)
    assert "glTF" in scene.unit_from
    assert not _notes(scene, "unit")


@pytest.mark.parametrize("unit", [1.0, 0.02])
@pytest.mark.parametrize("kind", ["glb", "obj"])
def test_cameras_json_wins_over_the_format(tmp_path, kind, unit):
    _state(tmp_path, unit)
    file = square_scene().write(tmp_path / "a.glb") if kind == "glb" else _obj(tmp_path)
    scene = load_scene(file)
    assert (scene.metres_per_unit, scene.unit_from) == (unit, "cameras.json")
    assert not _notes(scene, "unit")


def test_cameras_json_may_name_the_unit(tmp_path):
    _state(tmp_path, "ft")
    assert load_scene(_obj(tmp_path)).metres_per_unit == 0.3048


@pytest.mark.parametrize("kind", ["glb", "obj"])
def test_what_is_asked_for_wins_over_all_and_says_so(tmp_path, kind):
    _state(tmp_path, 0.5)
    scene = load_scene(square_scene().write(tmp_path / "a.glb") if kind == "glb" else _obj(tmp_path), unit=0.01)
    assert (scene.metres_per_unit, scene.unit_from) == (0.01, "--unit")
    (note,) = _notes(scene, "unit")
    assert "0.01 m" in note
    assert "0.5 m" in note
    assert "cameras.json" in note


def test_the_unit_that_is_stated_may_be_asked_for(tmp_path):
    assert not _notes(load_scene(square_scene().write(tmp_path / "a.glb"), unit=1.0), "unit")


@pytest.mark.parametrize("size", [1e-3, 1.0, 400.0])
def test_an_object_that_states_nothing_is_two_metres_large(tmp_path, size):
    scene = load_scene(_obj(tmp_path, size))
    assert scene.metres_per_unit * size == pytest.approx(2)
    assert "guess" in scene.unit_from
    (note,) = _notes(scene, "states no unit")
    assert "--unit" in note
    assert "cameras.json" in note
    assert "neither in metres nor in centimetres" in scene.because


@pytest.mark.parametrize(("size", "unit", "name"), [(8, 1.0, "metres"), (800, 0.01, "centimetres")])
def test_a_room_that_states_nothing_has_the_unit_that_makes_it_a_room(tmp_path, size, unit, name):
    scene = load_scene(_obj(tmp_path, size, inwards=True))
    assert (scene.place, scene.metres_per_unit) == (True, unit)
    (note,) = _notes(scene, "states no unit")
    assert f"in {name} " in note


@pytest.mark.parametrize(("unit", "noted"), [(1e-5, True), (1e-2, False), (1e4, False), (1e7, True)])
def test_an_absurd_size_is_noted(tmp_path, unit, noted):
    _state(tmp_path, unit)
    (tmp_path / "a.obj").write_text(f"{TRIANGLE}f 1 2 3\n", encoding="utf-8")
    scene = load_scene(str(tmp_path / "a.obj"))
    assert scene.metres_per_unit == unit
    assert bool(_notes(scene, "--unit")) == noted


@pytest.mark.parametrize("unit", [1e300, 1e20, 1e-20, 1e-300])
@pytest.mark.parametrize("stated", [False, True])
def test_sizes_that_single_precision_cannot_draw_are_refused(tmp_path, unit, stated):
    file = _obj(tmp_path)
    if stated:
        _state(tmp_path, unit)
    with pytest.raises(SceneError, match=r"m large by its unit \((--unit|cameras.json)\), which single precision"):
        load_scene(file, unit=None if stated else unit)
