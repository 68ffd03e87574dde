"""Everything a run needs before its first frame: device, scene, path, head motion, and the work of each frame."""

from __future__ import annotations

import hashlib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from shading_atlas_bench.harness.workload.cache_key import drawn_hash
from shading_atlas_bench.harness.workload.frames import FrameSource
from shading_atlas_bench.harness.workload.reference import ForwardRenderer
from shading_atlas_bench.harness.workload.settings import Settings, SettingsError
from shading_atlas_bench.harness.workload.upload import upload_scene
from shading_atlas_bench.harness.workload.walks import cached_path
from shading_atlas_bench.kernels.cache import cache_root
from shading_atlas_bench.kernels.device import Device
from shading_atlas_bench.kernels.journal import journal
from shading_atlas_bench.packers.interface import ServerScene
from shading_atlas_bench.packers.skips import Skips
from shading_atlas_bench.scenes.head_motion import HeadMotion
from shading_atlas_bench.scenes.load import list_scenes, load_scene
from shading_atlas_bench.scenes.model import Scene
from shading_atlas_bench.scenes.opaque import opaque_version
from shading_atlas_bench.scenes.paths import CameraPath

OPENING = (
    3600.0  # seconds after which opening a session counts as hanging; repairing millions of triangles takes minutes
)


@dataclass(frozen=True)
class Session:
    """The settings of a run, and what follows from them."""

    settings: Settings
    device: Device
    scene: ServerScene
    path: CameraPath
    head: HeadMotion
    source: FrameSource
    forward: ForwardRenderer

    def at(self, settings: Settings) -> Session:
        """The same scene and path under settings that differ in neither."""
        return replace(self, settings=settings, source=FrameSource(self.scene, self.path, self.head, settings))

    @property
    def frames(self) -> int:
        """How many frames of the path are run."""
        return len(self.path.times_ms[: self.settings.frames])

    @property
    def frame_rate(self) -> float | None:
        """Frames per second of the path, on average over those that are run; None for one frame."""
        times = self.path.times_ms[: self.frames]
        return round(1000 * (self.frames - 1) / float(times[-1] - times[0]), 6) if self.frames > 1 else None

    @property
    def hashes(self) -> dict[str, str]:
        """As `workload_hashes`."""
        return _hashes(self.scene.host, self.path_hash)

    @property
    def path_hash(self) -> str:
        """A hash of the path's poses and of the head motion at each of them."""
        return hash_of_motion(self.path, self.head, self.settings.latency)


def hash_of_motion(path: CameraPath, head: HeadMotion, latency: float) -> str:
    """A hash of a path's poses and of the head motion at each of them, `latency` ms later."""
    digest = hashlib.sha256(path.hash.encode())
    for shift, turn in [head.offset(float(time), latency) for time in path.times_ms]:
        digest.update(np.concatenate([shift, turn]).tobytes())
    return digest.hexdigest()[:16]


def workload_hashes(settings: Settings) -> dict[str, str]:
    """What files decide over, by its name in plans: hashes of the scene's content (`scene_hash`), of all that is drawn
    of the scene (`drawn_hash`), and of the path and the head motion in it (`path_hash`).

    Raises SceneError, PathError or SettingsError.
    """
    scene = open_scene(settings)
    motion = hash_of_motion(open_path(settings, scene), open_head_motion(settings), settings.latency)
    return _hashes(scene, motion)


def _hashes(scene: Scene, motion: str) -> dict[str, str]:
    return {"scene_hash": scene.content_hash, "drawn_hash": drawn_hash(scene), "path_hash": motion}


def open_scene(settings: Settings) -> Scene:
    """The scene of the settings, from the cache where it is there. Raises SceneError or SettingsError."""
    if settings.unit is not None and settings.scene in list_scenes():
        raise SettingsError(f"--unit is for files: the built-in scene {settings.scene} is in metres.")
    scene = load_scene(
        settings.scene,
        unit=settings.unit,
        detail=settings.detail,
        repair=settings.repair,
        decimate=settings.decimate,
        seed=settings.seed,
        cache=cache_root() / "scenes",
        allow_outside=settings.allow_outside,
        max_texture=settings.max_texture,
    )
    if settings.opaque:
        scene = opaque_version(scene)
    size = float(max(scene.bounds[1] - scene.bounds[0])) * scene.metres_per_unit
    if scene.place or size >= 2 * settings.cell_radius:
        return scene
    note = (
        f"The object is {size:.2g} m large ({scene.unit_from}), and so inside the view cell, which is "
        f"{2 * settings.cell_radius:.2g} m wide: --unit sets another size, --cell another cell."
    )
    return replace(scene, notes=[*scene.notes, note])


def open_path(settings: Settings, scene: Scene) -> CameraPath:
    """The camera path of the settings. Raises PathError; a path shorter than the frames asked for is one."""
    return cached_path(scene, settings.path, settings.frames, settings.seed)


def open_head_motion(settings: Settings) -> HeadMotion:
    """The head motion of the settings. Raises PathError."""
    return HeadMotion.recorded(settings.head_motion) if settings.head_motion else HeadMotion.synthetic(settings.seed)


def open_session(settings: Settings, device: Device | None = None) -> Session:
    """Open the device (unless one is given), load and upload the scene, and make the path."""
    with journal().step(f"opening {settings.scene}", OPENING):
        return _opened(settings, device)


def _opened(settings: Settings, device: Device | None) -> Session:
    with ThreadPoolExecutor(1) as beside:
        opening = beside.submit(lambda: device or Device.open(settings.device))
        scene = open_scene(settings)
        path = open_path(settings, scene)
        head = open_head_motion(settings)
        device = opening.result()
        server = upload_scene(device, scene, Skips(settings.no_skip))
    # A forced view is to take its time, which it would not with a cached set.
    source = FrameSource(server, path, head, settings, cached=not settings.no_skip)
    return Session(settings, device, server, path, head, source, ForwardRenderer(server))
