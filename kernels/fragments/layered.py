"""Drawing scenes that are partly see-through: a picture of the opaque triangles, and lists of the others before it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic import arrays
from shading_atlas_bench.arithmetic.arrays import Doubles
from shading_atlas_bench.kernels.fragments.build import Builder, Fragments, OpaqueLayer
from shading_atlas_bench.kernels.raster.camera import Camera
from shading_atlas_bench.kernels.raster.rasteriser import Rasteriser, Visibility
from shading_atlas_bench.kernels.triangles import Triangles

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.kernels.texture.mask import AlphaMask


class LayeredRasteriser:
    """Draws triangles of which some have Triangles.BLENDED.

    Opaque ones are drawn as by a Rasteriser of their own. The others become fragments, in the pixels where they lie in
    front of what is drawn; of equal depths the lower triangle is in front, as everywhere. All keep their numbers.
    """

    def __init__(self, device: Device, triangles: Triangles, mask: AlphaMask | None = None, cull: bool = True) -> None:
        """cull: as of Rasteriser."""
        self.device, self.cull = device, cull
        blended = (triangles.host_flags & Triangles.BLENDED) > 0
        self.opaque, self._opaque_numbers = self._part(triangles, mask, np.flatnonzero(~blended))
        part, self._blended_numbers = self._part(triangles, mask, np.flatnonzero(blended))
        self._builder = Builder(part)
        self._members = device.upload(np.ones(part.triangles.count, np.uint8))

    def _part(self, triangles: Triangles, mask: AlphaMask | None, chosen: arrays.Array) -> tuple[Rasteriser, Array]:
        """A rasteriser of some triangles, and what they are called among all."""
        indices, flags = triangles.host_indices[chosen], triangles.host_flags[chosen]
        part = replace(
            triangles,
            count=len(chosen),
            indices=self.device.upload(indices),
            flags=self.device.upload(flags),
            host_indices=indices,
            host_flags=flags,
        )
        mask = mask.of_triangles(self.device, chosen) if mask else None
        return Rasteriser(self.device, part, mask, cull=self.cull), self.device.upload(chosen.astype(np.int32))

    def draw(
        self, view: Doubles, projection: Doubles, width: int, height: int, stage: str
    ) -> tuple[Visibility, Fragments]:
        """The opaque triangles, and the fragments in front of them; arguments as for Rasteriser.draw."""
        visible = self.opaque.draw(view, projection, width, height, f"{stage}/raster")
        self._renumber(self._opaque_numbers, visible.triangle, width * height, f"{stage}/layers")
        front = OpaqueLayer(visible, self._blended_numbers)
        bins, picture = self._builder.bins(Camera.of(view, projection, width, height), f"{stage}/layers")
        fragments = self._builder.build(bins, picture, self._members, 1, f"{stage}/layers", front)
        self._renumber(self._blended_numbers, fragments.samples.triangle, fragments.count, f"{stage}/layers")
        return visible, fragments

    def _renumber(self, numbers: Array, ids: Array, count: int, stage: str) -> None:
        kernel = self.device.build("fragments/layers.cl").renumber
        self.device.launch(stage, kernel, count, count, numbers, ids)


def numbered(device: Device, fragments: Fragments, stage: str) -> Fragments:
    """The same fragments; their samples' texels are 0, 1, 2 ... as in a picture of one row with all of them."""
    texel = device.recycled(len(fragments.samples.texel), np.int32)
    kernel = device.build("fragments/layers.cl").count_up
    device.launch(stage, kernel, fragments.count, fragments.count, texel)
    return replace(fragments, samples=replace(fragments.samples, texel=texel))
