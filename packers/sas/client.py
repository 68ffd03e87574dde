"""The client of Shading Atlas Streaming: location words to atlas coordinates."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import DTypeLike

from shading_atlas_bench.packers.atlas_client import AtlasClient
from shading_atlas_bench.packers.interface import ClientScene
from shading_atlas_bench.packers.sas.kernels.corners import locate_corners
from shading_atlas_bench.packers.sas.locations import Locations

if TYPE_CHECKING:
    from pyopencl.array import Array


class ShadingAtlasClient(AtlasClient):
    """Keeps the location word of every patch; draws as every atlas client."""

    attributes: ClassVar[Mapping[str, DTypeLike]] = {"patch": np.int32, "code": np.uint8}

    def __init__(self, scene: ClientScene) -> None:
        super().__init__(scene)
        self.locations = Locations()

    def read(self, blobs: Mapping[str, bytes]) -> None:
        """Update the words of the current patches, which come in the order of their first triangle in the set."""
        self.patches, self.codes = self.geometry.current("patch"), self.geometry.current("code")
        ids, first = np.unique(self.patches, return_index=True)
        self.locations.decode(ids[np.argsort(first)], blobs["locations"])
        self.uploaded = [self.device.upload(values) for values in (self.patches, self.codes, self.locations.words)]

    def corner_texels(self) -> Array:
        """The corners of each triangle in its patch's block."""
        patches, codes, words = self.uploaded
        return locate_corners(self.device, patches, codes, len(self.patches), words, "client/decode")
