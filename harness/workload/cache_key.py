"""What decides over all that is drawn of a scene before a run, and kept: nothing old may come back after an edit."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.kernels.source_digest import source_digest
from shading_atlas_bench.scenes.cache import scene_key

if TYPE_CHECKING:
    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.scenes.model import Scene

ROOT = Path(__file__).parents[2]  # the package's folder
SOURCES = (
    "arithmetic/**/*.py", "kernels/**/*.py", "kernels/**/*.cl", "scenes/**/*.py", "packers/*.py",
    "harness/workload/**/*.py",
)  # fmt: skip


@cache
def drawing_digest() -> str:
    """A hash of all sources that visible sets, shadow and environment maps go through."""
    return source_digest(ROOT, (file for pattern in SOURCES for file in ROOT.glob(pattern)))


def drawn_hash(scene: Scene) -> str:
    """16 hex digits over everything that can change what is drawn of a scene: its content, and whether it is a place,
    its route and its cameras, from which its shadow and environment maps are drawn."""
    digest = hashlib.blake2b(digest_size=8)
    if scene.route is not None:
        digest.update(np.asarray(scene.route, np.float64).tobytes())
    cameras = [asdict(camera) for camera in scene.cameras]
    said = [scene.content_hash, bool(scene.place), scene.route is not None, cameras]
    digest.update(json.dumps(said, default=float).encode())  # float: NumPy's numbers say what Python's do
    return digest.hexdigest()


def device_key(device: Device, scene: Scene) -> str:
    """Of everything that what is drawn of a scene depends on: the scene, the device and the sources."""
    said = {
        "scene": drawn_hash(scene),
        "device": device.found.key,
        "variant": device.variant,
        "sources": drawing_digest(),
    }
    return scene_key(said, [])
