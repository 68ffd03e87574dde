"""The potentially visible set of a view cell: every triangle that some view from inside the cell shows.

Through blended surfaces others are seen: there a triangle is shown that makes up 1/255 or more of a pixel, its opacity
times the light let through by what lies in front of it.

A view finds a triangle where a sample lies on it, so that triangles smaller than a pixel are found by chance. Where
the centre's views show many triangles, one eye sees with more samples, which lie more evenly than those of many eyes.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import chain, product
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Ints
from shading_atlas_bench.arithmetic.matrices import matvec
from shading_atlas_bench.harness.workload.cache_key import drawing_digest
from shading_atlas_bench.harness.workload.views import CellFrustum, Pose, rotation
from shading_atlas_bench.kernels.cache import cache_root, read_checked, write_checked
from shading_atlas_bench.kernels.raster.mark import mark_visible
from shading_atlas_bench.packers.interface import ServerScene, View

if TYPE_CHECKING:
    from pyopencl.array import Array

_HEAD = struct.Struct("<IId")  # of a cached set: views, planned, milliseconds
LARGEST_VIEW = 8192  # pixels per side; a denser view is drawn at the density that fits
# Triangles that the centre's views show, per pixel, from which on one eye's views are denser. Without that, 0.1 to 0.2
# times as many pixels of a new view show a triangle that none of the 9 eyes saw.
POOR = 1 / 32
DENSER = 3  # times, along each axis: 1.1 to 1.3 times the time of 9 equal eyes, 0.3 to 0.5 times what they miss


@dataclass(frozen=True)
class PotentiallyVisibleSet:
    """ids: int32 (n), ascending. views: how many were drawn, of how many planned.

    milliseconds: device time of drawing them, on this device, perhaps by an earlier run.
    """

    ids: Ints
    views: int
    planned: int
    milliseconds: float

    def to_bytes(self) -> bytes:
        """For the cache."""
        return _HEAD.pack(self.views, self.planned, self.milliseconds) + self.ids.tobytes()

    @classmethod
    def from_bytes(cls, data: bytes) -> PotentiallyVisibleSet:
        """The inverse."""
        views, planned, milliseconds = _HEAD.unpack_from(data)
        return cls(np.frombuffer(data, np.int32, offset=_HEAD.size).copy(), views, planned, milliseconds)


def cell_eyes(pose: Pose, radius: float) -> Iterator[Pose]:
    """View samples of a cell: its centre, then the 8 corners of the cube inscribed in its ball of `radius`."""
    yield pose
    if radius > 0:
        turn = rotation(pose.orientation)
        for corner in product((-1, 1), repeat=3):
            yield replace(pose, position=pose.position + matvec(turn, corner) * radius / np.sqrt(3))


def potentially_visible(
    scene: ServerScene,
    pose: Pose,
    radius: float,
    frustum: CellFrustum,
    near: float,
    density: float,
    cached: bool = True,
) -> PotentiallyVisibleSet:
    """The set of the cell at `pose`: `radius` in scene units, views at `density` times the client's pixel density.

    Where the centre shows more than POOR triangles per pixel, one corner has DENSER times that density, or in a cell of
    one point the centre, drawn again.
    Cached on disk by everything that it and its time depend on; drawn all the same if not `cached`.
    """
    key = hashlib.sha256(
        repr(
            (
                scene.host.content_hash,
                scene.device.found.key,
                pose.position.tobytes(),
                pose.orientation.tobytes(),
                radius,
                frustum,
                near,
                density,
            )
        ).encode()
    )
    key.update(drawing_digest().encode())
    file = cache_root() / "pvs" / key.hexdigest()[:32]
    if cached and (content := read_checked(file)) is not None:
        return PotentiallyVisibleSet.from_bytes(content)

    def views(eyes: Iterable[Pose], times: float) -> list[View]:
        each = (frustum.frusta(eye, near, frustum.density * density * times) for eye in eyes)
        return [_fitted(view) for view in chain.from_iterable(each)]

    centre, *corners = cell_eyes(pose, radius)
    denser = [*views(corners[:1] or [centre], DENSER), *views(corners[1:], 1)]
    found = _draw(scene, views([centre], 1), views(corners, 1), denser)
    write_checked(file, found.to_bytes())
    return found


def _fitted(view: View) -> View:
    """The view with neither side above LARGEST_VIEW."""
    return replace(view, width=min(view.width, LARGEST_VIEW), height=min(view.height, LARGEST_VIEW))


def _draw(scene: ServerScene, first: list[View], others: list[View], denser: list[View]) -> PotentiallyVisibleSet:
    """Draw the first views, then the others, or the denser ones where the first are poor."""
    device, count = scene.device, scene.host.triangle_count
    flags = device.zeros(count, np.uint8)
    with device.record() as record:
        drawn = _mark(scene, first, flags)
        poor = np.count_nonzero(flags.get()[:count]) > POOR * sum(view.width * view.height for view in first)
        rest = denser if poor else others
        drawn += _mark(scene, rest, flags)
    ids = np.flatnonzero(flags.get()[:count]).astype(np.int32)
    return PotentiallyVisibleSet(ids, drawn, len(first) + len(rest), sum(record.milliseconds.values()))


def _mark(scene: ServerScene, views: list[View], flags: Array) -> int:
    """Draw the views one after the other and mark what they show; how many were, without those that can add nothing."""
    drawn = 0
    for view in views:
        if scene.skips.leaves_out("set views", _adds_nothing(scene, view, flags)):
            continue
        if scene.layers:
            scene.layers.mark(view.view, view.projection, view.width, view.height, flags, stage="pvs")
        else:
            visible = scene.rasteriser.draw(view.view, view.projection, view.width, view.height, stage="pvs")
            mark_visible(scene.device, visible, flags, stage="pvs/mark")
        drawn += 1
    return drawn


def _adds_nothing(scene: ServerScene, view: View, flags: Array) -> bool:
    """Whether every triangle of every cluster in the view's frustum is marked already."""
    clusters = scene.rasteriser.in_frustum(view.view, view.projection)
    size = scene.rasteriser.clusters.size
    marked = flags.get()[: scene.host.triangle_count]
    full = np.logical_and.reduceat(marked, np.arange(0, len(marked), size))
    return bool(full[clusters].all())
