"""The client of Tessellated Shading Streaming: perspective lookups in Ls and right triangles."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.packers.atlas_client import LookupClient
from shading_atlas_bench.packers.interface import ClientScene
from shading_atlas_bench.packers.tss.kernels.bins import Bins
from shading_atlas_bench.packers.tss.kernels.footprint import measure_triangles
from shading_atlas_bench.packers.tss.kernels.locate import locate
from shading_atlas_bench.packers.tss.kernels.perspective import invert_depths
from shading_atlas_bench.packers.tss.message import decode

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.samples import Samples

STAGE = "client/decode"


class TessellatedClient(LookupClient):
    """Finds each pixel's piece, its L or right triangle, and the position there."""

    def __init__(self, scene: ClientScene) -> None:
        super().__init__(scene)
        self.bins = Bins.make()

    def read(self, blobs: Mapping[str, bytes]) -> None:
        """Take where the frame's primitives lie, and the perspective that the server saw them in."""
        rows = len(self.geometry.pvs)
        self.records = decode(blobs, rows, self.bins)
        upload, triangles = self.device.upload, self.triangles
        ids, camera = upload(np.arange(rows, dtype=np.int32)), upload(self.records.camera)
        seen = (triangles.indices, triangles.positions, camera)
        depths, _ = measure_triangles(self.device, ids, rows, *seen, self.records.scale, 0, STAGE)
        tables = (self.records.pieces, self.records.starts, self.records.records)
        self.uploaded = [upload(table) for table in tables]
        self.inverse = invert_depths(self.device, depths, self.uploaded[0], rows, self.records.scale, STAGE)

    def place(self, samples: Samples) -> Array:
        """Where the samples lie in their Ls and right triangles."""
        return locate(self.device, samples, self.inverse, *self.uploaded, "client/locate")
