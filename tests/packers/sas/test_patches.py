"""Patches: every triangle in exactly one, unfolded without flips, as many pairs as there are."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shading_atlas_bench.packers.sas import patches as module
from shading_atlas_bench.packers.sas.kernels.layout import POINTS, corner_points
from shading_atlas_bench.packers.sas.kernels.tables import Patches
from shading_atlas_bench.packers.sas.patches import cached_patches, find_patches
from shading_atlas_bench.scenes.model import Material, Scene
from tests.conftest import REAL_SCENES


def grid_mesh(columns: int, rows: int, rng: np.random.Generator | None = None) -> tuple[np.ndarray, np.ndarray]:
    """A grid of squares, two triangles each; with `rng` bent, in random order, each triangle with its own vertices."""
    x, y = np.meshgrid(np.arange(columns + 1), np.arange(rows + 1))
    positions = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3).astype(np.float32)
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).reshape(-1, 1)
    squares = corner + np.array([0, 1, columns + 1, columns + 2])
    indices = squares[:, [[0, 1, 2], [3, 2, 1]]].reshape(-1, 3).astype(np.int32)
    if rng is not None:
        positions += rng.normal(scale=0.2, size=positions.shape).astype(np.float32)
        indices = indices[rng.permutation(len(indices))]
        indices = np.stack([np.roll(row, k) for row, k in zip(indices, rng.integers(0, 3, len(indices)), strict=True)])
        positions, indices = positions[indices.reshape(-1)], np.arange(indices.size, dtype=np.int32).reshape(-1, 3)
    return positions, indices.astype(np.int32)


def assert_sound(patches: Patches, positions: np.ndarray, indices: np.ndarray) -> None:
    """Members and triangles agree; a point of the square has one position; triangles fill half of it, or all."""
    listed = patches.members[patches.members >= 0]
    np.testing.assert_array_equal(np.sort(listed), np.arange(len(indices)))
    for slot in range(3):
        has = patches.members[:, slot] >= 0
        np.testing.assert_array_equal(patches.of_triangle[patches.members[has, slot]], np.flatnonzero(has))
    point = corner_points(patches.codes)
    vertex = patches.points[patches.of_triangle[:, None], point]
    np.testing.assert_array_equal(positions[vertex], positions[indices])
    u, v = POINTS[point].transpose(2, 0, 1)
    area = ((u[:, 1] - u[:, 0]) * (v[:, 2] - v[:, 0]) - (u[:, 2] - u[:, 0]) * (v[:, 1] - v[:, 0])) / 2
    assert (area > 0).all()
    np.testing.assert_allclose(np.bincount(patches.of_triangle, area), np.where(patches.sizes() == 1, 0.5, 1))


@settings(max_examples=25, deadline=None)
@given(columns=st.integers(1, 12), rows=st.integers(1, 12), seed=st.integers(0, 1000))
def test_patches_of_bent_grids_are_sound(columns, rows, seed):
    positions, indices = grid_mesh(columns, rows, np.random.default_rng(seed))
    assert_sound(find_patches(positions, indices), positions, indices)


def test_a_flat_grid_becomes_its_squares():
    positions, indices = grid_mesh(20, 10)
    patches = find_patches(positions, indices)
    assert (patches.sizes() == 2).all()
    np.testing.assert_array_equal(patches.of_triangle[::2], patches.of_triangle[1::2])


def test_long_runs_of_equal_gains_need_few_rounds():
    """Equilateral triangles in a strip: all edges gain the same; greedy order alone would match one per round."""
    count = 20_000
    k = np.arange(count + 2)
    positions = np.stack([k * 0.5, k % 2 * np.sqrt(0.75), np.zeros(len(k))], axis=1).astype(np.float32)
    indices = np.stack([k[:-2], k[1:-1], k[2:]], axis=1)
    indices[1::2] = indices[1::2, [1, 0, 2]]
    patches = find_patches(positions, indices.astype(np.int32))
    assert_sound(patches, positions, indices)
    assert patches.count < 0.6 * count


def test_three_triangles_of_a_rectangle_join_as_a_fan():
    positions = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]], np.float32)
    indices = np.array([[1, 3, 4], [0, 1, 4], [1, 2, 3]], np.int32)
    patches = find_patches(positions, indices)
    assert_sound(patches, positions, indices)
    np.testing.assert_array_equal(patches.members, [[0, 2, 1]])
    np.testing.assert_array_equal(positions[patches.points[0, 4]], [1, 0, 0])


@pytest.mark.parametrize(("degrees", "count"), [(0, 1), (50, 1), (70, 2), (180, 2)])
def test_a_square_joins_up_to_a_fold_of_60_degrees(degrees, count):
    """Joining halves the area, so the cosine of the fold may fall to a half."""
    fold = np.radians(degrees)
    corner = [0.5 + np.cos(fold) / 2, 0.5 + np.cos(fold) / 2, np.sin(fold) * np.sqrt(0.5)]
    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], corner], np.float32)
    assert find_patches(positions, np.array([[0, 1, 2], [3, 2, 1]], np.int32)).count == count


def test_opposite_windings_are_not_joined():
    positions, indices = grid_mesh(1, 1)
    indices[1] = indices[1, ::-1]
    assert find_patches(positions, indices).count == 2


def test_degenerate_duplicate_and_non_manifold_triangles_stay_sound():
    positions, indices = grid_mesh(3, 3)
    extra = np.array([[0, 0, 0], [0, 1, 1], [0, 1, 2], [5, 5, 6]], np.int32)
    indices = np.concatenate([indices, indices[:4], extra, indices[::-1, ::-1]])
    patches = find_patches(positions, indices)
    assert_sound(patches, positions, indices)


def test_no_triangles_give_no_patches():
    patches = find_patches(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    assert patches.count == 0


def test_patches_are_numbered_by_their_lowest_triangle():
    positions, indices = grid_mesh(6, 6, np.random.default_rng(1))
    members = find_patches(positions, indices).members.astype(np.int64)
    lowest = np.where(members < 0, len(indices), members).min(axis=1)
    assert (np.diff(lowest) > 0).all()


def scene_of(positions: np.ndarray, indices: np.ndarray, content_hash: str) -> Scene:
    count = len(positions)
    normals = np.tile(np.array([0, 0, 1], np.float32), (count, 1))
    attributes = (np.zeros((count, 2), np.float32), np.ones((count, 4), np.float32))
    ids = np.zeros(len(indices), np.int32)
    scene = Scene("grid", positions, indices, normals, *attributes, ids, [Material()])
    scene.content_hash = content_hash
    return scene


def test_patches_are_cached(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    scene = scene_of(*grid_mesh(4, 4, np.random.default_rng(2)), "abc")
    found = vars(cached_patches(scene))  # the arrays alone, so that nothing holds the patches
    monkeypatch.setattr(module, "find_patches", lambda *_: pytest.fail("not read from the cache"))
    again = vars(cached_patches(scene))
    assert found.keys() == again.keys()
    for name, values in found.items():
        assert again[name] is not values
        np.testing.assert_array_equal(values, again[name])


def test_packers_of_one_scene_hold_the_same_patches(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    scene = scene_of(*grid_mesh(4, 4, np.random.default_rng(3)), "abc")
    held = cached_patches(scene)
    assert cached_patches(scene) is held
    other = scene_of(*grid_mesh(5, 4, np.random.default_rng(3)), "def")
    assert cached_patches(other) is not held


@pytest.mark.skipif(not (REAL_SCENES / "living_room").is_dir(), reason="no real scenes here")
def test_a_real_scene_is_mostly_pairs():
    from shading_atlas_bench.scenes.load import load_scene

    scene = load_scene(str(REAL_SCENES / "living_room" / "scene.glb"))
    patches = find_patches(scene.positions, scene.indices)
    assert_sound(patches, scene.positions, scene.indices)
    assert (patches.sizes() >= 2).mean() > 0.9
