"""The client of Tessellated Shading Streaming: perspective lookups in Ls and right triangles."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from kernels.tss.bins import Bins
from kernels.tss.footprint import measure_triangles
from kernels.tss.lookup import locate_twin, look_up
from kernels.tss.perspective import invert_depths
from packers.atlas_client import LookupClient
from packers.interface import ServerScene
from packers.tss.message import decode

if TYPE_CHECKING:
    from pyopencl.array import Array

    from kernels.samples import Samples

STAGE = "client/decode"


class TessellatedClient(LookupClient):
    """Finds each pixel's piece, its L or right triangle, and the position there."""

    def __init__(self, scene: ServerScene) -> None:
        super().__init__(scene)
        self.bins = Bins.make()
        self._inverse: np.ndarray | None = None

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
        self._inverse = None

    def look_up(self, samples: Samples, plane: Array, rgb: Array, drawn: Array) -> None:
        """Colour the pixels of `samples`."""
        known = (self.inverse, *self.uploaded, self.ids, plane)
        look_up(self.device, samples, *known, rgb, drawn, "client/lookup")

    def locate(self, triangles: np.ndarray, bary: np.ndarray) -> np.ndarray:
        """Atlas position of surface points (see Client.locate), in float64 from what drawing uses."""
        row, known = self.rows(triangles)
        if not known.any():
            return np.full((len(triangles), 2), np.nan)
        if self._inverse is None:
            self._inverse = self.inverse.get()[:, :3]
        records = self.records
        place = locate_twin(bary, self._inverse[row], records.pieces[row], records.starts[row], records.records)
        place[~known] = np.nan
        return place
