"""What decides over all that is drawn of a scene before a run, and kept: nothing old may come back after an edit."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

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


def device_key(device: Device, scene: Scene, told: dict[str, str]) -> str:
    """Of everything that what is drawn of a scene depends on: what is told of it, its content, the device and the
    sources."""
    said: dict[str, object] = {
        "content_hash": scene.content_hash,
        "device": device.found.key,
        "variant": device.variant,
        "sources": drawing_digest(),
    }
    return scene_key(said | told, [])
