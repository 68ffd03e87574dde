"""The reference: forward rendering of a view."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Doubles
from shading_atlas_bench.kernels.raster.resolve import resolve
from shading_atlas_bench.packers.interface import Image, ServerScene, View

if TYPE_CHECKING:
    from shading_atlas_bench.kernels.fragments.build import Fragments
    from shading_atlas_bench.kernels.raster.rasteriser import Visibility


class ForwardRenderer:
    """Draws a scene as seen: visibility, one shading sample per pixel, sky where nothing is drawn.

    Where a scene has blended materials, every layer of theirs is shaded and blended over it, in exact order.
    """

    def __init__(self, scene: ServerScene) -> None:
        self.scene = scene

    def draw(self, view: View, eye: Doubles | None = None) -> tuple[Image, Visibility]:
        """The picture of `view`, and its visibility: the nearest triangle of each pixel that is not wholly transparent
        there. Depth is that of opaque triangles only.

        eye: float64 (3), from where highlights are computed; the server's eye where pictures are compared with those
        of a packer, else the view's own (None).
        """
        scene, eye = self.scene, view.eye if eye is None else eye
        visible, fragments = self._surfaces(view)
        samples = resolve(scene.device, scene.triangles, visible, view.view, view.projection, stage="reference/resolve")
        rgb = scene.device.empty((view.height, view.width, 4), np.uint8)
        if samples.count < view.width * view.height:
            scene.shader.sky(view.view, view.projection, rgb, stage="reference/sky")
        scene.shader.shade(samples, eye, rgb, stage="reference/shade")
        if scene.layers and fragments:
            scene.layers.blend(fragments, visible, scene.shader, eye, rgb, "reference/layers")
        return Image(rgb, visible.triangle), visible

    def _surfaces(self, view: View) -> tuple[Visibility, Fragments | None]:
        """The opaque triangles seen, and the fragments of others in front of them."""
        scene = self.scene
        if scene.layers:
            return scene.layers.rasteriser.draw(view.view, view.projection, view.width, view.height, stage="reference")
        visible = scene.rasteriser.draw(view.view, view.projection, view.width, view.height, stage="reference/raster")
        return visible, None
