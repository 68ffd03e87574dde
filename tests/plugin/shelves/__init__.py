"""Shelves: a square cell for each triangle, about as large as it is on screen; cells of one size stand in rows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench import ClientScene, Frame, Packer, Paper, Payload, ServerScene, edge_pixels
from shading_atlas_bench.packers.atlas_client import AtlasClient, geometry_encoder
from shading_atlas_bench.packers.interface import FULL

from .cells import place_cells, wanted_levels
from .kernels.emit import emit_samples

if TYPE_CHECKING:
    from pyopencl.array import Array


class Shelves(Packer):
    name, paper = "shelves", Paper("An example without a paper", 2026, "")

    def prepare(self, scene: ServerScene) -> None:
        self.geometry = geometry_encoder(scene, {})

    def pack(self, frame: Frame) -> Payload:
        width, height, host = frame.atlas_width, frame.atlas_height, frame.scene.host
        corners = host.positions[host.indices[frame.pvs]]
        pixels = edge_pixels(frame.server, corners).max(axis=1)
        wanted = levels = wanted_levels(pixels, min(width, height))
        cells = place_cells(levels, width)
        while levels.any() and not cells.inside(height).all():  # all cells half as large, until there is room
            levels = np.maximum(levels - 1, 0)
            cells = place_cells(levels, width)
        placed = cells.inside(height)
        lengths = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).max(axis=1)
        ids = frame.pvs[placed]
        samples = emit_samples(frame.scene.device, ids, cells.only(placed), lengths[placed], width, "gather/emit")
        return Payload(
            planes=frame.shade(samples),
            blobs={"levels": levels.astype(np.uint8).tobytes()},
            geometry=self.geometry.encode(frame.pvs),
            sample_count=samples.count,
            samples=samples,
            unplaced=dict.fromkeys(frame.pvs[~placed].tolist(), "there are more triangles than texels"),
            statistics={FULL: int(not np.array_equal(levels, wanted))},
        )

    def client(self, scene: ClientScene) -> ShelvesClient:
        return ShelvesClient(scene)


class ShelvesClient(AtlasClient):
    def read(self, blobs: Mapping[str, bytes]) -> None:
        self.levels = np.frombuffer(blobs["levels"], np.uint8).astype(np.int32)

    def corner_texels(self) -> Array:
        height, width = self.plane.shape[:2]
        cells = place_cells(self.levels, width)
        first = np.stack([cells.columns, cells.rows], axis=1) + 0.5
        last = (cells.sides - 1)[:, None, None] * np.array([[0, 0], [1, 0], [0, 1]])
        corners = first[:, None] + last
        corners[~cells.inside(height)] = np.nan
        return self.device.upload(corners.astype(np.float32))
