"""What is seen through blended surfaces: all visible fragments of a view, shaded and composited."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from kernels.ppll.blend import blend_lists
from kernels.ppll.build import Builder, Fragments
from kernels.ppll.limit import EVERY_LAYER, limit_fragments
from kernels.ppll.rows import COLOUR_WORDS, colour_rows, number_fragments
from kernels.raster.camera import Camera

if TYPE_CHECKING:
    from pyopencl.array import Array

    from kernels.ppll.opacity import Opacity
    from kernels.raster.rasteriser import Rasteriser
    from kernels.shade.shader import Shader


def shade_fragments(shader: Shader, fragments: Fragments, eye: np.ndarray, stage: str) -> Array:
    """The colour of every fragment, uint8 (1, n, 4), sRGB with alpha 255; eye: float64 (3), see Shader.shade."""
    device, n = shader.device, fragments.count
    colours = device.recycled((1, n, 4), np.uint8)
    texel = number_fragments(device, n, len(fragments.samples.texel), stage)
    if n:
        shader.shade(replace(fragments.samples, texel=texel), eye, colours, stage)
    return colours


class Layers:
    """All fragments of a view that are not wholly hidden."""

    def __init__(self, rasteriser: Rasteriser, opacity: Opacity) -> None:
        self.builder, self.opacity, self.device = Builder(rasteriser), opacity, rasteriser.device

    def visible(self, camera: Camera, stage: str) -> tuple[Fragments, Array]:
        """The fragments of every pixel down to the first that hides what is behind, and their opacity."""
        bins, picture = self.builder.bins(camera, stage)
        fragments = self.builder.build(bins, picture, self.builder.all_members(), 1, stage)
        opacity = self.opacity.of(fragments.samples, f"{stage}/opacity")
        return limit_fragments(self.device, fragments, opacity, EVERY_LAYER, 1.0, f"{stage}/limit")

    def draw(self, camera: Camera, shader: Shader, eye: np.ndarray, picture: Array, stage: str) -> None:
        """Composite them over `picture`, uint8 (h, w, 4), with the over operator."""
        fragments, opacity = self.visible(camera, stage)
        colours = shade_fragments(shader, fragments, eye, f"{stage}/shade")
        rows = colour_rows(self.device, fragments, colours, opacity, f"{stage}/rows")
        lists = (fragments.pixels, fragments.offsets, rows, COLOUR_WORDS)
        blend_lists(self.device, *lists, picture, picture, f"{stage}/blend")

    def mark(self, camera: Camera, flags: Array, stage: str) -> None:
        """Set `flags`, uint8 (T), to 1 for every triangle seen; others stay as they are."""
        fragments, _ = self.visible(camera, stage)
        self.builder.mark(fragments, flags, f"{stage}/mark")
