"""A render node's part: the frame's lists, and what of them the display does not hold yet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from shading_atlas_bench.kernels.fragments.blend import blend_lists
from shading_atlas_bench.kernels.fragments.build import Builder, Fragments
from shading_atlas_bench.kernels.fragments.layers import shade_fragments
from shading_atlas_bench.kernels.raster.camera import Camera
from shading_atlas_bench.packers.cell_views import owned_pixels, owned_spans
from shading_atlas_bench.packers.interface import ServerScene, View
from shading_atlas_bench.packers.ppll.kernels.limit import Depth, limit_fragments
from shading_atlas_bench.packers.ppll.kernels.lists import Lists
from shading_atlas_bench.packers.ppll.kernels.rows import COLOUR_WORDS, NORMAL_WORDS, colour_rows, normal_rows

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic.arrays import Bytes, Longs
    from shading_atlas_bench.kernels.device import Device


@dataclass(frozen=True)
class NodeLists:
    """One node's lists of a view. built: fragments before limiting; pixels_by_layers: int (n), pixels that have 0, 1,
    2 ... of them; both of the rays that belong to the view."""

    lists: Lists
    built: int
    pixels_by_layers: Longs


class ListRenderer:
    """Builds, limits and shades the lists of a scene's frames, node by node."""

    def __init__(self, scene: ServerScene, nodes: int, depth: Depth, preblend: bool) -> None:
        self.scene, self.device = scene, scene.device
        self.nodes, self.depth, self.preblend = nodes, depth, preblend
        host = scene.host
        self.builder = Builder(scene.rasteriser)
        self.of_triangle = self.device.upload(deal_objects(host.material_ids, nodes))
        self.opacity = scene.layers.opacity if scene.layers else None

    def render(self, views: Sequence[View], pvs: Array, count: int, normals: bool) -> list[list[NodeLists]]:
        """The lists of the triangles in `pvs`, int32 (count): for each view, of the rays that belong to it, and each
        node."""
        members = self.builder.members(pvs, count, self.of_triangle, "structs/members")
        lists = []
        for number, view in enumerate(views):
            camera = Camera.of(view.view, view.projection, view.width, view.height)
            bins, picture = self.builder.bins(camera, "structs/build")
            nodes = (
                self.builder.build(bins, picture, members, node, "structs/build") for node in range(1, self.nodes + 1)
            )
            lists.append([self._shaded(fragments, views, number, normals) for fragments in nodes])
        return lists

    def _shaded(self, fragments: Fragments, views: Sequence[View], number: int, normals: bool) -> NodeLists:
        device, view, offsets = self.device, views[number], fragments.offsets.get()
        opacity = self.opacity.of(fragments.samples, "structs/opacity") if self.opacity else None
        if opacity is not None or self.depth.limits or len(views) > 1:
            spans = owned_spans(views, number)
            fragments, opacity = limit_fragments(device, fragments, opacity, self.depth, spans, "structs/limit")
        n = fragments.count
        colours = shade_fragments(self.scene.shader, fragments, view.eye, "gather/shade")
        layers = np.diff(offsets)  # counted on the host while the device shades
        if len(views) > 1:
            layers = layers[owned_pixels(views, number).ravel()]
        if normals:
            triangles, vertices = self.scene.triangles, self.scene.shader.arguments[0]
            surface = (triangles, vertices, view.projection)
            rows, words = normal_rows(device, fragments, colours, opacity, *surface, "gather/rows"), NORMAL_WORDS
        else:
            rows, words = colour_rows(device, fragments, colours, opacity, "gather/rows"), COLOUR_WORDS
        lists = Lists(fragments.width, fragments.height, n, words, fragments.offsets, rows)
        if self.preblend:
            lists = blended_into_one(device, lists)
        return NodeLists(lists, int(layers.sum(dtype=np.int64)), np.bincount(layers))


def blended_into_one(device: Device, lists: Lists) -> Lists:
    """Every pixel's fragments as one, at the nearest one's depth (the thesis' `preBlend`, algorithm A.2): colours and
    opacity are right for the node alone, and wrong as soon as another node has something in between (figure 3.1)."""
    offsets, rows = lists.host()
    blank = device.zeros((1, lists.pixels, 4), np.uint8)
    picture = device.empty((1, lists.pixels, 4), np.uint8)
    blend_lists(device, lists.pixels, lists.offsets, lists.rows, lists.words, blank, picture, "structs/preblend")
    used = np.diff(offsets) > 0
    rgba = picture.get()[0][used].astype(np.float64)
    rgba[:, :3] = np.minimum(rgba[:, :3] * 255 / np.maximum(rgba[:, 3:], 1), 255)  # blending multiplied by opacity
    merged = rows[offsets[:-1][used]].copy()
    merged[:, 0] = np.round(rgba).astype(np.uint8).view("<u4")[:, 0]
    return Lists.upload(device, lists.width, lists.height, np.concatenate([[0], np.cumsum(used)]), merged)


def deal_objects(material_ids: NDArray[np.integer[Any]], nodes: int) -> Bytes:
    """uint8 (T): the node of each triangle, for material_ids int (T).

    An object is a run of triangles of one material in file order; objects are dealt in turn.
    """
    starts = np.diff(material_ids, prepend=material_ids[:1]) != 0
    return (np.cumsum(starts) % nodes).astype(np.uint8)
