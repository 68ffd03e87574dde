"""What a result must say about where it came from."""

from __future__ import annotations

import os
import platform
from contextlib import suppress
from datetime import datetime
from importlib.metadata import PackageNotFoundError, version

from shading_atlas_bench.harness.measure.machine import commit
from shading_atlas_bench.harness.measure.noise import noise_warnings
from shading_atlas_bench.harness.workload.methods import find_methods
from shading_atlas_bench.harness.workload.session import Session
from shading_atlas_bench.harness.workload.skips import known_skips, skipped_stages
from shading_atlas_bench.reports.store.results import Store

PACKAGES = ("numpy", "pyopencl", "av", "trimesh", "OpenImageIO", "colour-science", "pymeshlab", "lz4")


def write_notes(store: Store, session: Session) -> None:
    """What a result must say about where it came from; warnings; what was skipped and why."""
    notes, scene = store.notes, session.scene.host
    notes.setdefault("environment/date", datetime.now().astimezone().isoformat(timespec="seconds"))
    notes.setdefault("environment/commit", commit())
    notes["environment/machine"] = f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores"
    notes["environment/triangles"] = f"{scene.triangle_count:,}"
    notes["environment/system"] = platform.platform()
    notes["environment/python"] = platform.python_version()
    for name in PACKAGES:
        with suppress(PackageNotFoundError):  # those of an extra need not be there
            notes[f"environment/{name}"] = version(name)
    for number, text in enumerate(session.device.passed_over):
        notes[f"warning/device{number:02d}"] = text
    for key, value in session.device.description.items():
        notes[f"device/{key}"] = value
    for number, text in enumerate([*scene.notes, *session.path.notes]):
        notes[f"scene/{number:02d}"] = text
    for number, text in enumerate(noise_warnings()):
        notes[f"warning/{number:02d}"] = text
    for name, reason in skipped_stages(scene.features, session.settings.no_skip).items():
        notes[f"skipped/{name}"] = reason
    for skip in known_skips(find_methods(session.settings)):
        notes[f"skip/{skip.name}"] = f"{skip.what}: {skip.unneeded}"
