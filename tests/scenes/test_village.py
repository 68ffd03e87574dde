"""The village: an outdoor place with masked foliage, from a hundred thousand triangles to millions."""

from __future__ import annotations

import numpy as np
import pytest

from shading_atlas_bench.scenes.model import Scene, SceneError
from shading_atlas_bench.scenes.village import HALF, HOUSES, LEAST_DETAIL, _Ground, make_village, street
from tests.scenes.checks import assert_sound, nearest


@pytest.fixture(scope="module")
def village() -> Scene:
    return make_village()


def test_default_village_is_sound(village: Scene) -> None:
    assert village.name == "village"
    assert_sound(village)
    assert village.features.mask
    assert village.features.normal_maps
    assert not village.features.blend
    assert village.lights[0].kind == "directional"
    assert village.lights[0].shadows


@pytest.mark.parametrize("detail", [LEAST_DETAIL, 200_000, 700_000])
def test_triangle_budget(detail: int) -> None:
    assert abs(make_village(detail).triangle_count - detail) <= 0.01 * detail


def test_same_seed_same_bytes_other_seed_other_scene(village: Scene) -> None:
    assert make_village().content_hash == village.content_hash
    assert make_village(seed=3).content_hash != village.content_hash


def test_impossible_detail_is_refused() -> None:
    with pytest.raises(SceneError, match="triangles"):
        make_village(detail=1000)


def test_masked_textures_are_cut_out_and_their_ground_has_no_dark_rim(village: Scene) -> None:
    masked = [m for m in village.materials if m.alpha_mode == "mask"]
    assert len(masked) == 3
    for material in masked:
        texels = village.textures[material.base_texture].texels
        assert material.double_sided
        assert 0.05 < (texels[..., 3] > 127).mean() < 0.8
        assert texels[..., 1][texels[..., 3] == 0].min() > 40


def test_ground_is_where_the_mesh_is(village: Scene) -> None:
    """The height that things stand on is the terrain's own, to a millimetre."""
    ground = _Ground(70, 0)
    rng = np.random.default_rng(5)
    names = [m.name for m in village.materials]
    terrain = np.isin(village.material_ids, [names.index("grass"), names.index("meadow")])
    land = Scene(
        "land", village.positions, village.indices[terrain], village.normals, village.uvs, village.colours,
        village.material_ids[terrain], village.materials,
    )  # fmt: skip
    for x, z in rng.uniform(-1.5 * HALF, 1.5 * HALF, (30, 2)):
        distance, _ = nearest(land, np.array([x, 200.0, z]), np.array([0.0, -1.0, 0.0]))
        assert 200 - distance == pytest.approx(float(ground.height(x, z)), abs=1e-3)


def test_houses_stand_beside_the_street() -> None:
    for x, side, _, width, _ in HOUSES[:-1]:
        assert side in (-1, 1)
        assert abs(street(x)) < 6
        assert width > 4


def test_triangles_come_object_by_object(village: Scene) -> None:
    """Neighbouring triangles in the list are near each other: as files of real scenes are."""
    centres = village.positions[village.indices].mean(axis=1)
    steps = np.linalg.norm(np.diff(centres, axis=0), axis=1)
    assert np.median(steps) < 0.6
    assert np.mean(steps > 20) < 0.01
