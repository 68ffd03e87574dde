"""Per triangle: material and UV scale, which turns a footprint in the scene into one in texture space."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic import arrays
from shading_atlas_bench.arithmetic.arrays import Doubles

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device


def face_rows(device: Device, vertices: Array, indices: Array, material_ids: arrays.Array) -> Array:
    """int32 (T, 2) on the device: material, and the bits of the float32 UV scale.

    vertices: float32 (V, 8), position, normal, uv; indices: int32 (T, 3); material_ids: int32 (T). The UV scale is the
    largest singular value of d UV / d P; 0 for triangles without area.
    """
    count = len(material_ids)
    faces = device.empty((count, 2), np.int32)
    materials = device.upload(np.ascontiguousarray(material_ids, np.int32))
    kernel = device.build("shade/faces.cl").uv_scales
    device.launch("shade/faces", kernel, count, count, vertices, indices, materials, faces)
    return faces


def uv_scale_twin(vertices: arrays.Array, indices: arrays.Array) -> Doubles:
    """float64 (T): the UV scales, of vertices and indices as for `face_rows`, on the host.

    Triangles whose squared area float32 does not hold have none.
    """
    corners = np.asarray(vertices, np.float64)[indices]
    sides = corners[:, 1:] - corners[:, :1]
    scales = np.zeros(len(indices))
    for i, side in enumerate(sides):
        if np.linalg.norm(np.cross(side[0, :3], side[1, :3])) ** 2 > np.finfo(np.float32).tiny:
            in_plane = np.linalg.qr(side[:, :3].T, mode="r")  # the sides in orthonormal coordinates of their plane
            scales[i] = np.linalg.svd(side[:, 6:].T @ np.linalg.inv(in_plane), compute_uv=False)[0]
    return scales
