"""The reference: forward rendering of a view."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from harness.blended import layers_of
from kernels.raster.camera import Camera
from kernels.raster.resolve import resolve
from packers.interface import Image, ServerScene, View

if TYPE_CHECKING:
    from kernels.raster.rasteriser import Visibility


class ForwardRenderer:
    """Draws a scene as seen: visibility, one shading sample per pixel, sky where nothing is drawn.

    Where a scene has blended materials every visible layer of a pixel is shaded and blended in order.
    """

    def __init__(self, scene: ServerScene) -> None:
        self.scene = scene
        self.layers = layers_of(scene)

    def draw(self, view: View, eye: np.ndarray | None = None) -> tuple[Image, Visibility]:
        """The picture of `view` and its visibility.

        eye: float64 (3), from where highlights are computed; the server's eye where pictures are compared with those
        of a packer, else the view's own (None).
        """
        scene = self.scene
        visible = scene.rasteriser.draw(view.view, view.projection, view.width, view.height, stage="reference/raster")
        if self.layers:
            return self._blended(view, view.eye if eye is None else eye, visible), visible
        samples = resolve(scene.device, scene.triangles, visible, view.view, view.projection, stage="reference/resolve")
        rgb = scene.device.empty((view.height, view.width, 4), np.uint8)
        if samples.count < view.width * view.height:
            scene.shader.sky(view.view, view.projection, rgb, stage="reference/sky")
        scene.shader.shade(samples, view.eye if eye is None else eye, rgb, stage="reference/shade")
        return Image(rgb, visible.triangle), visible

    def _blended(self, view: View, eye: np.ndarray, visible: Visibility) -> Image:
        """Every visible layer over the sky."""
        rgb = self.scene.device.empty((view.height, view.width, 4), np.uint8)
        self.scene.shader.sky(view.view, view.projection, rgb, stage="reference/sky")
        camera = Camera.of(view.view, view.projection, view.width, view.height)
        self.layers.draw(camera, self.scene.shader, eye, rgb, stage="reference/layers")
        return Image(rgb, visible.triangle)
