"""The shells: closed see-through surfaces, one inside the other."""

from __future__ import annotations

import numpy as np
import pytest

from shading_atlas_bench.scenes.features import content_digest
from shading_atlas_bench.scenes.load import list_scenes, load_scene
from shading_atlas_bench.scenes.model import SceneError
from shading_atlas_bench.scenes.shells import ALPHA, SHELLS, make_shells


@pytest.mark.parametrize("detail", [2_000, 60_000, 300_000])
def test_size_and_soundness(detail: int) -> None:
    scene = make_shells(detail)
    assert abs(scene.triangle_count - detail) <= 0.05 * detail
    for array in (scene.positions, scene.normals, scene.uvs):
        assert np.isfinite(array).all()
    assert np.allclose(np.linalg.norm(scene.normals, axis=1), 1, atol=1e-3)
    a, b, c = (scene.positions[scene.indices[:, k]].astype(np.float64) for k in range(3))
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).min() > 1e-10
    assert scene.cameras
    assert not scene.place


def test_everything_is_blended_and_seen_from_both_sides() -> None:
    scene = make_shells()
    assert scene.features.blend
    assert not scene.features.single_sided
    assert not scene.features.shadows
    assert {(m.alpha_mode, m.base_colour[3]) for m in scene.materials} == {("blend", ALPHA)}


def test_shells_are_closed_face_outwards_and_do_not_touch() -> None:
    scene = make_shells()
    inner = np.inf
    for material in range(len(SHELLS)):
        corners = scene.positions[scene.indices[scene.material_ids == material]].astype(np.float64)
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert ((normal * corners[:, 0]).sum(axis=1) > 0).all()
        assert np.abs(normal.sum(axis=0)).max() < 1e-4  # a closed surface's area vectors cancel out
        radius = np.linalg.norm(corners, axis=2)
        assert radius.max() < inner
        inner = radius.min()


def test_same_seed_same_bytes_other_seed_other_scene() -> None:
    scene = make_shells(5_000)
    assert content_digest(make_shells(5_000)) == scene.content_hash
    assert make_shells(5_000, seed=1).content_hash != scene.content_hash


def test_it_is_loaded_by_name() -> None:
    assert "shells" in list_scenes()
    assert load_scene("shells", detail=3_000).name == "shells"
    with pytest.raises(SceneError, match="can have"):
        load_scene("shells", detail=10)
