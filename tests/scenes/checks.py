"""What every procedural scene must be: whole, finite, deterministic, with fronts where a viewer is."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Bytes
from shading_atlas_bench.scenes import load
from shading_atlas_bench.scenes.images import read_texture
from shading_atlas_bench.scenes.inputs import InputFiles
from shading_atlas_bench.scenes.model import Scene
from shading_atlas_bench.scenes.raw import RawScene


def assert_sound(scene: Scene) -> None:
    """Arrays fit together, are finite, and no triangle is without area."""
    vertices = len(scene.positions)
    assert scene.tangents is not None
    for array, shape, dtype in (
        (scene.positions, (vertices, 3), np.float32),
        (scene.normals, (vertices, 3), np.float32),
        (scene.uvs, (vertices, 2), np.float32),
        (scene.colours, (vertices, 4), np.float32),
        (scene.tangents, (vertices, 4), np.float32),
        (scene.indices, (scene.triangle_count, 3), np.int32),
        (scene.material_ids, (scene.triangle_count,), np.int32),
    ):
        assert array.shape == shape
        assert array.dtype == dtype
        assert np.isfinite(array).all()
    assert scene.indices.min() == 0
    assert scene.indices.max() == vertices - 1
    assert 0 <= scene.material_ids.min() <= scene.material_ids.max() < len(scene.materials)
    assert np.allclose(np.linalg.norm(scene.normals, axis=1), 1, atol=1e-3)
    assert np.allclose(np.linalg.norm(scene.tangents[:, :3], axis=1), 1, atol=1e-3)
    assert np.all(np.abs(scene.tangents[:, 3]) == 1)
    a, b, c = (scene.positions[scene.indices[:, k]].astype(np.float64) for k in range(3))
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).min() > 1e-9
    for texture in scene.textures:
        assert texture.texels.dtype == np.uint8
        assert 256 <= min(texture.texels.shape[:2]) <= max(texture.texels.shape[:2]) <= 1024
        assert texture.texels.shape[2] == 4
    assert scene.cameras
    assert scene.lights
    assert scene.content_hash


def inputs_of(path: Path) -> dict[str, str | None]:
    """The names that loading a scene file asks for, and the files found, from its folder; None where there is none."""
    files = InputFiles(path)
    load._load_file(path, files, RawScene(), None, False, None)
    return {name: found if content else None for _, name, _, found, content in files.asked}


def read_image(source: Path | bytes) -> Bytes:
    """The texels of an image file or its bytes, uint8 (H, W, 4)."""
    return read_texture(source, "an image", True, RawScene())


def area(scene: Scene) -> float:
    """The sum of all triangles' areas, in scene units."""
    corners = scene.positions[scene.indices].astype(np.float64)
    return np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2


def nearest(scene: Scene, origin: np.ndarray, direction: np.ndarray) -> tuple[float, int]:
    """Distance to the first triangle along a unit direction and its index; infinity and -1 where there is none."""
    a, b, c = (scene.positions[scene.indices[:, k]].astype(np.float64) for k in range(3))
    e1, e2 = b - a, c - a
    p = np.cross(direction, e2)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1 / np.einsum("ij,ij->i", e1, p)
        s = origin - a
        u = np.einsum("ij,ij->i", s, p) * inverse
        q = np.cross(s, e1)
        v = (q @ direction) * inverse
        t = np.einsum("ij,ij->i", e2, q) * inverse
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 1e-6)
    if not hit.any():
        return np.inf, -1
    index = int(np.flatnonzero(hit)[np.argmin(t[hit])])
    return float(t[index]), index


def inward_share(scene: Scene, eye: np.ndarray, count: int = 40) -> float:
    """Share of directions from `eye` in which the nearest triangle shows its front."""
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    fronts = 0
    for direction in directions:
        _, index = nearest(scene, eye, direction)
        if index >= 0:
            a, b, c = scene.positions[scene.indices[index]].astype(np.float64)
            fronts += np.cross(b - a, c - a) @ direction < 0
    return fronts / count


def point_distance(scene: Scene, point: np.ndarray, within: float) -> float:
    """Distance from a point to the nearest triangle, or `within` where none is nearer."""
    low, high = point - within, point + within
    corners = scene.positions[scene.indices]
    near = ((corners.min(axis=1) <= high) & (corners.max(axis=1) >= low)).all(axis=1)
    a, b, c = corners[near].astype(np.float64).transpose(1, 0, 2)
    best = within
    for p, q in ((a, b), (b, c), (c, a)):
        edge = q - p
        t = np.clip(np.einsum("ij,ij->i", point - p, edge) / np.einsum("ij,ij->i", edge, edge), 0, 1)
        best = min(best, np.linalg.norm(p + edge * t[:, None] - point, axis=1).min(initial=best))
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    off = np.einsum("ij,ij->i", point - a, normal)
    foot = point - normal * off[:, None]
    inside = np.ones(len(a), bool)
    for p, q in ((a, b), (b, c), (c, a)):
        inside &= np.einsum("ij,ij->i", np.cross(q - p, foot - p), normal) >= 0
    return float(min(best, np.abs(off[inside]).min(initial=best)))
