"""The potentially visible set of a view cell: every triangle that some view from inside the cell shows.

Through blended surfaces others are seen: there a triangle is shown that makes up 1/255 or more of a pixel, its opacity
times the light let through by what lies in front of it.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from arithmetic.matrices import turned
from harness.views import CellFrustum, Pose, rotation
from kernels.cache import cache_root, read_checked, write_checked
from kernels.device import kernels_digest
from kernels.raster.mark import mark_visible
from packers.interface import ServerScene, View

if TYPE_CHECKING:
    from pyopencl.array import Array

_HEAD = struct.Struct("<IId")  # of a cached set: views, planned, milliseconds
LARGEST_VIEW = 8192  # pixels per side; a denser view is drawn at the density that fits


@dataclass(frozen=True)
class PotentiallyVisibleSet:
    """ids: int32 (n), ascending. views: how many were drawn, of how many planned.

    milliseconds: device time of drawing them, on this device, perhaps by an earlier run.
    """

    ids: np.ndarray
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
            yield replace(pose, position=pose.position + turned(turn, corner) * radius / np.sqrt(3))


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
    key.update(kernels_digest().encode())
    file = cache_root() / "pvs" / key.hexdigest()[:32]
    planned = [view for eye in cell_eyes(pose, radius) for view in frustum.frusta(eye, near, frustum.density * density)]
    if cached and (content := read_checked(file)) is not None:
        return PotentiallyVisibleSet.from_bytes(content)
    found = _draw(scene, [_fitted(view) for view in planned])
    write_checked(file, found.to_bytes())
    return found


def _fitted(view: View) -> View:
    """The view with neither side above LARGEST_VIEW."""
    return replace(view, width=min(view.width, LARGEST_VIEW), height=min(view.height, LARGEST_VIEW))


def _draw(scene: ServerScene, views: list[View]) -> PotentiallyVisibleSet:
    """Draw the views one after the other and mark what they show; skip those that cannot add anything."""
    device, count = scene.device, scene.host.triangle_count
    flags = device.zeros(count, np.uint8)
    drawn = 0
    with device.record() as record:
        for view in views:
            adds_nothing = bool(drawn) and _adds_nothing(scene, view, flags)
            if scene.skips.leaves_out("set views", adds_nothing):
                continue
            camera = (view.view, view.projection, view.width, view.height)
            if scene.layers:
                scene.layers.mark(*camera, flags, stage="pvs")
            else:
                mark_visible(device, scene.rasteriser.draw(*camera, stage="pvs"), flags, stage="pvs/mark")
            drawn += 1
    ids = np.flatnonzero(flags.get()[:count]).astype(np.int32)
    return PotentiallyVisibleSet(ids, drawn, len(views), sum(record.milliseconds.values()))


def _adds_nothing(scene: ServerScene, view: View, flags: Array) -> bool:
    """Whether every triangle of every cluster in the view's frustum is marked already."""
    clusters = scene.rasteriser.in_frustum(view.view, view.projection)
    size = scene.rasteriser.clusters.size
    marked = flags.get()[: scene.host.triangle_count]
    full = np.logical_and.reduceat(marked, np.arange(0, len(marked), size))
    return bool(full[clusters].all())
