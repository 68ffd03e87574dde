"""The work of each frame, the same for every packer: server view, view cell, potentially visible set, novel view."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import fixed
from shading_atlas_bench.arithmetic.matrices import matvec
from shading_atlas_bench.harness.workload.prediction import predict
from shading_atlas_bench.harness.workload.pvs import potentially_visible
from shading_atlas_bench.harness.workload.settings import Settings
from shading_atlas_bench.harness.workload.views import (
    CellFrustum,
    Pose,
    ViewCell,
    client_view,
    confined,
    rotation,
)
from shading_atlas_bench.packers.interface import Frame, ServerScene, View
from shading_atlas_bench.scenes.quaternions import multiply

if TYPE_CHECKING:
    from shading_atlas_bench.scenes.head_motion import HeadMotion
    from shading_atlas_bench.scenes.paths import CameraPath

PREDICTIONS = 3


def sample_budget(settings: Settings) -> int | None:
    """Shading samples that a frame of these settings may have, None where there is no budget."""
    per_pixel = settings.samples_per_pixel
    return None if per_pixel is None else round(per_pixel * settings.width * settings.height)


@dataclass(frozen=True)
class FrameWorkload:
    """One frame of work and, kept apart from what packers see, the novel view it is judged by.

    pvs_ms: device time of finding the PVS, when it was found. confined: whether the client's pose had to be moved into
    the cell. skipped: what was left out meanwhile.
    """

    frame: Frame
    novel: View
    pvs_ms: float
    confined: bool
    skipped: frozenset[str] = frozenset()


class FrameSource:
    """Makes the work of any frame of a run, from the path alone, so that a resumed run gets the same work.

    cached: whether visible sets may come from the cache; not where the time that they take is wanted.
    """

    def __init__(
        self, scene: ServerScene, path: CameraPath, head: HeadMotion, settings: Settings, cached: bool = True
    ) -> None:
        self.scene, self.path, self.head, self.settings, self.cached = scene, path, head, settings, cached
        host = scene.host
        low, high = host.bounds
        diagonal = float(np.linalg.norm(high - low, axis=-1))
        self.near = min(0.02 / host.metres_per_unit, 1e-3 * diagonal)
        self.radius = settings.cell_radius / host.metres_per_unit
        self.frustum = CellFrustum.around(
            ViewCell(settings.cell_radius, settings.cell_fov), settings.fov, settings.width, settings.height
        )

    def work(self, index: int) -> FrameWorkload:
        """The work of frame `index`."""
        settings = self.settings
        pose = self._pose(index)
        novel, moved = self._novel_view(index, pose)
        pvs = potentially_visible(
            self.scene, pose, self.radius, self.frustum, self.near, settings.pvs_density, self.cached
        )
        frame = Frame(
            index=index,
            scene=self.scene,
            server=self.frustum.server_view(pose, self.near),
            cell_radius=self.radius,
            cell_fov=settings.cell_fov,
            pvs=fixed(pvs.ids),
            pvs_device=self.scene.device.upload(pvs.ids),
            predicted=self._predicted(index),
            atlas_width=settings.atlas_width,
            atlas_height=settings.atlas_height,
            sample_budget=sample_budget(settings),
            seed=settings.seed,
            frusta=self.frustum.split(pose, self.near),
        )
        return FrameWorkload(frame, novel, pvs.milliseconds, moved, self.scene.skips.take())

    def _pose(self, index: int) -> Pose:
        return Pose(self.path.positions[index], self.path.orientations[index])

    def _client(self, pose: Pose) -> View:
        settings = self.settings
        return client_view(pose, settings.fov, settings.width, settings.height, self.near)

    def _novel_view(self, index: int, server: Pose) -> tuple[View, bool]:
        """The client's view: the path's pose `latency` later, plus head motion, inside the cell."""
        settings = self.settings
        time = float(self.path.times_ms[index])
        position, orientation = self.path.pose_at(time + settings.latency)
        shift, turn = self.head.offset(time, settings.latency)
        shift = matvec(rotation(orientation), shift) / self.scene.host.metres_per_unit
        wanted = Pose(position + shift, multiply(orientation, turn))
        pose, moved = confined(server, wanted, self.radius, self.frustum, self._client(wanted))
        return self._client(pose), moved

    def _predicted(self, index: int) -> tuple[View, ...]:
        """Client views expected within the latency, from the poses up to this frame only."""
        past = [self._pose(i) for i in range(max(0, index - 29), index + 1)]
        times = self.path.times_ms[max(0, index - 29) : index + 1]
        ahead = [self.settings.latency * (k + 1) / PREDICTIONS for k in range(PREDICTIONS)]
        return tuple(self._client(pose) for pose in predict(times, past, ahead, self.scene.host.metres_per_unit))
