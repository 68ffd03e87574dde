"""Reprojection of fragment lists to another view."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.matrices import inverse, product
from shading_atlas_bench.kernels.common.scan import exclusive_scan
from shading_atlas_bench.packers.ppll.kernels.lists import Lists
from shading_atlas_bench.packers.ppll.kernels.rows import rays

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device

HERE = Path(__file__).parent

OVERLAP, WIDEST, SAME_SURFACE = 1.5, 4.0, 0.02  # as in splat.cl

Matrices = tuple[np.ndarray, np.ndarray]  # a camera's view and projection, float64 (4, 4)


def draw_lists(
    device: Device,
    views: Sequence[tuple[Matrices, Sequence[Lists]]],
    seen: Matrices,
    picture: Array,
    depth: Array,
    stage: str,
) -> None:
    """Draw the lists of some list views, merged by depth, over `picture`, uint8 (h, w, 4).

    views: each list view's camera, and its lists, of equal sizes. seen: the picture's camera. depth: float32 (h, w)
    becomes near over the distance of the nearest fragment seen, 0 where none is. Where one list view and the picture
    have the same eye and pixels, this is the lists' blend.
    Slots are handed out by atomics, but each pixel sorts its points by distance and number, so their order is fixed.
    """
    height, width = depth.shape
    kernels = device.build(HERE / "splat.cl")
    count = sum(part.count for _, lists in views for part in lists)
    points, keys = device.recycled((count, 4), np.float32), device.recycled(count, np.float32)
    sources, colours = device.recycled(count, np.int32), device.recycled(count, np.uint32)
    at = first_pixel = 0
    for taken, lists in views:
        for part in lists:
            placing = _placing(part, taken, seen, width, height)
            results = (at, first_pixel, points, keys, sources, colours)
            listed = (part.pixels, part.width, part.offsets, part.rows, part.words)
            device.launch(f"{stage}/place", kernels.place_points, part.pixels, *listed, *placing, *results)
            at += part.count
        first_pixel += lists[0].pixels
    pixels = width * height
    counts = device.recycled(pixels + 1, np.int32)
    device.fill(counts, 0, f"{stage}/count")
    device.launch(f"{stage}/count", kernels.count_points, count, count, width, height, points, counts)
    offsets, total = exclusive_scan(device, counts, pixels + 1, f"{stage}/scan")
    numbers, cursor = device.recycled(total, np.int32), offsets.copy()
    device.launch(f"{stage}/list", kernels.list_points, count, count, width, height, points, cursor, numbers)
    inputs = (pixels, width, offsets, numbers, points, keys, sources, colours, float(seen[1][2, 3]), picture, depth)
    device.launch(f"{stage}/blend", kernels.blend_points, pixels, *inputs)


def _placing(part: Lists, taken: Matrices, seen: Matrices, width: int, height: int) -> tuple:
    """The arguments of place_points that say how lists are seen."""
    from pyopencl import cltypes

    projection = seen[1]
    turn = product(seen[0], inverse(taken[0]))
    turn[np.abs(turn) < 1e-12] = 0  # what inverting leaves of zeros
    lens = (
        projection[0, 0] * width / 2,
        projection[1, 1] * height / 2,
        (1 - projection[0, 2]) * width / 2,
        (1 + projection[1, 2]) * height / 2,
    )
    size = lens[0] / (taken[1][0, 0] * part.width / 2)
    return (
        cltypes.make_float4(*rays(taken[1], part.width, part.height)),
        float(taken[1][2, 3]),
        *(cltypes.make_float4(*row) for row in turn[:3]),
        cltypes.make_float4(*lens),
        float(size),
    )


def draw_lists_twin(
    views: Sequence[tuple[Matrices, Sequence[Lists]]], seen: Matrices, background: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """float64 (h, w, 3), the picture over `background`, uint8 (h, w, 4), and float64 (h, w), its depth, pixel by pixel,
    as `draw_lists` for lists of colours and depths."""
    height, width = background.shape[:2]
    falling: dict[int, list] = {}
    number = 0
    for at, taken, part in ((at, taken, part) for at, (taken, lists) in enumerate(views) for part in lists):
        offsets, rows = part.offsets.get(), part.rows.get()
        source = np.repeat(np.arange(part.pixels), np.diff(offsets))
        rgba = np.ascontiguousarray(rows[: len(source), 0]).view(np.uint8).reshape(-1, 4).astype(np.float64)
        z = taken[1][2, 3] / np.ascontiguousarray(rows[: len(source), 1]).view(np.float32).astype(np.float64)
        x = (2 * (source % part.width + 0.5) / part.width - 1 + taken[1][0, 2]) / taken[1][0, 0] * z
        y = (1 - 2 * (source // part.width + 0.5) / part.height + taken[1][1, 2]) / taken[1][1, 1] * z
        eye = np.stack([x, y, -z, np.ones_like(z)], axis=1) @ (seen[0] @ np.linalg.inv(taken[0])).T
        clip = eye @ seen[1].T
        u, v = (clip[:, 0] / clip[:, 3] + 1) * width / 2, (1 - clip[:, 1] / clip[:, 3]) * height / 2
        spread = seen[1][0, 0] * width / taken[1][0, 0] / part.width * z / -eye[:, 2]
        half = np.minimum(0.5 * OVERLAP * np.maximum(spread, 1), WIDEST)
        for i in np.flatnonzero((rgba[:, 3] > 0) & (-eye[:, 2] > taken[1][2, 3])):
            for row in range(int(np.ceil(v[i] - half[i] - 0.5)), int(np.ceil(v[i] + half[i] - 0.5))):
                for column in range(int(np.ceil(u[i] - half[i] - 0.5)), int(np.ceil(u[i] + half[i] - 0.5))):
                    if 0 <= row < height and 0 <= column < width:
                        w = (1 - abs(u[i] - column - 0.5) / half[i]) * (1 - abs(v[i] - row - 0.5) / half[i]) + 1e-4
                        point = (-eye[i, 2], number + i, (at, source[i]), w, rgba[i])
                        falling.setdefault(row * width + column, []).append(point)
        number += len(source)
    out = background[..., :3].reshape(-1, 3).astype(np.float64)
    depth = np.zeros(height * width)
    for pixel, points in falling.items():
        depth[pixel] = seen[1][2, 3] / min(point[0] for point in points)
        out[pixel] = _blended(sorted(points, key=lambda point: point[:2]), out[pixel])
    return out.reshape(height, width, 3), depth.reshape(height, width)


def _blended(points: list, behind: np.ndarray) -> np.ndarray:
    """One pixel's points, nearest first, in groups of one surface over what is behind."""
    total, through = np.zeros(3), 1.0
    while points:
        group, sources = [], set()
        while points and points[0][0] <= (group or points)[0][0] * (1 + SAME_SURFACE) and points[0][2] not in sources:
            sources.add(points[0][2])
            group.append(points.pop(0))
        colour = np.average([point[4] for point in group], axis=0, weights=[point[3] for point in group])
        total += through * colour[3] / 255 * colour[:3]
        through *= 1 - colour[3] / 255
    return total + through * behind
