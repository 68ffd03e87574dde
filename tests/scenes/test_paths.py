"""Camera paths: smooth, clear of geometry, framed, reproducible; files are read exactly and refused by line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shading_atlas_bench.scenes.builder import Palette, ball, box, merge, sheet
from shading_atlas_bench.scenes.hall import make_hall
from shading_atlas_bench.scenes.load import load_scene
from shading_atlas_bench.scenes.model import Camera, CameraAnimation, Material, Scene
from shading_atlas_bench.scenes.paths import HALF_ACROSS, HALF_UP, CameraPath, PathError, Poses, list_paths, make_path
from shading_atlas_bench.scenes.quaternions import conjugate, from_matrix, looking, multiply, rotate, slerp
from shading_atlas_bench.scenes.village import make_village
from tests.conftest import REAL_SCENES
from tests.scenes.checks import nearest, point_distance

FORWARD = np.array([0.0, 0.0, -1.0])


@pytest.fixture(scope="module")
def hall() -> Scene:
    return make_hall()


@pytest.fixture(scope="module")
def village() -> Scene:
    return make_village()


def _room(unit: float = 1.0, wall: bool = True, **properties) -> Scene:
    """A room of 8 x 3 x 8 m with a wall across most of it, in any unit."""
    palette = Palette()
    m = palette.material(Material("grey"))
    parts = [
        sheet((-4, 0, 4), (8, 0, 0), (0, 0, -8), m),
        sheet((-4, 3, -4), (8, 0, 0), (0, 0, 8), m),
        sheet((-4, 0, -4), (8, 0, 0), (0, 3, 0), m),
        sheet((4, 0, 4), (-8, 0, 0), (0, 3, 0), m),
        sheet((-4, 0, 4), (0, 0, -8), (0, 3, 0), m),
        sheet((4, 0, -4), (0, 0, 8), (0, 3, 0), m),
    ]
    if wall:
        parts.append(box((-1.5, 1.5, 0), (5.0, 3.0, 0.2), m))
    scene = palette.assemble("room", parts, metres_per_unit=unit, **properties)
    scene.positions /= np.float32(unit)
    return scene


def _object(scale: float) -> Scene:
    palette = Palette()
    m = palette.material(Material("grey"))
    scene = palette.assemble("thing", [merge([ball(1.0, 12, m), box((0, 1.5, 0), (0.5, 3, 4), m)])], place=False)
    scene.positions *= np.float32(scale)
    return scene


def _assert_smooth(path: CameraPath, unit: float) -> None:
    steps = np.linalg.norm(np.diff(path.positions, axis=0), axis=1) * unit
    assert steps.max() <= 0.05
    cosine = np.abs(np.sum(path.orientations[1:] * path.orientations[:-1], axis=1))
    assert np.degrees(2 * np.arccos(np.minimum(cosine, 1))).max() <= 4
    assert np.allclose(np.linalg.norm(path.orientations, axis=1), 1, atol=1e-9)
    assert np.all(np.diff(path.times_ms) > 0)


@pytest.mark.parametrize("name", ["hall", "village"])
def test_walk_of_built_in_scenes_is_smooth_and_clear(name: str, hall: Scene, village: Scene) -> None:
    scene = {"hall": hall, "village": village}[name]
    path = make_path(scene, "walk")
    assert (path.name, path.frames, path.notes) == ("walk", 660, ())
    _assert_smooth(path, 1.0)
    walked = np.linalg.norm(np.diff(path.positions, axis=0), axis=1).sum()
    assert 9 < walked < 13
    for position in path.positions[::20]:
        assert point_distance(scene, position, 0.6) > 0.2
        down, _ = nearest(scene, position, np.array([0.0, -1.0, 0.0]))
        assert 1.4 < down < 1.8


def test_paths_are_reproducible_and_their_hash_tells_them_apart(hall: Scene) -> None:
    path = make_path(hall, "walk")
    assert make_path(hall, "walk").hash == path.hash
    others = [make_path(hall, "walk", seed=1), make_path(hall, "walk", 10), make_path(hall, "orbit")]
    assert len({path.hash, *(other.hash for other in others)}) == 4


def test_a_part_of_a_path_is_its_beginning_and_goes_on_the_same_way(hall: Scene) -> None:
    whole, part = make_path(hall, "walk"), make_path(hall, "walk", 12)
    assert part.frames == 12
    assert np.array_equal(part.positions, whole.positions[:12])
    for later in (1.0, 50.0, 250.0):
        for k in range(2):
            wanted = whole.pose_at(part.times_ms[-1] + later)[k]
            assert np.allclose(part.pose_at(part.times_ms[-1] + later)[k], wanted, atol=1e-12)


def test_all_frames_are_poses_of_the_path(hall: Scene) -> None:
    path = make_path(hall, "turntable")
    for k in (0, 5, path.frames - 1):
        position, orientation = path.pose_at(path.times_ms[k])
        assert np.array_equal(position, path.positions[k])
        assert np.array_equal(orientation, path.orientations[k])


def test_poses_at_many_times_are_those_at_each(hall: Scene) -> None:
    poses = make_path(hall, "walk", 12).poses
    times = np.concatenate([np.arange(-20.0, poses.times_ms[-1] + 300, 0.7), poses.times_ms])
    together, each = poses.at(times), [poses.at(times[k : k + 1]) for k in range(len(times))]
    assert np.array_equal(together.positions, np.concatenate([pose.positions for pose in each]))
    assert np.array_equal(together.orientations, np.concatenate([pose.orientations for pose in each]))


def test_of_two_keys_of_one_time_the_later_one_stays() -> None:
    turns = np.tile([0.0, 0.0, 0.0, 1.0], (3, 1))
    positions = np.array([[0.0, 0, 0], [2, 0, 0], [9, 0, 0]])
    jump = Poses(np.array([0.0, 10, 10]), positions, turns)
    assert jump.at(np.array([-1.0, 0, 5, 10, 11, 500])).positions[:, 0].tolist() == [0, 0, 1, 9, 9, 9]
    both = Poses(np.zeros(2), positions[:2], turns[:2])
    assert both.at(np.array([-1.0, 0, 1])).positions[:, 0].tolist() == [2, 2, 2]


def test_beyond_the_end_the_path_goes_on(hall: Scene) -> None:
    for name in ("walk", "orbit", "turntable"):
        path = make_path(hall, name)
        end = path.times_ms[-1]
        places = np.array([path.pose_at(t)[0] for t in np.arange(end - 50, end + 250, 5)])
        steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
        assert steps.max() < 3 * np.median(steps) + 1e-9
        assert steps.min() > 0


@pytest.mark.parametrize("unit", [1.0, 0.01, 1000.0])
def test_walk_finds_its_way_around_a_wall_in_any_unit(unit: float) -> None:
    eye = np.array([-2.0, 1.5, 2.0]) / unit
    scene = _room(unit, cameras=[Camera(tuple(eye), (0.0, 0.0, -1.0))])
    path = make_path(scene, "walk")
    assert path.name == "walk"
    _assert_smooth(path, unit)
    assert np.linalg.norm(path.positions[0] - eye) * unit < 0.3
    assert rotate(path.orientations[0], FORWARD) @ FORWARD > 0.95
    clear = [point_distance(scene, p, 0.6 / unit) * unit for p in path.positions[::15]]
    assert min(clear) > 0.2
    assert np.allclose(path.positions[:, 1] * unit, 1.5, atol=0.15)
    assert path.positions[:, 2].min() * unit < -1  # it came around the wall


def test_walk_without_camera_starts_inside() -> None:
    path = make_path(_room(), "walk")
    assert path.name == "walk"
    assert "viewpoint" in path.notes[0]
    assert np.all(np.abs(path.positions[:, [0, 2]]) < 3.8)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("name", ["walk", "orbit", "turntable"])
def test_objects_are_orbited_and_framed_at_any_size(scale: float, name: str) -> None:
    scene = _object(scale)
    path = make_path(scene, name)
    assert path.name == ("orbit" if name == "walk" else name)
    assert path.frames == (72 if name == "turntable" else 300)
    assert (name == "walk") == ("orbit" in " ".join(path.notes))
    for k in range(0, path.frames, 12):
        seen = rotate(conjugate(path.orientations[k]), scene.positions - path.positions[k])
        across, up = np.degrees(np.arctan2(np.abs(seen[:, :2]), -seen[:, 2:])).max(axis=0)
        assert across <= HALF_ACROSS
        assert up <= HALF_UP
        assert across > HALF_ACROSS / 3 or up > HALF_UP / 3


def test_turntable_turns_five_degrees_per_frame() -> None:
    path = make_path(_object(1.0), "turntable", 20)
    low, high = _object(1.0).bounds
    angle = np.unwrap(np.arctan2(*(path.positions - (low + high) / 2)[:, [0, 2]].T))
    assert np.allclose(np.degrees(np.diff(angle)), 5)


def test_animation_is_sampled_at_sixty_hertz() -> None:
    turn = looking(np.array([[0.0, 0, -1], [1.0, 0, 0]]))
    keys = CameraAnimation("fly", np.array([100.0, 1100.0]), np.array([[0.0, 0, 0], [6.0, 0, 0]]), turn)
    scene = _object(1.0)
    with pytest.raises(PathError, match="no camera animation"):
        make_path(scene, "animation")
    scene.animations = [keys]
    path = make_path(scene, "animation")
    assert path.frames == 61
    assert np.allclose(path.positions[30], [3, 0, 0])
    assert np.allclose(rotate(path.orientations[30], FORWARD), np.array([1, 0, -1]) / np.sqrt(2))
    assert np.allclose(path.pose_at(1000 + 250)[0], [7.5, 0, 0])


def test_more_frames_than_there_are_is_noted() -> None:
    path = make_path(_object(1.0), "turntable", 500)
    assert path.frames == 72
    assert "500" in path.notes[0]


GOOD = "# pose per line\n0 1 2 3 0 0 0 1\n\n16.5, 1.1, 2, 3, 0, 0, 0, 2 # longer quaternion\n"


def test_text_file(tmp_path: Path) -> None:
    file = tmp_path / "mine.txt"
    file.write_text(GOOD, encoding="utf-8")
    scene = _object(1.0)
    scene.origin = np.array([1.0, 0, 0])
    path = make_path(scene, str(file))
    assert (path.name, path.frames) == ("mine", 2)
    assert np.allclose(path.positions, [[0.0, 2, 3], [0.1, 2, 3]])
    assert np.array_equal(path.orientations, [[0, 0, 0, 1]] * 2)
    assert np.allclose(path.pose_at(33.0)[0], [0.2, 2, 3])


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("0 0 0 0 0 0 0\n", 1, "8 numbers"),
        (GOOD + "20 a 2 3 0 0 0 1\n", 5, "8 numbers"),
        (GOOD + "16.5 1 2 3 0 0 0 1\n", 5, "does not follow"),
        ("0 0 0 0 0 0 0 1\n1e-320 0 0 0 0 0 0 1\n", 2, "less than 1 after"),
        ("0 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n1.99 0 0 0 0 0 0 1\n", 3, "less than 1 after"),
        ("0 1_6 0 0 0 0 0 1\n", 1, "8 numbers"),
        ("0 \u0661.6 0 0 0 0 0 1\n", 1, "8 numbers"),
        (GOOD + "20 nan 2 3 0 0 0 1\n", 5, "8 numbers"),
        (GOOD + "20 1 2 3 0 0 0 0\n", 5, "quaternion is zero"),
    ],
)
def test_malformed_lines_are_named(tmp_path: Path, text: str, line: int, words: str) -> None:
    file = tmp_path / "bad.txt"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(PathError, match=rf"bad\.txt, line {line}: .*{words}"):
        make_path(_object(1.0), str(file))


def test_a_thousand_poses_a_second_are_enough(tmp_path: Path) -> None:
    """Times of whole milliseconds, as they are written after some arithmetic."""
    times = (np.arange(20) + 0.1).tolist()
    assert min(np.diff(times)) < 1
    (tmp_path / "a.txt").write_text("".join(f"{time!r} 0 0 0 0 0 0 1\n" for time in times), encoding="utf-8")
    assert make_path(_object(1.0), str(tmp_path / "a.txt")).frames == 20


def test_unknown_paths_and_counts_are_refused(tmp_path: Path) -> None:
    with pytest.raises(PathError, match="did you mean walk"):
        make_path(_object(1.0), "wlak")
    with pytest.raises(PathError, match="at least one"):
        make_path(_object(1.0), "orbit", 0)
    (tmp_path / "empty.txt").write_text("# nothing\n", encoding="utf-8")
    with pytest.raises(PathError, match="no poses"):
        make_path(_object(1.0), str(tmp_path / "empty.txt"))
    assert set(list_paths()) == {"walk", "orbit", "turntable", "animation"}


VECTORS = st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1)


@given(VECTORS, VECTORS, st.floats(0, 1))
@settings(max_examples=60, deadline=None)
def test_slerp_keeps_unit_length_and_a_constant_speed(p: tuple, q: tuple, t: float) -> None:
    a, b = (np.array(v) / np.linalg.norm(v) for v in (p, q))
    middle = slerp(a, b, t)
    assert np.linalg.norm(middle) == pytest.approx(1, abs=1e-9)

    def angle(x: np.ndarray, y: np.ndarray) -> float:
        turn = multiply(conjugate(x), y)
        return 2 * float(np.arctan2(np.linalg.norm(turn[:3]), abs(turn[3])))

    assert angle(a, middle) == pytest.approx(t * angle(a, b), abs=1e-6)
    assert angle(slerp(a, b, 1.0), b) < 1e-7
    none = np.zeros((1, 4))  # of a file that has no rotation
    assert np.array_equal(slerp(none, none, np.array([t])), none)


@given(VECTORS, st.tuples(*[st.floats(-10, 10)] * 3))
@settings(max_examples=60, deadline=None)
def test_quaternions_and_matrices_agree(p: tuple, v: tuple) -> None:
    q = np.array(p) / np.linalg.norm(p)
    matrix = np.stack([rotate(q, axis) for axis in np.eye(3)], axis=1)
    assert np.allclose(matrix @ v, rotate(q, np.array(v)), atol=1e-9)
    again = from_matrix(matrix)
    assert np.allclose(again, q, atol=1e-7) or np.allclose(again, -q, atol=1e-7)


@given(st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda d: np.linalg.norm(d) > 0.05))
@settings(max_examples=60, deadline=None)
def test_looking_looks_there_upright(direction: tuple) -> None:
    q = looking(np.array(direction))
    assert np.allclose(rotate(q, FORWARD), np.array(direction) / np.linalg.norm(direction), atol=1e-9)
    assert rotate(q, np.array([1.0, 0, 0]))[1] == pytest.approx(0, abs=1e-9) or abs(direction[1]) > 0.04
    assert rotate(q, np.array([0.0, 1, 0]))[1] >= -1e-9


@pytest.mark.parametrize("name", ["living_room/scene.glb", "sibenik/sibenik.ply", "stanford_bunny/scene.glb"])
def test_walks_through_real_scenes(name: str) -> None:
    file = REAL_SCENES / name
    if not file.exists():
        pytest.skip("real scenes are not here")
    scene = load_scene(str(file))
    path = make_path(scene, "walk")
    assert path.name == ("walk" if scene.place else "orbit")
    if scene.place:
        _assert_smooth(path, scene.metres_per_unit)
        unit = scene.metres_per_unit
        assert min(point_distance(scene, p, 0.5 / unit) * unit for p in path.positions[::30]) > 0.15
