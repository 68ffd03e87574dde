"""What is seen through blended surfaces: their fragments shaded and composited, and which triangles contribute."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic import arrays
from shading_atlas_bench.arithmetic.arrays import Bytes, Doubles
from shading_atlas_bench.kernels.fragments.blend import blend_layers
from shading_atlas_bench.kernels.fragments.layered import LayeredRasteriser
from shading_atlas_bench.kernels.fragments.order import order_fragments

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.fragments.build import Fragments
    from shading_atlas_bench.kernels.fragments.opacity import Opacity
    from shading_atlas_bench.kernels.raster.rasteriser import Visibility
    from shading_atlas_bench.kernels.shade.shader import Shader
    from shading_atlas_bench.kernels.texture.buffers import TextureBuffers


def shade_fragments(shader: Shader, fragments: Fragments, eye: Doubles, stage: str) -> Array:
    """The colour of every fragment, uint8 (1, n, 4), sRGB with alpha 255; eye: float64 (3), see Shader.shade.

    They are shaded in another order than that of the lists, because it is faster: see order_fragments.
    """
    device, n = shader.device, fragments.count
    colours = device.recycled((1, n, 4), np.uint8)
    if n:
        shader.shade(order_fragments(device, fragments, f"{stage}/order"), eye, colours, stage)
    return colours


class Layers:
    """A scene with blended triangles: how they are drawn, and how much of what is behind they cover."""

    def __init__(self, rasteriser: LayeredRasteriser, opacity: Opacity) -> None:
        self.rasteriser, self.opacity, self.device = rasteriser, opacity, rasteriser.device

    def textured(self, textures: TextureBuffers) -> Layers:
        """The same, with opacities from other textures."""
        return Layers(self.rasteriser, replace(self.opacity, textures=textures))

    def blend(
        self, fragments: Fragments, visible: Visibility, shader: Shader, eye: Doubles, picture: Array, stage: str
    ) -> None:
        """Shade the fragments and blend them over `picture`, uint8 (h, w, 4), which shows the opaque triangles.

        `visible.triangle` becomes the nearest triangle that is not wholly transparent there. eye: float64 (3), see
        Shader.shade.
        """
        if not fragments.count:
            return
        opacity = self.opacity.of(fragments.samples, f"{stage}/opacity")
        colours = shade_fragments(shader, fragments, eye, f"{stage}/shade")
        seen = (fragments.samples.triangle, picture, visible.triangle)
        blend_layers(self.device, fragments, colours, opacity, *seen, f"{stage}/blend")

    def mark(self, view: Doubles, projection: Doubles, width: int, height: int, flags: Array, stage: str) -> None:
        """Set `flags`, uint8 (T), to 1 for every triangle that makes up 1/255 or more of a pixel; others stay.

        view, projection: float64 (4, 4), and sizes in pixels, as for Rasteriser.draw.
        """
        visible, fragments = self.rasteriser.draw(view, projection, width, height, stage)
        opacity = self.opacity.of(fragments.samples, f"{stage}/opacity")
        lists = (fragments.pixels, fragments.offsets, fragments.samples.triangle, opacity, visible.triangle, flags)
        kernel = self.device.build("fragments/layers.cl").mark_layers
        self.device.launch(f"{stage}/mark", kernel, fragments.pixels, *lists)


def mark_layers_twin(
    offsets: arrays.Array, triangle: arrays.Array, opacity: arrays.Array, opaque: arrays.Array, flags: Bytes
) -> Bytes:
    """The flags, uint8 (T), after marking what contributes 1/255 or more.

    offsets: int (P + 1), into triangle, int (n), and opacity, int (n), 0..255, nearest first. opaque: int (P), what is
    behind them, -1 for nothing.
    """
    marked = flags.copy()
    for pixel, (first, end) in enumerate(itertools.pairwise(offsets)):
        through = 1.0
        for at in range(first, end):
            if through * opacity[at] >= 1 - 1e-9:
                marked[triangle[at]] = 1
            through *= 1 - opacity[at] / 255
        if through * 255 >= 1 - 1e-9 and opaque[pixel] >= 0:
            marked[opaque[pixel]] = 1
    return marked
