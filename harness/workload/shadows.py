"""Shadow maps that were drawn before, kept by what they were drawn from: in a large scene that takes a second."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.harness.workload.cache_key import device_key
from shading_atlas_bench.kernels.cache import cache_root, read_checked, write_checked
from shading_atlas_bench.kernels.shade.shadow import ROW_FLOATS, ShadowMaps

if TYPE_CHECKING:
    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.scenes.model import Scene


def cached_shadow_maps(device: Device, scene: Scene, draw: Callable[[], ShadowMaps]) -> ShadowMaps:
    """What `draw` gives for a scene, from the cache where it was drawn before; without a hash it is not cached."""
    if not scene.content_hash:
        return draw()
    file, count = cache_root() / "shadows" / device_key(device, scene), len(scene.lights) * ROW_FLOATS
    if (content := read_checked(file)) is not None:
        floats = np.frombuffer(content, np.float32)
        return ShadowMaps(device.upload(floats[count:]), floats[:count].reshape(-1, ROW_FLOATS))
    drawn = draw()
    write_checked(file, drawn.rows.tobytes() + device.download(drawn.maps))
    return drawn
