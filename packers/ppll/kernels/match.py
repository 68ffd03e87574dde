"""Bilateral transformation (chapter 5): what both ends hold is moved to the new view, and only the rest is sent.

All functions work on lists of normal fragments (rows.NORMAL_WORDS). Slots are handed out by atomics, but every list is
then sorted by distance and number, so its order is fixed: both ends compute the same bits.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.matrices import inverse, product
from shading_atlas_bench.kernels.common.scan import exclusive_scan
from shading_atlas_bench.packers.ppll.kernels.lists import Host, Lists
from shading_atlas_bench.packers.ppll.kernels.rows import NORMAL_WORDS

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic.arrays import Doubles
    from shading_atlas_bench.kernels.device import Device

HERE = Path(__file__).parent


def lens(projection: Doubles, width: int, height: int) -> Doubles:
    """float64 (4), of a projection float64 (4, 4): pixels per tangent along x and y, and the picture's centre in
    pixels."""
    half = np.array([width / 2, height / 2])
    scale = projection[[0, 1], [0, 1]] * half
    return np.concatenate([scale, (1 + np.array([-1, 1]) * projection[:2, 2]) * half])


def turning(old: Doubles, new: Doubles) -> Doubles:
    """float64 (4, 4): from one view's eye space to another's; the identity exactly where they are the same.

    old, new: float64 (4, 4), from the scene to each eye space.
    """
    return np.eye(4) if np.array_equal(old, new) else product(new, inverse(old))


def move_lists(device: Device, held: Lists, turn: Doubles, projection: Doubles, stage: str) -> Lists:
    """Lists in another eye space, each fragment in the pixel it then falls into.

    turn: float64 (4, 4), from the one eye space to the other. projection: float64 (4, 4), of the view they move to.
    Fragments that leave the picture are gone.
    """
    kernels, pixels, count = device.build(HERE / "match.cl"), held.pixels, held.count
    keys, pixel, earlier = (device.recycled(count, dtype) for dtype in (np.float32, np.int32, np.int32))
    counts = device.recycled(pixels + 1, np.int32)
    device.fill(counts, 0, stage)
    to = turn[:3].astype(np.float32)  # a float4 each
    seen = (lens(projection, held.width, held.height).astype(np.float32), held.width, held.height)
    results = (float(projection[2, 3]), keys, pixel, earlier, counts)
    device.launch(stage, kernels.move_fragments, count, count, held.rows, *to, *seen, *results)
    offsets, total = exclusive_scan(device, counts, pixels + 1, stage)
    numbers, rows = device.recycled(total, np.int32), device.recycled((total, NORMAL_WORDS), np.uint32)
    device.launch(stage, kernels.list_moved, count, count, pixel, earlier, offsets, numbers)
    device.launch(stage, kernels.sort_moved, pixels, pixels, offsets, numbers, keys, held.rows, *to, rows)
    return Lists(held.width, held.height, total, NORMAL_WORDS, offsets, rows)


def find_differences(device: Device, moved: Lists, fresh: Lists, share: float, tolerance: int, stage: str) -> Lists:
    """Per pixel, front to back, what must be removed from the moved fragments and inserted to give the new ones.

    A moved fragment is kept where a new one's distance differs by at most `share` of it and no channel of its colour by
    more than `tolerance`. A removal is a transparent fragment with the distance of what it removes.
    """
    kernels, pixels = device.build(HERE / "match.cl"), moved.pixels
    inputs = (pixels, moved.offsets, moved.rows, fresh.offsets, fresh.rows)
    entries, counts = device.recycled(moved.count + fresh.count, np.int32), device.recycled(pixels + 1, np.int32)
    device.fill(counts[pixels:], 0, stage)
    device.launch(stage, kernels.find_differences, pixels, *inputs, float(share), tolerance, entries, counts)
    offsets, total = exclusive_scan(device, counts, pixels + 1, stage)
    rows = device.recycled((total, NORMAL_WORDS), np.uint32)
    device.launch(stage, kernels.write_differences, pixels, *inputs, entries, offsets, rows)
    return Lists(moved.width, moved.height, total, NORMAL_WORDS, offsets, rows)


def merge_differences(device: Device, moved: Lists, changes: Lists, accepting: float | None, stage: str) -> Lists:
    """The moved fragments with the changes applied.

    accepting: None removes exactly what each removal means. A number removes the first fragment found within this share
    of the removal's distance: the thesis' merge, whose mistakes grow with it (figure 5.9).
    """
    kernels, pixels = device.build(HERE / "match.cl"), moved.pixels
    inputs = (pixels, moved.offsets, moved.rows, changes.offsets, changes.rows)
    stays: list[Array] = [device.recycled(lists.count, np.uint8) for lists in (moved, changes)]
    counts = device.recycled(pixels + 1, np.int32)
    device.fill(counts[pixels:], 0, stage)
    rule = (accepting is not None, float(accepting or 0))
    device.launch(stage, kernels.remove_fragments, pixels, *inputs, *rule, *stays, counts)
    offsets, total = exclusive_scan(device, counts, pixels + 1, stage)
    rows = device.recycled((total, NORMAL_WORDS), np.uint32)
    device.launch(stage, kernels.merge_fragments, pixels, *inputs, *stays, offsets, rows)
    return Lists(moved.width, moved.height, total, NORMAL_WORDS, offsets, rows)


def apply_differences(device: Device, moved: Lists, changes: Lists, fresh: Lists, stage: str) -> Lists:
    """What merge_differences gives exactly, of changes that find_differences found between `moved` and `fresh`.

    The sender knows from `fresh` how many fragments each pixel then has, so nothing is counted.
    """
    kernel, pixels = device.build(HERE / "match.cl").apply_differences, moved.pixels
    inputs = (pixels, moved.offsets, moved.rows, changes.offsets, changes.rows)
    stays = [device.recycled(lists.count, np.uint8) for lists in (moved, changes)]
    rows = device.recycled((fresh.count, NORMAL_WORDS), np.uint32)
    device.launch(stage, kernel, pixels, *inputs, *stays, fresh.offsets, rows)
    return Lists(moved.width, moved.height, fresh.count, NORMAL_WORDS, fresh.offsets, rows)


def move_twin(
    held: Host, turn: Doubles, projection: Doubles, width: int, height: int
) -> tuple[Doubles, Doubles, Doubles]:
    """Columns and rows in pixels and distances, float64 (n) each, of held fragments after moving.

    turn, projection: float64 (4, 4), as for `move_lists`.
    """
    x, y, z = np.ascontiguousarray(held[1][:, 2:]).view(np.float32).astype(np.float64).T
    eye = np.stack([x, y, -z, np.ones_like(z)], axis=1) @ turn.T
    clip = eye @ projection.T
    return (clip[:, 0] / clip[:, 3] + 1) * width / 2, (1 - clip[:, 1] / clip[:, 3]) * height / 2, -eye[:, 2]


def differences_twin(moved: Host, fresh: Host, share: float, tolerance: int) -> list[list[tuple[str, int]]]:
    """Per pixel what find_differences gives: ("remove", number of the moved) and ("insert", number of the new)."""
    away, near = (np.ascontiguousarray(rows[:, 4]).view(np.float32) for _, rows in (moved, fresh))
    colours = [np.ascontiguousarray(rows[:, :1]).view(np.uint8).astype(int) for _, rows in (moved, fresh)]
    found = []
    for pixel in range(len(moved[0]) - 1):
        i, j, entries = moved[0][pixel], fresh[0][pixel], []
        while i < moved[0][pixel + 1] or j < fresh[0][pixel + 1]:
            a = away[i] if i < moved[0][pixel + 1] else np.inf
            b = near[j] if j < fresh[0][pixel + 1] else np.inf
            together = np.isfinite(a) and np.isfinite(b) and abs(a - b) <= np.float32(share) * b
            alike = together and np.abs(colours[0][i] - colours[1][j]).max() <= tolerance
            if not alike and (together or a < b):
                entries.append(("remove", int(i)))
            if not alike and (together or not a < b):
                entries.append(("insert", int(j)))
            i, j = i + (together or a < b), j + (together or not a < b)
        found.append(entries)
    return found


def merge_twin(moved: Host, changes: Host, accepting: float | None) -> Host:
    """As merge_differences."""
    parts = []
    for pixel in range(len(moved[0]) - 1):
        old, new = (list(rows[offsets[pixel] : offsets[pixel + 1]]) for offsets, rows in (moved, changes))
        stay, inserted = list(old), []
        for row in new:
            if row[0] >> 24:
                inserted.append(row)
                continue
            far = row[4:5].view(np.float32)[0]
            slack = np.float32(accepting) * far if accepting is not None else 0
            candidates = [r for r in stay + (inserted if accepting is not None else [])]
            hit = next((r for r in candidates if abs(r[4:5].view(np.float32)[0] - far) <= slack), None)
            stay = [r for r in stay if r is not hit]
            inserted = [r for r in inserted if r is not hit]
        parts.append(sorted(stay + inserted, key=lambda r: r[4:5].view(np.float32)[0]))
    counts = [len(part) for part in parts]
    rows = [row for part in parts for row in part]
    return np.concatenate([[0], np.cumsum(counts)]), np.array(rows, np.uint32).reshape(-1, NORMAL_WORDS)
