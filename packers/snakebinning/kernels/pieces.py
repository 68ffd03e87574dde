"""What kernels get of triangles: those of the scene, pieces of those that are sliced, and lists of both."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from shading_atlas_bench.kernels.constants import constants_of

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic.arrays import Ints
    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.kernels.triangles import Triangles

DEFINED = constants_of(Path(__file__).with_name("pieces.cl"))
# Nine of corners, six of their barycentrics 1 and 2 in the parent, and the parent's number as bits.
PIECE_FLOATS = DEFINED.whole("PIECE_FLOATS")
OUTSIDE = DEFINED.number("OUTSIDE")  # texels that barycentrics may lie further outside than one height


@dataclass(frozen=True)
class TriangleList:
    """Triangles of the scene, and pieces: the first `count` of the numbers `ids`, int32 (n) on the device."""

    ids: Array
    count: int

    @classmethod
    def upload(cls, device: Device, ids: Ints) -> TriangleList:
        """Those of a list on the host, int32 (n)."""
        return cls(device.upload(ids), len(ids))


@dataclass(frozen=True)
class Pieces:
    """Pieces of sliced triangles, numbered from `first` on. rows: float32 (MOST, 16) on the device, see pieces.cl."""

    first: int
    rows: Array


@dataclass(frozen=True)
class SlicedScene:
    """The scene's triangles, and pieces of those that are sliced."""

    triangles: Triangles
    pieces: Pieces
