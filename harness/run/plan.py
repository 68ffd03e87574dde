"""The plan of a run: what binds its results together, and how long it should take."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from shading_atlas_bench.harness.measure.pipeline import Pipeline
from shading_atlas_bench.harness.run.digest import method_digest, suite_digest
from shading_atlas_bench.harness.workload.session import (
    Session,
)
from shading_atlas_bench.harness.workload.settings import Settings
from shading_atlas_bench.kernels.cache import VERSION, cache_root, read_checked, write_checked

# Settings that change no result, so a run may be resumed with others.
WITHOUT_EFFECT = ("timeout", "memory", "dump", "methods", "allow_outside")
# Host seconds of one frame before anything was measured here: per million pixels, texels and PVS pixels, and fixed.
FIRST_GUESS = {"pixels": 0.9, "texels": 0.25, "pvs_pixels": 0.012, "fixed": 0.3}


def make_plan(session: Session, pipelines: list[Pipeline]) -> dict[str, Any]:
    """Everything that results of one folder must have in common, as JSON values."""
    settings = {key: value for key, value in session.settings.to_json().items() if key not in WITHOUT_EFFECT}
    return {
        "settings": settings,
        "methods": {
            f"{pipeline.method}[{pipeline.variant}]": method_digest(type(pipeline.packer.own)) for pipeline in pipelines
        },
        **session.hashes,
        "device": session.device.name,
        "suite": suite_digest(),
        "version": VERSION,
    }


def duration(seconds: float) -> str:
    """Seconds in words: in steps of 5 s, from 90 s on in minutes, from 90 minutes on in hours."""
    if seconds < 90:
        return f"{max(5, round(seconds / 5) * 5)} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def _pace_file(settings: Settings, scene_hash: str) -> Path:
    same = (
        "width",
        "height",
        "atlas_width",
        "atlas_height",
        "samples_per_pixel",
        "cell_radius",
        "cell_fov",
        "codec",
        "pvs_density",
        "repeat",
    )
    values = [getattr(settings, name) for name in same]
    key = hashlib.sha256(json.dumps([scene_hash, settings.crfs, values]).encode()).hexdigest()[:24]
    return cache_root() / "pace" / key


def remember_pace(session: Session, seconds_per_frame: float, methods: int) -> None:
    """Keep how long a frame of one method took, for the next plan."""
    pace = seconds_per_frame / max(1, methods)
    file = _pace_file(session.settings, session.scene.host.content_hash)
    write_checked(file, json.dumps(pace).encode())


def expected_pace(settings: Settings, scene_hash: str) -> float:
    """Seconds per frame and method: as measured by the last such run here, else a guess from the sizes."""
    content = read_checked(_pace_file(settings, scene_hash))
    if content is not None:
        return float(json.loads(content))
    pixels = settings.width * settings.height / 1e6
    texels = settings.atlas_width * settings.atlas_height / 1e6
    wider = settings.cell_fov / settings.fov * settings.pvs_density
    views = 9 * pixels * wider * wider
    guess = FIRST_GUESS
    return guess["fixed"] + guess["pixels"] * pixels + guess["texels"] * texels + guess["pvs_pixels"] * views
