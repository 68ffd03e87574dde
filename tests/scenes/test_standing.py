"""Places and objects are told apart without cameras, and a person stands where there is something to see."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from shading_atlas_bench.arithmetic.functions import sin
from shading_atlas_bench.scenes.builder import Palette, ball, box, boxes, merge, sheet
from shading_atlas_bench.scenes.load import load_scene
from shading_atlas_bench.scenes.model import Material, Scene
from shading_atlas_bench.scenes.paths import make_path
from shading_atlas_bench.scenes.rays import SLOPES, TURNS, Rays, panorama_directions
from shading_atlas_bench.scenes.standing import decide
from shading_atlas_bench.scenes.village import make_village
from tests.conftest import REAL_SCENES
from tests.scenes.checks import nearest, point_distance

PALETTE = Palette()
GREY = PALETTE.material(Material("grey"))
BOTH = PALETTE.material(Material("seen from both sides", double_sided=True))


def _scene(*parts) -> Scene:
    return PALETTE.assemble("made", parts)


def _ground(size: float, divisions: int = 1):
    return sheet((-size / 2, 0, size / 2), (size, 0, 0), (0, 0, -size), GREY, (divisions, divisions))


def _room(width: float, height: float, depth: float, door: float = 0.0):
    """Inward walls, floor and ceiling around the origin; a doorway in the wall at +z."""
    x, z, side = width / 2, depth / 2, (width - door) / 2
    parts = [
        sheet((-x, 0, z), (width, 0, 0), (0, 0, -depth), GREY),
        sheet((-x, height, -z), (width, 0, 0), (0, 0, depth), GREY),
        sheet((-x, 0, -z), (width, 0, 0), (0, height, 0), GREY),
        sheet((-x, 0, z), (0, 0, -depth), (0, height, 0), GREY),
        sheet((x, 0, -z), (0, 0, depth), (0, height, 0), GREY),
        sheet((x, 0, z), (-side, 0, 0), (0, height, 0), GREY),
        sheet((-x + side, 0, z), (-side, 0, 0), (0, height, 0), GREY),
    ]
    return merge(parts)


def _closed_room() -> Scene:
    table = box((1.5, 0.7, 1), (1.6, 0.05, 0.9), GREY)
    return _scene(_room(7, 2.8, 5), table, boxes([(-3.2, 1, 0), (2, 0.5, -2.1)], [(0.5, 2, 1.5), (2, 1, 0.6)], GREY))


def _house_with_open_door() -> Scene:
    walls = boxes(
        [(-3.6, 1.5, 0), (3.6, 1.5, 0), (0, 1.5, -3.1), (0, 3.1, 0)],
        [(0.2, 3, 6), (0.2, 3, 6), (7.4, 3, 0.2), (7.4, 0.2, 6.4)], GREY,
    )  # fmt: skip
    fronts = boxes([(-2.1, 1.5, 3.1), (2.1, 1.5, 3.1)], [(3.2, 3, 0.2), (3.2, 3, 0.2)], GREY)
    return _scene(_ground(30), walls, fronts, box((-2, 0.4, -2), (1.5, 0.8, 1), GREY))


def _street() -> Scene:
    rows = [(side * 9.0, 4, z) for side in (-1, 1) for z in range(-24, 25, 12)]
    return _scene(_ground(80), boxes(rows, [(9, 8, 10)] * len(rows), GREY))


def _terrain() -> Scene:
    land = _ground(120, 60)
    x, _, z = land.positions.T
    land.positions[:, 1] = 4 * sin(x / 15) * sin(z / 19)
    return _scene(land)


def _lane(thickness: float, sunk: float = 0.0, material: int = BOTH) -> Scene:
    """Closed houses without anything inside, on ground that is a slab of some thickness."""
    rows = [(x, 3.5 - sunk, z) for x in (-15.5, -3.5, 8.5) for z in (-8, 8)]
    ground = box((-3.5, -thickness / 2, 0), (37, thickness, 28), material)
    return _scene(ground, boxes(rows, [(9, 7, 8)] * len(rows), material))


def _solid_house(thickness: float) -> Scene:
    """A house of solid slabs."""
    middles = [(-4.1, 1.5, 0), (4.1, 1.5, 0), (0, 1.5, -3.1), (0, 1.5, 3.1), (0, 3.1, 0), (0, -thickness / 2, 0)]
    sizes = [(0.2, 3, 6), (0.2, 3, 6), (8.4, 3, 0.2), (8.4, 3, 0.2), (8.4, 0.2, 6.4), (8, thickness, 6)]
    return _scene(boxes(middles, sizes, BOTH))


def _box_room(material: int, *things) -> Scene:
    """A room made of a box whose fronts are outside."""
    return _scene(box((0, 1.4, 0), (6, 2.8, 5), material), *things)


def _abutting_blocks() -> Scene:
    """A slab that stands upright, and a bar against its middle; neither has anything inside."""
    return _scene(box((0, 20, 2.5), (40, 40, 5), BOTH), box((0, 20, 62.5), (10, 10, 115), BOTH))


TABLE = box((-0.4, 0.375, -0.15), (1.2, 0.75, 0.7), BOTH)
PLACES = {"room": _closed_room, "house": _house_with_open_door, "street": _street, "terrain": _terrain}
OBJECTS = {
    "ball": lambda: _scene(ball(3, 24, GREY)),
    "block": lambda: _scene(box((0, 4, 0), (8, 8, 8), GREY)),
    "statue on wide ground": lambda: _scene(_ground(60), box((0, 0.5, 0), (2, 1, 2), GREY), ball(1.5, 24, GREY)),
    "table": lambda: _scene(box((0, 1, 0), (2, 0.1, 2), GREY)),
    "wall": lambda: _scene(box((0, 2, 0), (20, 4, 4), GREY)),
    "flat ground": lambda: _scene(_ground(60)),
    "room seen from outside only": lambda: _box_room(GREY, TABLE),
    "empty box": lambda: _box_room(BOTH),
    "blocks that touch": _abutting_blocks,
}


@pytest.mark.parametrize("name", PLACES)
def test_a_place_is_stood_in(name: str) -> None:
    scene = PLACES[name]()
    standing = decide(scene)
    assert standing.place, standing.reason
    assert standing.camera
    eye, way = np.array(standing.camera.position), np.array(standing.camera.direction)
    down, _ = nearest(scene, eye, np.array([0.0, -1, 0]))
    assert down == pytest.approx(1.6, abs=0.05)
    assert point_distance(scene, eye, 0.6) >= 0.45
    assert way[1] == 0
    up, _ = nearest(scene, eye, np.array([0.0, 1, 0]))
    assert np.isfinite(up) == (name in ("room", "house"))
    if name != "terrain":
        ahead, _ = nearest(scene, eye, way)
        assert 2.5 < ahead < 60
    path = make_path(scene, "walk")
    assert path.name == "walk"
    assert "viewpoint" in path.notes[0]


def _height(scene: Scene) -> float:
    """Of the eyes that stand in a place, in the scene's units."""
    standing = decide(scene)
    assert standing.place, standing.reason
    assert standing.camera
    return standing.camera.position[1]


@pytest.mark.parametrize("material", [GREY, BOTH])
@pytest.mark.parametrize("sunk", [0.0, 0.15])
@pytest.mark.parametrize("thickness", [0.01, 0.2, 0.4, 0.6, 1.0, 1.2, 1.4, 2.0])
def test_ground_may_have_a_thickness(thickness: float, sunk: float, material: int) -> None:
    lane = _lane(thickness, sunk, material)
    assert "ground" in decide(lane).reason
    assert _height(lane) == pytest.approx(1.6, abs=1e-3)
    feet = replace(lane, positions=lane.positions / np.float32(0.3048), metres_per_unit=0.3048)
    assert _height(feet) * 0.3048 == pytest.approx(1.6, abs=1e-3)


@pytest.mark.parametrize("thickness", [0.01, 0.2, 0.6, 1.2, 1.6])
def test_a_floor_may_have_a_thickness(thickness: float) -> None:
    assert _height(_solid_house(thickness)) == pytest.approx(1.6, abs=1e-3)


def test_a_furnished_box_is_a_room_whichever_way_it_is_wound() -> None:
    assert _height(_box_room(BOTH, TABLE)) == pytest.approx(1.6, abs=1e-3)


def test_a_village_is_outdoors_though_its_houses_are_hollow() -> None:
    standing = decide(replace(make_village(detail=130_000), cameras=[], route=None))
    assert standing.place
    assert "ground" in standing.reason


@pytest.mark.parametrize("name", OBJECTS)
def test_an_object_is_not_walked_on(name: str) -> None:
    standing = decide(OBJECTS[name]())
    assert not standing.place
    assert standing.camera is None
    assert standing.reason.endswith(".")


@pytest.mark.parametrize("unit", [0.01, 1000.0])
def test_a_unit_changes_nothing_but_numbers(unit: float) -> None:
    scene = _closed_room()
    other = replace(scene, positions=scene.positions / np.float32(unit), metres_per_unit=unit)
    here, there = decide(scene), decide(other)
    assert (here.place, here.reason) == (there.place, there.reason)
    assert here.camera
    assert there.camera
    assert np.array(there.camera.position) * unit == pytest.approx(np.array(here.camera.position), abs=0.3)


def test_a_camera_decides_alone() -> None:
    room, statue = _closed_room(), OBJECTS["statue on wide ground"]()
    camera = decide(room).camera
    assert camera
    assert decide(replace(statue, cameras=[replace(camera, position=(9.0, 1.0, 9.0))])).place
    far = replace(camera, position=(0.0, 90.0, 0.0))
    assert not decide(replace(room, cameras=[far])).place


def test_a_panorama_is_what_its_single_rays_see() -> None:
    rng = np.random.default_rng(3)
    scene = _scene(_room(7, 2.8, 5), boxes(rng.uniform(-3, 3, (40, 3)), rng.uniform(0.01, 1, (40, 3)), GREY))
    rays = Rays(scene)
    for start in (np.array([0.1, 1.3, 0.2]), np.array([2.9, 1.0, -1.7])):
        seen = rays.panorama(start)
        for turn in range(0, TURNS, 5):
            for slope in range(len(SLOPES)):
                way = panorama_directions()[turn, slope]
                distance, triangle = nearest(scene, start, way)
                assert seen.distances[turn, slope] == pytest.approx(distance, rel=1e-5)
                assert rays.distance(start, way) == pytest.approx(distance, rel=1e-5)
                a, b, c = scene.positions[scene.indices[triangle]].astype(np.float64)
                assert seen.fronts[turn, slope] == (np.cross(b - a, c - a) @ way < 0)


REAL_PLACES = {
    "classroom": 12.0, "dining_room": 12.0, "living_room": 4.0, "living_room_2": 4.0, "staircase": 4.0,
    "sibenik": 30.0, "sponza_crytek": 25.0, "sponza_dabrovic": 20.0, "torcs_street1": 1000.0,
}  # fmt: skip
REAL_OBJECTS = (
    "gltf_OrientationTest", "gltf_RecursiveSkeletons", "gltf_SimpleInstancing", "littlest_tokyo", "stanford_bunny",
    "stanford_dragon",
)  # fmt: skip


def _without_cameras(name: str, folder: Path) -> Scene:
    """A real scene, loaded from beside a cameras.json that states its scale only."""
    files = [f for f in (REAL_SCENES / name).glob("*") if f.suffix in (".glb", ".obj", ".ply")]
    if not files:
        pytest.skip("real scenes are not here")
    (folder / files[0].name).write_bytes(files[0].read_bytes())
    known = REAL_SCENES / name / "cameras.json"
    if known.exists():
        scale = {"metres_per_unit": json.loads(known.read_text(encoding="utf-8"))["metres_per_unit"]}
        (folder / "cameras.json").write_text(json.dumps(scale), encoding="utf-8")
    return load_scene(str(folder / files[0].name))


@pytest.mark.parametrize("name", REAL_PLACES)
def test_real_places_are_stood_in(name: str, tmp_path: Path) -> None:
    scene = _without_cameras(name, tmp_path)
    assert scene.place, scene.because
    eye, unit = np.array(scene.cameras[0].position), scene.metres_per_unit
    down, _ = nearest(scene, eye, np.array([0.0, -1, 0]))
    assert 1.0 < down * unit < 1.7  # plants may stand below
    seen = Rays(scene).panorama(eye)
    assert seen.distances.min() * unit >= 0.5
    ahead = panorama_directions()[:, 3] @ np.array(scene.cameras[0].direction) > 0.9
    assert np.median(seen.distances[ahead]) * unit > 2
    assert (seen.triangles[ahead] >= 0).mean() > 0.5
    known = json.loads((REAL_SCENES / name / "cameras.json").read_text(encoding="utf-8"))["cameras"]
    away = min(np.linalg.norm(np.array(camera["eye"]) - scene.origin - eye) for camera in known)
    assert away * unit < REAL_PLACES[name]


@pytest.mark.parametrize("name", REAL_OBJECTS)
def test_real_objects_are_objects(name: str, tmp_path: Path) -> None:
    scene = _without_cameras(name, tmp_path)
    assert not scene.place
    assert not scene.cameras
