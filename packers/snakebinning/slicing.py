"""Triangles that dominate the screen are sliced (section 3.1): their pieces get slots in their place."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from shading_atlas_bench.packers.snakebinning.kernels.pieces import SlicedScene, TriangleList
from shading_atlas_bench.packers.snakebinning.kernels.slices import Slices, screen_shares, slice_dominating

if TYPE_CHECKING:
    from collections.abc import Sequence

    from shading_atlas_bench.arithmetic.arrays import Bools, Ints
    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.kernels.triangles import Triangles
    from shading_atlas_bench.packers.interface import Frame, View


@dataclass(frozen=True)
class Items:
    """What gets slots in a frame: the triangles of its set that are not sliced, and the pieces of the others, without
    those that are left out.

    ids: int32 (n), pieces last. listed: the same on the device. shown: int (k), rows in the slices of the pieces whose
    parents are in the set, left out or not.
    """

    ids: Ints
    listed: TriangleList
    shown: NDArray[np.intp]


class Slicing:
    """The pieces of the last rebuild, which stay while the layout is frozen.

    share: of a client's picture from which on a triangle that leaves it is sliced, 0 for never. slices: the pieces.
    scene: the scene's triangles with them. sliced_at: the frame in which that was.
    """

    def __init__(self, device: Device, triangles: Triangles, share: float) -> None:
        self.device, self.share = device, share
        self.slices, self.sliced_at = Slices(), -1
        self.scene = SlicedScene(triangles, self.slices.upload(device, triangles.count))

    @property
    def first(self) -> int:
        """The number of the first piece."""
        return self.scene.pieces.first

    @property
    def pieces(self) -> Ints:
        """The numbers of all pieces, int32 (k)."""
        return self.first + np.arange(len(self.slices.parents), dtype=np.int32)

    def slice(self, frame: Frame, number: int, candidates: Ints, clients: Sequence[View]) -> None:
        """Choose what to slice, once a frame, among triangles that leave the screen of a camera turned to them.

        candidates: int32 (n), these triangles.
        """
        if self.sliced_at == number:
            return
        self.sliced_at = number
        triangles, before = self.scene.triangles, len(self.slices.parents)
        corners = triangles.host_positions[triangles.host_indices[candidates]].astype(np.float64)
        matrices = [view.matrix for view in clients]
        self.slices = Slices()
        if self.share > 0:
            server, margin = frame.server.matrix, frame.cell_radius
            self.slices = slice_dominating(candidates, corners, matrices, server, margin, self.share)
        if before or len(self.slices.parents):
            self.scene = replace(self.scene, pieces=self.slices.upload(self.device, triangles.count))

    def is_sliced(self, pvs: Ints) -> Bools:
        """Which triangles, int32 (n), have pieces."""
        return np.isin(pvs, self.slices.parents)

    def shows_outside(self, server: View) -> bool:
        """Whether a view shows any of the pieces that none from the cell showed, and that are coarse."""
        return bool((screen_shares(self.slices.corners[~self.slices.inside], server.matrix) > 0).any())

    def items(self, frame: Frame, left_out: Bools) -> Items:
        """What gets slots in a frame; left_out: (T + MOST), triangles and pieces that get none."""
        shown = np.flatnonzero(np.isin(self.slices.parents, frame.pvs))
        if not len(shown) and not left_out.any():
            return Items(frame.pvs, TriangleList(frame.pvs_device, len(frame.pvs)), shown)
        whole = frame.pvs[~self.is_sliced(frame.pvs)]
        ids = np.concatenate([whole, self.first + shown.astype(np.int32)])
        ids = ids[~left_out[ids]]
        return Items(ids, TriangleList.upload(self.device, ids), shown)
