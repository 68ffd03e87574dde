"""The patches that have a triangle in the potentially visible set."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.kernels.common.scan import exclusive_scan

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic.arrays import Bytes, Ints
    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.packers.sas.kernels.tables import PatchTables

HERE = Path(__file__).parent

STAGE = "structs/visible"


@dataclass
class Marks:
    """Which triangles are in the potentially visible set: those that are marked with its number.

    triangles: int32 (T), the number of the last set that had each triangle. number: of the present set, counted from 1.
    """

    triangles: Array
    number: int = 0

    @classmethod
    def none(cls, device: Device, triangles: int) -> Marks:
        """Of so many triangles, before the first set."""
        return cls(device.zeros(max(1, triangles), np.int32))


@dataclass(frozen=True)
class VisiblePatches:
    """Patches with a triangle in the set, in the order of their first triangle there, on the device.

    patches: int32 (count). masks: uint8 (count), bit k set where the patch's member k is in the set.
    """

    count: int
    patches: Array
    masks: Array

    @classmethod
    def none(cls, device: Device) -> VisiblePatches:
        """Those of an empty set."""
        return cls(0, device.empty(0, np.int32), device.empty(0, np.uint8))


def visible_patches(device: Device, pvs: Array, count: int, tables: PatchTables, marks: Marks) -> VisiblePatches:
    """Patches with a triangle among `pvs`, int32 (count), ascending. Marks these with a new number."""
    kernels = device.build(HERE / "visible.cl")
    marks.number += 1
    device.launch(STAGE, kernels.mark_triangles, count, count, pvs, marks.number, marks.triangles)
    known = (pvs, tables.of_triangle, tables.members, marks.triangles, marks.number)
    first = device.empty(count, np.int32)
    device.launch(STAGE, kernels.find_first, count, count, *known, first)
    offsets, found = exclusive_scan(device, first, count, STAGE)
    patches, masks = device.empty(found, np.int32), device.empty(found, np.uint8)
    device.launch(STAGE, kernels.list_patches, count, count, *known, first, offsets, patches, masks)
    return VisiblePatches(found, patches, masks)


def visible_patches_twin(pvs: Ints, patch_of_triangle: Ints, members: Ints) -> tuple[Ints, Bytes]:
    """The same on the host: patches and masks."""
    patches, first = np.unique(patch_of_triangle[pvs], return_index=True)
    patches = patches[np.argsort(first)].astype(np.int32)
    masks = (np.isin(members[patches], pvs) * [1, 2, 4]).sum(axis=1)
    return patches, masks.astype(np.uint8)
