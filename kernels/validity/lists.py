"""Whether fragment lists are sound, and whether what is nearest in each pixel is the nearest surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Bools, Bytes, Floats, Ints, Longs

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device

RUN = 64  # pixels per item


@dataclass(frozen=True)
class WalkedLists:
    """nearest: float32 (pixels), on the device: the depth of each pixel's first visible fragment, or 0. visible: how
    many fragments are. broken: lists that end before they begin or beyond the fragments, and visible fragments without
    a depth, or before a nearer one."""

    nearest: Array
    visible: int
    broken: int


def walk_lists(device: Device, offsets: Longs, rgba: Bytes, depth: Floats, stage: str) -> WalkedLists:
    """Lists on the host, as HeldLists has them: offsets (pixels + 1), rgba (n, 4), depth (n)."""
    pixels = len(offsets) - 1
    nearest, counts = device.recycled(pixels, np.float32), device.zeros(2, np.int32)
    lists = (
        device.lent(np.asarray(offsets, np.int64)),
        device.lent(np.asarray(rgba, np.uint8)),
        device.lent(np.asarray(depth, np.float32)),
    )
    kernel = device.build("validity/lists.cl", RUN=RUN).walk_lists
    device.launch(stage, kernel, -(-pixels // RUN), pixels, len(depth), *lists, nearest, counts)
    visible, broken = counts.get().tolist()
    return WalkedLists(nearest, visible, broken)


def walk_lists_twin(offsets: Longs, rgba: Bytes, depth: Floats) -> tuple[Floats, int, int]:
    """The same: `nearest`, on the host, `visible` and `broken`; offsets (pixels + 1), rgba (n, 4), depth (n)."""
    nearest = np.zeros(len(offsets) - 1, np.float32)
    visible = broken = 0
    for pixel, (first, last) in enumerate(zip(offsets[:-1].tolist(), offsets[1:].tolist(), strict=True)):
        if not 0 <= first <= last <= len(depth):
            broken += 1
            continue
        depths = depth[first:last][rgba[first:last, 3] > 0]
        visible += len(depths)
        broken += int((~(np.isfinite(depths) & (depths > 0))).sum() + (depths[1:] > depths[:-1]).sum())
        nearest[pixel] = depths[0] if len(depths) else 0
    return nearest, visible, broken


@dataclass(frozen=True)
class Surfaces:
    """What is nearest in each pixel of a view, on the device: depth float32 (pixels), near plane over distance;
    triangle int32 (pixels), negative where there is nothing."""

    depth: Array
    triangle: Array


def compare_nearest(
    device: Device, surfaces: Surfaces, known: Bools, owned: Bools, nearest: Array, tolerance: float, stage: str
) -> int:
    """In how many pixels the nearest fragment lies over the tolerance, relative, from the nearest surface.

    known: bool (T), triangles that count. owned: bool (pixels), those that do. nearest: float32 (pixels).
    """
    pixels, counts = len(owned), device.zeros(1, np.int32)
    flags = device.lent(known), device.lent(owned)
    kernel = device.build("validity/lists.cl", RUN=RUN).compare_nearest
    arrays = (surfaces.depth, surfaces.triangle, *flags, nearest, counts)
    device.launch(stage, kernel, -(-pixels // RUN), pixels, tolerance, *arrays)
    wrong: int = counts.get().tolist()[0]
    return wrong


def compare_nearest_twin(
    depth: Floats, triangle: Ints, known: Bools, owned: Bools, nearest: Floats, tolerance: float
) -> Bools:
    """Which pixels these are, bool (pixels); depth, triangle and nearest (pixels) each, known (T), owned (pixels)."""
    with np.errstate(invalid="ignore"):
        off = np.abs(nearest - depth) > np.float32(tolerance) * depth
    counted: Bools = owned & (triangle >= 0) & known[np.maximum(triangle, 0)] & off
    return counted
