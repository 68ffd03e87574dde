"""Reprojection of fragment lists to another view."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.matrices import inverse, product
from shading_atlas_bench.kernels.common.scan import exclusive_scan
from shading_atlas_bench.packers.ppll.kernels.lists import Lists, ListView
from shading_atlas_bench.packers.ppll.kernels.rows import rays

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic.arrays import Bytes, Doubles, Floats
    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.packers.interface import View

HERE = Path(__file__).parent

OVERLAP, WIDEST, SAME_SURFACE = 1.5, 4.0, 0.02  # as in splat.cl


def draw_lists(device: Device, views: Sequence[ListView], seen: View, picture: Array, depth: Array, stage: str) -> None:
    """Draw the lists of some list views, merged by depth, over `picture`, uint8 (h, w, 4).

    seen: the picture's camera. depth: float32 (h, w) becomes near over the distance of the nearest fragment seen, 0
    where none is. Where one list view and the picture have the same eye and pixels, this is the lists' blend.
    Slots are handed out by atomics, but each pixel sorts its points by distance and number, so their order is fixed.
    """
    width, height = seen.width, seen.height
    kernels = device.build(HERE / "splat.cl")
    count = sum(part.count for _, lists in views for part in lists)
    points, keys = device.recycled((count, 4), np.float32), device.recycled(count, np.float32)
    sources, colours = device.recycled(count, np.int32), device.recycled(count, np.uint32)
    at = first_pixel = 0
    for taken, lists in views:
        for part in lists:
            placing = _placing(part, taken, seen)
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
    inputs = (
        pixels,
        width,
        offsets,
        numbers,
        points,
        keys,
        sources,
        colours,
        float(seen.projection[2, 3]),
        picture,
        depth,
    )
    device.launch(f"{stage}/blend", kernels.blend_points, pixels, *inputs)


def _placing(part: Lists, taken: View, seen: View) -> tuple[Floats | float, ...]:
    """The arguments of place_points that say how lists are seen; float4 are four float32 in a row."""
    turn = product(seen.view, inverse(taken.view))
    turn[np.abs(turn) < 1e-12] = 0  # what inverting leaves of zeros
    lens = np.array(
        [
            seen.projection[0, 0] * seen.width / 2,
            seen.projection[1, 1] * seen.height / 2,
            (1 - seen.projection[0, 2]) * seen.width / 2,
            (1 + seen.projection[1, 2]) * seen.height / 2,
        ]
    )
    size = lens[0] / (taken.projection[0, 0] * part.width / 2)
    return (
        rays(taken.projection, part.width, part.height),
        float(taken.projection[2, 3]),
        *turn[:3].astype(np.float32),
        lens.astype(np.float32),
        float(size),
    )


@dataclass(frozen=True)
class _Point:
    """What a fragment adds to a pixel. source: its list view and pixel there. weight: by its nearness."""

    distance: float
    number: int
    source: tuple[int, int]
    weight: float
    rgba: Doubles


def draw_lists_twin(views: Sequence[ListView], seen: View, background: Bytes) -> tuple[Doubles, Doubles]:
    """float64 (h, w, 3), the picture over `background`, uint8 (h, w, 4), and float64 (h, w), its depth, pixel by pixel,
    as `draw_lists` for lists of colours and depths."""
    height, width = background.shape[:2]
    falling: dict[int, list[_Point]] = {}
    number = 0
    for at, taken, part in ((at, taken, part) for at, (taken, lists) in enumerate(views) for part in lists):
        offsets, rows = part.offsets.get(), part.rows.get()
        source = np.repeat(np.arange(part.pixels), np.diff(offsets))
        rgba = np.ascontiguousarray(rows[: len(source), 0]).view(np.uint8).reshape(-1, 4).astype(np.float64)
        lens, near = taken.projection, taken.projection[2, 3]
        z = near / np.ascontiguousarray(rows[: len(source), 1]).view(np.float32).astype(np.float64)
        x = (2 * (source % part.width + 0.5) / part.width - 1 + lens[0, 2]) / lens[0, 0] * z
        y = (1 - 2 * (source // part.width + 0.5) / part.height + lens[1, 2]) / lens[1, 1] * z
        eye = np.stack([x, y, -z, np.ones_like(z)], axis=1) @ (seen.view @ np.linalg.inv(taken.view)).T
        clip = eye @ seen.projection.T
        u, v = (clip[:, 0] / clip[:, 3] + 1) * width / 2, (1 - clip[:, 1] / clip[:, 3]) * height / 2
        spread = seen.projection[0, 0] * width / lens[0, 0] / part.width * z / -eye[:, 2]
        half = np.minimum(0.5 * OVERLAP * np.maximum(spread, 1), WIDEST)
        for i in np.flatnonzero((rgba[:, 3] > 0) & (-eye[:, 2] > near)).tolist():
            for row in range(int(np.ceil(v[i] - half[i] - 0.5)), int(np.ceil(v[i] + half[i] - 0.5))):
                for column in range(int(np.ceil(u[i] - half[i] - 0.5)), int(np.ceil(u[i] + half[i] - 0.5))):
                    if 0 <= row < height and 0 <= column < width:
                        w = (1 - abs(u[i] - column - 0.5) / half[i]) * (1 - abs(v[i] - row - 0.5) / half[i]) + 1e-4
                        point = _Point(-eye[i, 2], number + i, (at, int(source[i])), w, rgba[i])
                        falling.setdefault(row * width + column, []).append(point)
        number += len(source)
    out = background[..., :3].reshape(-1, 3).astype(np.float64)
    depth = np.zeros(height * width)
    for pixel, points in falling.items():
        depth[pixel] = seen.projection[2, 3] / min(point.distance for point in points)
        out[pixel] = _blended(sorted(points, key=lambda point: (point.distance, point.number)), out[pixel])
    return out.reshape(height, width, 3), depth.reshape(height, width)


def _blended(points: list[_Point], behind: Doubles) -> Doubles:
    """One pixel's points, nearest first, in groups of one surface over what is behind."""
    total, through = np.zeros(3), 1.0
    while points:
        nearest, group = points[0].distance, list[_Point]()
        while points and points[0].distance <= nearest * (1 + SAME_SURFACE):
            if points[0].source in {point.source for point in group}:
                break
            group.append(points.pop(0))
        colour = np.average([point.rgba for point in group], axis=0, weights=[point.weight for point in group])
        total += through * colour[3] / 255 * colour[:3]
        through *= 1 - colour[3] / 255
    blend: Doubles = total + through * behind
    return blend
