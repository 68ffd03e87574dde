"""Walks that were found before, kept by what they were found from: in a large scene finding one takes seconds."""

from __future__ import annotations

import json

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Doubles
from shading_atlas_bench.kernels.cache import cache_root, read_checked, write_checked
from shading_atlas_bench.scenes.cache import scene_key
from shading_atlas_bench.scenes.model import Scene
from shading_atlas_bench.scenes.paths import CameraPath, Poses, make_path

WALK = "walk"


def cached_path(scene: Scene, name_or_file: str, frames: int | None, seed: int) -> CameraPath:
    """As `make_path`; a walk comes from the cache where it was found before. Scenes without a hash are not cached."""
    if name_or_file != WALK or not scene.content_hash:
        return make_path(scene, name_or_file, frames, seed)
    file = cache_root() / "walks" / _key(scene, frames, seed)
    if (content := read_checked(file)) is not None:
        return _from_bytes(content)
    path = make_path(scene, name_or_file, frames, seed)
    write_checked(file, _to_bytes(path))
    return path


def _key(scene: Scene, frames: int | None, seed: int) -> str:
    """Of everything that a walk depends on, the source of `scenes` and `arithmetic` among it."""
    said = {name: getattr(scene, name) for name in ("content_hash", "metres_per_unit", "place")}
    said |= {"cameras": repr(scene.cameras), "route": None if scene.route is None else scene.route.tobytes().hex()}
    return scene_key(said | {"frames": frames, "seed": seed}, [])


def _to_bytes(path: CameraPath) -> bytes:
    """A line of JSON, then float64 (n, 8): time, position and orientation of each pose, those beyond the end last."""
    tables = [_table(poses) for poses in (path, path.beyond) if poses is not None]
    words = {"name": path.name, "notes": path.notes, "frames": path.frames}
    return json.dumps(words).encode() + b"\n" + np.concatenate(tables).tobytes()


def _table(poses: CameraPath | Poses) -> Doubles:
    return np.column_stack([poses.times_ms, poses.positions, poses.orientations])


def _from_bytes(data: bytes) -> CameraPath:
    line, rows = data.split(b"\n", 1)
    words, table = json.loads(line), np.frombuffer(rows).reshape(-1, 8)
    within, beyond = (
        Poses(t[:, 0].copy(), t[:, 1:4].copy(), t[:, 4:].copy()) for t in np.split(table, [words["frames"]])
    )
    end = beyond if len(beyond.times_ms) else None
    return CameraPath(
        words["name"],
        within.times_ms,
        within.positions,
        within.orientations,
        beyond=end,
        notes=tuple(words["notes"]),
    )
