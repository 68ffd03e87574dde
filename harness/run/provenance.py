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
    """What a result must say about where it came from; warnings; what was skipped and why. A run that goes on keeps its
    first date and commit."""
    begun = {
        "environment/date": datetime.now().astimezone().isoformat(timespec="seconds"),
        "environment/commit": commit(),
    }
    new = {key: value for key, value in begun.items() if key not in store.notes}
    store.notes.write(new | _environment(session) | _warnings(session) | _skipped(session))


def _environment(session: Session) -> dict[str, str]:
    """Machine, software, device and scene."""
    scene = session.scene.host
    notes = {
        "environment/machine": f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores",
        "environment/triangles": f"{scene.triangle_count:,}",
        "environment/system": platform.platform(),
        "environment/python": platform.python_version(),
    }
    for name in PACKAGES:
        with suppress(PackageNotFoundError):  # those of an extra need not be there
            notes[f"environment/{name}"] = version(name)
    notes |= {f"device/{key}": value for key, value in session.device.description.items()}
    return notes | {f"scene/{n:02d}": text for n, text in enumerate([*scene.notes, *session.path.notes])}


def _warnings(session: Session) -> dict[str, str]:
    passed_over = {f"warning/device{number:02d}": text for number, text in enumerate(session.device.passed_over)}
    return passed_over | {f"warning/{number:02d}": text for number, text in enumerate(noise_warnings())}


def _skipped(session: Session) -> dict[str, str]:
    stages = skipped_stages(session.scene.host.features, session.settings.no_skip)
    known = known_skips(find_methods(session.settings))
    notes = {f"skipped/{name}": reason for name, reason in stages.items()}
    return notes | {f"skip/{skip.name}": f"{skip.what}: {skip.unneeded}" for skip in known}
