"""The patches that have a triangle in the potentially visible set."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.kernels.common.scan import exclusive_scan

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device

HERE = Path(__file__).parent

STAGE = "structs/visible"


def visible_patches(
    device: Device, pvs: Array, count: int, patch_of_triangle: Array, members: Array, marks: Array, mark: int
) -> tuple[Array, Array, int]:
    """Patches with a triangle among the first `count` of `pvs`, in the order of their first triangle there.

    pvs: int32, ascending. patch_of_triangle: int32 (T). members: int32 (P, 3), -1 for none. marks: int32 (T), scratch
    kept between calls; `mark` must differ from every value in it.
    Returns patches int32 (n), masks uint8 (n) with bit k set where the patch's member k is in the set, and n.
    """
    kernels = device.build(HERE / "visible.cl")
    device.launch(STAGE, kernels.mark_triangles, count, count, pvs, mark, marks)
    first = device.empty(count, np.int32)
    device.launch(STAGE, kernels.find_first, count, count, pvs, patch_of_triangle, members, marks, mark, first)
    offsets, found = exclusive_scan(device, first, count, STAGE)
    patches, masks = device.empty(found, np.int32), device.empty(found, np.uint8)
    known = (patch_of_triangle, members, marks, mark)
    device.launch(STAGE, kernels.list_patches, count, count, pvs, *known, first, offsets, patches, masks)
    return patches, masks, found


def visible_patches_twin(
    pvs: np.ndarray, patch_of_triangle: np.ndarray, members: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The same on the host: patches and masks."""
    patches, first = np.unique(patch_of_triangle[pvs], return_index=True)
    patches = patches[np.argsort(first)].astype(np.int32)
    masks = (np.isin(members[patches], pvs) * [1, 2, 4]).sum(axis=1)
    return patches, masks.astype(np.uint8)
