"""The smallest packer: a square cell for each triangle, which fills its upper left half."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench import ClientScene, Frame, Packer, Paper, Payload, Samples, ServerScene
from shading_atlas_bench.packers.atlas_client import AtlasClient, geometry_encoder

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic.arrays import Longs


def cells(count: int, width: int, height: int) -> tuple[int, Longs, Longs]:
    """Side of the largest cells of which `count` fit, and column and row where each begins, int64 (count)."""
    side = max(s for s in range(1, 65) if (width // s) * (height // s) >= min(max(count, 1), width * height))
    return side, np.arange(count) % (width // side) * side, np.arange(count) // (width // side) * side


class Grid(Packer):
    """Cells of one size for all triangles of the set, in its order."""

    name, paper = "grid", Paper("An example without a paper", 2026, "")

    def prepare(self, scene: ServerScene) -> None:
        """Begin the stream of the triangles' geometry."""
        self.geometry = geometry_encoder(scene, {})

    def pack(self, frame: Frame) -> Payload:
        """Shade the cells of the triangles that fit."""
        device, width, height = frame.scene.device, frame.atlas_width, frame.atlas_height
        side, x, y = cells(len(frame.pvs), width, height)
        fits = y + side <= height
        pvs, x, y = frame.pvs[fits], x[fits, None], y[fits, None]
        row, column = np.nonzero(np.add.outer(np.arange(side), np.arange(side)) <= side)  # what lookups touch
        bary1, bary2 = (np.tile(k / max(side - 1, 1), len(pvs)) for k in (column, row))
        corners = frame.scene.host.positions[frame.scene.host.indices[pvs]]
        edge = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).max(axis=1)
        texel = ((y + row) * width + x + column).reshape(-1)
        owner, footprint = (np.repeat(k, len(row)) for k in (pvs, edge / side))
        samples = Samples.upload(device, owner, bary1, bary2, footprint, texel)
        return Payload(
            planes=frame.shade(samples),
            blobs={},
            geometry=self.geometry.encode(frame.pvs),
            sample_count=samples.count,
            samples=samples,
            unplaced=dict.fromkeys(frame.pvs[~fits].tolist(), "there are more triangles than texels"),
        )

    def client(self, scene: ClientScene) -> GridClient:
        """A client, which finds the cells by itself."""
        return GridClient(scene)


class GridClient(AtlasClient):
    """Draws from the cells of the triangles that it has received."""

    def corner_texels(self) -> Array:
        """float32 (n, 3, 2) on the device: the corners in each triangle's cell, NaN for those that do not fit."""
        height, width = self.plane.shape[:2]
        side, x, y = cells(len(self.geometry.pvs), width, height)
        corner = np.stack([x, y], axis=1)[:, None] + 0.5 + (side - 1) * np.array([[0, 0], [1, 0], [0, 1]])
        corner[y + side > height] = np.nan
        return self.device.upload(corner.astype(np.float32))
