"""Scenes with blended materials: what is seen through them. Opaque scenes have none of this."""

from __future__ import annotations

from typing import TYPE_CHECKING

from kernels.ppll.layers import Layers
from kernels.ppll.opacity import Opacity

if TYPE_CHECKING:
    from packers.interface import ServerScene


def layers_of(scene: ServerScene) -> Layers | None:
    """The layers of a scene with blended or transmissive materials; None for an opaque one."""
    if not scene.host.features.blend:
        return None
    return Layers(scene.rasteriser, Opacity.of_scene(scene.triangles, scene.shader, scene.host))
