"""What takes long is done up to a count of steps, and what many things are asked for grows as they do."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from shading_atlas_bench.arithmetic.matrices import product
from shading_atlas_bench.scenes import gltf_motion, obj, rays, standing, walking
from shading_atlas_bench.scenes.files import SceneFiles
from shading_atlas_bench.scenes.gltf_document import GltfDocument
from shading_atlas_bench.scenes.gltf_nodes import AT_REST, GltfNodes, local_matrices
from shading_atlas_bench.scenes.load import load_scene
from shading_atlas_bench.scenes.mtl import map_statement
from shading_atlas_bench.scenes.paths import make_path
from shading_atlas_bench.scenes.raw import RawScene
from shading_atlas_bench.scenes.standing import GIVEN_UP
from shading_atlas_bench.scenes.work import Work, WorkError
from tests.scenes.glb_files import Glb, square_scene

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


def room(folder: Path) -> Path:
    """A room of 8 x 3 x 10 metres, its fronts inwards, with a pillar."""
    lines = ["mtllib none.mtl"]
    for number, (low, high) in enumerate([((-4, 0, -5), (4, 3, 5)), ((-1, 0, -1), (1, 2, 1))]):
        lines += [f"v {x} {y} {z}" for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
        for face in ((1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)):
            lines.append("f " + " ".join(str(8 * number + corner) for corner in face[:: 1 if number else -1]))
    (folder / "room.obj").write_text("\n".join(lines), encoding="utf-8")
    return folder / "room.obj"


def test_work_is_done_as_long_as_there_are_steps() -> None:
    work = Work(10)
    work.take(4)
    work.take(6)
    work.take(0)
    with pytest.raises(WorkError):
        work.take(1)


def animated(cameras: int) -> Glb:
    """Cameras below one node that an animation of ten seconds moves, the last of them upright, the others not."""
    lying: dict[str, Any] = {"camera": 0, "rotation": [1, 0, 0, 0]}
    nodes: list[dict[str, Any]] = [
        {"mesh": 0, "children": list(range(1, cameras + 1))},
        *[lying] * (cameras - 1),
        {"camera": 0},
    ]
    glb = square_scene(*nodes, scenes=[{"nodes": [0]}], cameras=[{"type": "perspective", "perspective": {"yfov": 1.0}}])
    times, moves = (glb.accessor(np.array(values, np.float32)) for values in ([0, 10], [[0, 0, 0], [1, 1, 1]]))
    channel = {"sampler": 0, "target": {"node": 0, "path": "translation"}}
    glb.json["animations"] = [{"samplers": [{"input": times, "output": moves}], "channels": [channel]}]
    return glb


def test_animated_cameras_are_followed_as_long_as_there_are_steps(tmp_path, monkeypatch):
    file = animated(4).write(tmp_path / "a.glb")
    whole = load_scene(file)
    assert [round(1 - 2 * turns[0, 0] ** 2) for turns in (a.orientations for a in whole.animations)] == [1, -1, -1, -1]
    monkeypatch.setattr(gltf_motion, "MOST_STEPS", 5000)  # of 601 poses by three steps
    some = load_scene(file)
    assert len(some.animations) == 2
    assert "the first 2 of them are used" in " ".join(some.notes)
    assert some.content_hash == whole.content_hash


def test_a_long_animation_of_many_cameras_takes_a_bounded_number_of_poses(tmp_path):
    glb = animated(1000)
    glb.data = glb.data.replace(np.array([0, 10], np.float32).tobytes(), np.array([0, 1e6], np.float32).tobytes())
    poses = [len(animation.times) for animation in load_scene(glb.write(tmp_path / "a.glb")).animations]
    assert 0 < sum(poses) <= gltf_motion.MOST_STEPS


def test_nodes_that_others_move(tmp_path):
    """Those below two movers count from the upper one; of what is not drawn too, as it moves what is."""
    children = [[1, 3], [2], [], [4], []]
    nodes = [{"children": some} if some else {"mesh": 0} for some in children]
    file = Path(square_scene(*nodes, {"mesh": 0}, scenes=[{"nodes": [1]}]).write(tmp_path / "a.glb"))
    found = GltfNodes(GltfDocument(file, SceneFiles(file), RawScene()))
    assert found.below({1, 2}) == {1: 1, 2: 2}
    assert found.below({0, 2}) == {0: 1, 1: 2, 2: 3, 3: 2, 4: 3}
    assert found.below(()) == {}
    assert found.lineage(4, 2) == [3, 4]
    assert found.lineage(4, 3) == [0, 3, 4]


def test_matrices_of_all_nodes_are_those_of_each(tmp_path):
    rng = np.random.default_rng(5)
    sizes = {name: len(rest) for name, rest in AT_REST.items()} | {"matrix": 16}
    kinds = [["matrix"], ["rotation"], list(AT_REST), [], ["scale", "translation"]]
    nodes: list[dict[str, Any]] = [
        {name: rng.normal(size=sizes[name]).tolist() for name in kinds[number % 5]} for number in range(200)
    ]
    for number in range(1, 200):
        nodes[int(rng.integers(max(0, number - 9), number))].setdefault("children", []).append(number)
    file = Path(square_scene(*nodes).write(tmp_path / "a.glb"))
    found = GltfNodes(GltfDocument(file, SceneFiles(file), RawScene()))
    for number, node in enumerate(nodes):
        (local,) = local_matrices([node])
        assert found.local[number].tobytes() == local.tobytes()
        above = found.parents[number]
        world = local if above < 0 else product(found.world[above], local)
        assert found.world[number].tobytes() == world.tobytes()


def test_names_of_libraries_in_a_line_are_looked_for_as_they_are_many(tmp_path, monkeypatch):
    names: list[bytes] = []
    real, asked = SceneFiles.find, {}

    def find(files: SceneFiles, file: Path, name: bytes) -> Path | None:
        names.append(name)
        return real(files, file, name)

    monkeypatch.setattr(SceneFiles, "find", find)
    for many in (100, 200, 400, 4000):
        line = " ".join(f"x{number}.mtl" for number in range(many))
        (tmp_path / "a.obj").write_text(f"mtllib {line}\n{TRIANGLE}", encoding="utf-8")
        names.clear()
        scene = load_scene(str(tmp_path / "a.obj"))
        asked[many] = len(names)
    assert asked[400] < 2.2 * asked[200] < 2.2 * 2.2 * asked[100]
    assert asked[4000] < 3 * asked[400]
    assert f"names more than {obj.MOST_LIBRARIES:,} material libraries" in " ".join(scene.notes)


def test_a_library_with_many_blanks_is_found_where_it_is_alone(tmp_path):
    name = " ".join(["a"] * 40) + ".mtl"
    (tmp_path / name).write_text("newmtl m\nKd 1 0 0\n", encoding="utf-8")
    (tmp_path / "b c.mtl").write_text("newmtl n\nKd 0 1 0\n", encoding="utf-8")
    for line, materials in ((name, "m"), (f"b c.mtl {name}", "nm"), (f"{name} # {name}", "m")):
        text = f"mtllib {line}\n" + "".join(f"usemtl {material}\n{TRIANGLE}" for material in materials)
        (tmp_path / "a.obj").write_text(text, encoding="utf-8")
        notes = " ".join(load_scene(str(tmp_path / "a.obj")).notes)
        assert "is missing" not in notes
        assert "no library defines" not in notes


def test_map_statements_of_any_length():
    """Each word is looked at once."""
    statement = map_statement(b"-mm 0 1 " * 100_000 + b"-s 2 3 t 1.png ")
    assert (statement.name, statement.scale, statement.ignored) == (b"t 1.png", (2, 3), [])
    digits = b"1" * 200_000 + b"x"
    assert map_statement(b"-s " + digits + b" t.png").name == digits + b" t.png"
    assert map_statement(b"-s 1").name == b"1"
    assert map_statement(b"-clamp").name == map_statement(b"").name == b""


@pytest.mark.parametrize("pairs", [1, 50, 1 << 40])
def test_a_panorama_is_the_same_by_parts_of_any_size(tmp_path, monkeypatch, pairs):
    scene = load_scene(str(room(tmp_path)))
    seen = rays.Rays(scene).panorama(np.array([2.0, 0, 3.0]))
    place = standing.decide(scene)
    monkeypatch.setattr(rays, "_PAIRS", pairs)
    again = rays.Rays(scene).panorama(np.array([2.0, 0, 3.0]))
    for name in ("distances", "triangles", "fronts"):
        assert getattr(seen, name).tobytes() == getattr(again, name).tobytes()
    assert standing.decide(scene) == place


def test_a_scene_that_takes_too_much_work_is_an_object_with_a_note(tmp_path, monkeypatch):
    file = room(tmp_path)
    whole = load_scene(str(file))
    assert whole.place
    assert GIVEN_UP not in whole.notes
    monkeypatch.setattr(standing, "MOST_PAIRS", 100)
    for unit in (None, 1.0):
        scene = load_scene(str(file), unit=unit)
        assert not scene.place
        assert scene.notes.count(GIVEN_UP) == 1
    assert GIVEN_UP in load_scene(str(file), unit=1.0).because
    assert make_path(scene, "walk").name == "orbit"


def test_pairs_of_rays_and_triangles_are_counted(tmp_path):
    """The walls of a room are met by every ray, or by most."""
    scene = load_scene(str(room(tmp_path)))
    work = SimpleNamespace(steps=0)
    work.take = lambda steps: setattr(work, "steps", work.steps + steps)
    rays.Rays(scene, work).panorama(np.array([2.0, 0, 3.0]))  # type: ignore[arg-type]  # counts only
    every = rays.TURNS * len(rays.SLOPES)
    assert every < work.steps <= every * scene.triangle_count


def test_a_walk_among_too_much_is_a_step(tmp_path, monkeypatch):
    scene = load_scene(str(room(tmp_path)))
    assert not any("small step" in note for note in make_path(scene, "walk").notes)
    monkeypatch.setattr(walking, "MOST_POINTS", 1000)
    path = make_path(scene, "walk")
    assert path.name == "walk"
    assert any("So much stands around" in note and "small step" in note for note in path.notes)
