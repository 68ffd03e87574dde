"""From visibility to shading samples: one per covered pixel."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Array, Doubles, Ints
from shading_atlas_bench.kernels.common.scan import exclusive_scan
from shading_atlas_bench.kernels.raster.camera import Camera
from shading_atlas_bench.kernels.raster.rasteriser import Visibility
from shading_atlas_bench.kernels.samples import Samples
from shading_atlas_bench.kernels.triangles import Triangles

if TYPE_CHECKING:
    from shading_atlas_bench.kernels.device import Device


def resolve(
    device: Device,
    triangles: Triangles,
    visibility: Visibility,
    view: Doubles,
    projection: Doubles,
    stage: str = "raster/resolve",
) -> Samples:
    """One sample per covered pixel, in row order; its texel is the pixel. view, projection: float64 (4, 4).

    Barycentrics are perspective-correct at the pixel's centre, kept inside the triangle. The footprint is the longer of
    the steps that the surface point makes per pixel along x and along y. Where a triangle is seen so edge-on that
    neither is defined, the sample is its middle, with footprint 0.
    """
    camera = Camera.of(view, projection, visibility.width, visibility.height)
    width, height = camera.width, camera.height
    kernels = device.build("raster/resolve.cl")
    local = 1 if device.is_cpu else None
    counts = device.empty(height, np.int32)
    device.launch(stage, kernels.covered_per_row, height, width, height, visibility.triangle, counts, local=local)
    offsets, count = exclusive_scan(device, counts, height, stage)
    samples = Samples.allocate(device, count)
    listed = (width, height, visibility.triangle, offsets, samples.triangle, samples.texel)
    device.launch(stage, kernels.list_covered, height, *listed, local=local)
    locate_samples(device, triangles, samples, camera, stage)
    return samples


def locate_samples(device: Device, triangles: Triangles, samples: Samples, camera: Camera, stage: str) -> None:
    """Barycentrics and footprints of samples whose triangles and pixels (texel: row * width + column) are known."""
    inputs = (samples.count, camera.width, camera.height, *camera.arguments(), triangles.positions, triangles.indices)
    results = (samples.triangle, samples.texel, samples.bary1, samples.bary2, samples.footprint)
    kernel = device.build("raster/resolve.cl").sample_covered
    device.launch(stage, kernel, -(-samples.count // 8), *inputs, *results)


def resolve_twin(triangles: Triangles, triangle: Ints, view: Doubles, projection: Doubles) -> dict[str, Array]:
    """The samples of an image of triangle ids (height, width): arrays by the names of Samples, float64.

    See `locate_samples_twin`.
    """
    height, width = triangle.shape
    rows, columns = np.nonzero(triangle >= 0)
    ids = triangle[rows, columns]
    bary, footprint = locate_samples_twin(triangles, ids, columns, rows, view, projection, width, height)
    texel = rows * width + columns
    return {"triangle": ids, "bary1": bary[:, 0], "bary2": bary[:, 1], "footprint": footprint, "texel": texel}


def locate_samples_twin(
    triangles: Triangles,
    ids: Array,
    columns: Array,
    rows: Array,
    view: Doubles,
    projection: Doubles,
    width: int,
    height: int,
) -> tuple[Doubles, Doubles]:
    """Barycentrics float64 (n, 2), kept inside, and footprints (n): triangles `ids` int (n) at pixels, columns and rows
    int (n), of a view and projection, float64 (4, 4).

    Meets each triangle's plane with the ray through the pixel's centre, and with those one pixel to the right and
    below for the footprint's differentials.
    """
    corners = triangles.host_positions[triangles.host_indices[ids]].astype(np.float64)
    edges = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)
    normal = np.cross(edges[..., 0], edges[..., 1])

    def rays(x: Doubles, y: Doubles) -> tuple[Doubles, Doubles]:
        ndc = np.stack([2 * x / width - 1, 1 - 2 * y / height], axis=1)
        eye_space = np.zeros((len(x), 3))
        orthographic = projection[3, 3] == 1
        eye_space[:, 0] = (ndc[:, 0] - projection[0, 3] + (0 if orthographic else projection[0, 2])) / projection[0, 0]
        eye_space[:, 1] = (ndc[:, 1] - projection[1, 3] + (0 if orthographic else projection[1, 2])) / projection[1, 1]
        eye_space[:, 2] = 0 if orthographic else -1
        back = np.linalg.inv(view)
        if orthographic:
            origin = eye_space @ back[:3, :3].T + back[:3, 3]
            return origin, np.broadcast_to(-back[:3, 2], origin.shape)
        return np.broadcast_to(back[:3, 3], (len(x), 3)), eye_space @ back[:3, :3].T

    def meet(origin: Doubles, direction: Doubles) -> Doubles:
        distance = ((corners[:, 0] - origin) * normal).sum(axis=1) / (direction * normal).sum(axis=1)
        points: Doubles = origin + distance[:, None] * direction
        return points

    origin, direction = rays(columns + 0.5, rows + 0.5)
    points = meet(origin, direction)
    weights = (np.linalg.pinv(edges) @ (points - corners[:, 0])[..., None])[..., 0]
    b1 = weights[:, 0].clip(0, 1)
    slope = ((points - origin) * direction).sum(axis=1) / (direction**2).sum(axis=1)
    steps = []
    for dx, dy in ((1, 0), (0, 1)):
        other_origin, other = rays(columns + 0.5 + dx, rows + 0.5 + dy)
        change = (other - direction) * slope[:, None] + (other_origin - origin)  # of the point at the same distance
        along = (change * normal).sum(axis=1) / (direction * normal).sum(axis=1)
        steps.append(np.linalg.norm(change - along[:, None] * direction, axis=1))
    return np.stack([b1, np.clip(weights[:, 1], 0, 1 - b1)], axis=1), np.maximum(*steps)
