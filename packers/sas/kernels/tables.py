"""The patches of a scene as tables: on the host as they were found, and on the device."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.packers.sas.kernels.layout import ROLE_WEIGHTS

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic.arrays import Bytes, Ints, Longs
    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.kernels.triangles import Triangles

HERE = Path(__file__).parent

# For each code a1, b1, c1, a2, b2, c2, 0, 0: barycentric k of a triangle is ak + bk u + ck v.
CODE_WEIGHTS = np.zeros((15, 8), np.float32)
CODE_WEIGHTS[:, :6] = ROLE_WEIGHTS[
    np.arange(15)[:, None] // 3, (np.arange(1, 3) - np.arange(15)[:, None] % 3) % 3
].reshape(15, 6)


@dataclass(frozen=True)
class Patches:
    """Patches in the order of their lowest triangle.

    of_triangle: int32 (T), the patch of each triangle. codes: uint8 (T), its role and rotation (see layout).
    members: int32 (P, 3), triangles by their slot, -1 where the patch has fewer.
    points: int32 (P, 5), the vertex on each of layout.POINTS, -1 where there is none.
    """

    of_triangle: Ints
    codes: Bytes
    members: Ints
    points: Ints

    @property
    def count(self) -> int:
        """How many patches there are, P."""
        return len(self.members)

    def sizes(self, patches: Ints | slice = slice(None)) -> Longs:
        """Triangles in each of these patches, int64 (n) for patches int (n) or a slice of them."""
        sizes: Longs = (self.members[patches] >= 0).sum(axis=1)
        return sizes


@dataclass(frozen=True)
class PatchTables:
    """The same on the device, and what emitting needs of them.

    count: of patches. weights: float32 (15, 8), CODE_WEIGHTS. ways: float32 (T, 2), the ways on each triangle's surface
    along u and along v from one side of the patch to the other.
    """

    count: int
    of_triangle: Array
    codes: Array
    members: Array
    points: Array
    weights: Array
    ways: Array

    @classmethod
    def upload(cls, device: Device, patches: Patches, triangles: Triangles) -> PatchTables:
        """Upload the patches of these triangles and measure the ways."""
        of_triangle, codes = device.upload(patches.of_triangle), device.upload(patches.codes)
        members, points = device.upload(patches.members), device.upload(patches.points)
        weights, ways = device.upload(CODE_WEIGHTS), device.empty((triangles.count, 2), np.float32)
        measured = (triangles.count, codes, weights, triangles.indices, triangles.positions, ways)
        device.launch("prepare/ways", device.build(HERE / "emit.cl").texel_derivatives, triangles.count, *measured)
        return cls(patches.count, of_triangle, codes, members, points, weights, ways)
