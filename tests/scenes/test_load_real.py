"""Real scenes and torture files: each loads whole, or is turned down in one sentence."""

import numpy as np
import pytest

from shading_atlas_bench.scenes.load import load_scene
from shading_atlas_bench.scenes.model import SceneError
from tests.conftest import REAL_SCENES

LARGE = 12_000_000  # bytes; larger files are measured by hand
SUFFIXES = {".glb", ".obj", ".ply", ".stl", ".off"}
FILES = sorted(
    file for file in REAL_SCENES.rglob("*") if file.suffix.lower() in SUFFIXES and file.stat().st_size < LARGE
)
UNUSABLE = {"Cray_right.obj", "assimp_BoxWithInfinites.glb"}  # every vertex is near 1e38 or infinite

# Triangles as the files' own documentation and viewers count them, where readers are known to go wrong.
COUNTS = {
    "SimpleInstancing.glb": 125 * 12,
    "RecursiveSkeletons.glb": 84 * 76,
    "CornellBox-Original.obj": 36,
    "CornellBox-Water.obj": 7088,
    "NegativeScaleTest.glb": 7724,
    "ReciprocatingSaw.glb": 198_470,
}

pytestmark = pytest.mark.skipif(not FILES, reason="the folder of real scenes is not there")


@pytest.mark.parametrize("file", FILES, ids=lambda file: f"{file.parent.name}/{file.name}")
def test_real_scene(file):
    if file.name in UNUSABLE:
        with pytest.raises(SceneError, match="no usable triangles"):
            load_scene(str(file))
        return
    scene = load_scene(str(file))
    assert scene.triangle_count == COUNTS.get(file.name, scene.triangle_count)
    assert np.isfinite(scene.positions).all()
    assert np.isfinite(scene.uvs).all()
    assert scene.indices.min() >= 0
    assert np.bincount(scene.indices.ravel(), minlength=len(scene.positions)).min() > 0
    assert scene.material_ids.max() < len(scene.materials)
    assert np.abs(np.linalg.norm(scene.normals, axis=1) - 1).max() < 1e-3
    assert np.abs(sum(scene.bounds)).max() <= 0.01 * max(scene.bounds[1])
    assert scene.lights
    assert scene.exposure > 0


@pytest.mark.parametrize("name", ["sponza_crytek", "living_room", "torcs_street1"])
def test_normals_agree_with_fronts(name):
    file = REAL_SCENES / name / "scene.glb"
    scene = load_scene(str(file))
    corners = scene.positions[scene.indices].astype(np.float64)
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    mean = scene.normals[scene.indices].sum(axis=1)
    assert (np.einsum("ti,ti->t", faces, mean) > 0).mean() > 0.97


def test_the_animated_city_has_cameras():
    scene = load_scene(str(REAL_SCENES / "gltf_VC" / "VC.glb"))
    assert len(scene.cameras) == len(scene.animations) == 14
    assert scene.cameras[0].up[1] > 0.95
    assert scene.place


@pytest.mark.parametrize("name", ["Original", "Glossy", "Mirror", "Sphere", "Water"])
def test_cornell_originals_equal_their_conversions(name):
    """The OBJ originals have tabs where other readers expect blanks; the GLB files were made with care."""
    folder = REAL_SCENES / "cornell_box"
    pair = (folder / "original" / f"CornellBox-{name}.obj", folder / f"CornellBox-{name}.glb")
    original, converted = (load_scene(str(file)) for file in pair)
    assert original.bounds[1] == pytest.approx(converted.bounds[1], rel=1e-5)
    assert original.origin == pytest.approx(converted.origin, abs=1e-5)
    assert original.features.largest == pytest.approx(converted.features.largest, rel=1e-3)
