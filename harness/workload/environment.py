"""The environment map of a scene, kept by what it was drawn from."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Doubles, Floats
from shading_atlas_bench.harness.workload.cache_key import device_key
from shading_atlas_bench.kernels.cache import cache_root, read_checked, write_checked
from shading_atlas_bench.kernels.shade.environment import SHAPE
from shading_atlas_bench.scenes.walking import EYE_HEIGHT

if TYPE_CHECKING:
    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.scenes.model import Scene


def standpoint(scene: Scene) -> Doubles | None:
    """Float64 (3): from where a place is seen that its surfaces reflect: the middle of its route, else its first camera
    that stands inside. None for an object: from wherever it is seen, it hides another part of what is around it."""
    if not scene.place:
        return None
    if scene.route is not None:
        middle: Doubles = scene.route[len(scene.route) // 2]
        return middle + np.array([0, EYE_HEIGHT / scene.metres_per_unit, 0], np.float64)
    low, high = scene.bounds
    eyes = (np.array(camera.position, np.float64) for camera in scene.cameras)
    return next((eye for eye in eyes if ((low < eye) & (eye < high)).all()), None)


def cached_environment_map(device: Device, scene: Scene, draw: Callable[[], Floats]) -> Floats:
    """What `draw` gives for a scene, a map as from `environment_map`, from the cache where it was drawn before; without
    a hash it is not cached."""
    if not scene.content_hash:
        return draw()
    file = cache_root() / "environments" / device_key(device, scene)
    if (content := read_checked(file)) is not None:
        return np.frombuffer(content, np.float32).reshape(SHAPE)
    drawn = draw()
    write_checked(file, drawn.tobytes())
    return drawn
