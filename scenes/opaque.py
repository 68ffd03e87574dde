"""The opaque version of a scene: what its transparency costs is the difference to it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from shading_atlas_bench.scenes.features import content_digest, find_features
from shading_atlas_bench.scenes.model import Scene


def opaque_version(scene: Scene) -> Scene:
    """The scene with blended and transmissive materials made opaque; masked ones keep their holes.

    A scene without any is returned as it is.
    """
    if not scene.features.blend:
        return scene
    see_through = [m.alpha_mode == "blend" or m.transmission > 0 for m in scene.materials]
    materials = [
        replace(m, alpha_mode="opaque" if m.alpha_mode == "blend" else m.alpha_mode, transmission=0.0)
        for m in scene.materials
    ]
    count = int(np.count_nonzero(np.array(see_through)[scene.material_ids]))
    note = f"Triangles of blended and transmissive materials, made opaque (--opaque): {count:,}."
    changed = replace(scene, materials=materials, notes=[*scene.notes, note])
    changed.features, changed.content_hash = find_features(changed), content_digest(changed)
    return changed
