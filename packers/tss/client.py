"""The client of Tessellated Shading Streaming: perspective lookups in Ls and right triangles."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.packers.atlas_client import LookupClient
from shading_atlas_bench.packers.interface import ClientScene
from shading_atlas_bench.packers.tss.kernels.bins import Bins
from shading_atlas_bench.packers.tss.kernels.footprint import measure_triangles
from shading_atlas_bench.packers.tss.kernels.locate import Located, locate
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
        records, device = decode(blobs, rows, self.bins), self.device
        ids, camera = device.upload(np.arange(rows, dtype=np.int32)), device.upload(records.camera)
        depths, _ = measure_triangles(device, ids, rows, self.triangles, camera, records.scale, 0, STAGE)
        pieces, starts = device.upload(records.pieces), device.upload(records.starts)
        inverse = invert_depths(device, depths, pieces, rows, records.scale, STAGE)
        self.located = Located(inverse, pieces, starts, device.upload(records.records))

    def place(self, samples: Samples) -> Array:
        """Where the samples lie in their Ls and right triangles."""
        return locate(self.device, samples, self.located, "client/locate")
