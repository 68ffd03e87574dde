"""Shading samples of the triangles' slots (section 3.7)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.kernels.common.scan import exclusive_scan
from shading_atlas_bench.kernels.samples import Samples
from shading_atlas_bench.packers.snakebinning.kernels.strip import ENLARGE, lines_of, needed_columns

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.kernels.triangles import Triangles
    from shading_atlas_bench.packers.snakebinning.kernels.footprint import Footprints, Pieces
    from shading_atlas_bench.packers.snakebinning.kernels.place import Places

HERE = Path(__file__).parent

STAGE = "gather/emit"
RUNS = 512  # on a CPU
OUTSIDE = 1.9  # texels that barycentrics may lie further outside than one height
POSITIVE = 0.35  # share of the least inverse distance that the interpolated one stays above


def emit_samples(
    device: Device,
    triangles: Array,
    count: int,
    places: Places,
    strips: Array,
    footprints: Footprints,
    scene: Triangles,
    pieces: Pieces,
    atlas_width: int,
    full: bool,
    enlarge: str,
    runs: int | None = None,
) -> Samples:
    """The samples of `count` triangles or pieces, int32, in list order, each line by line from its longest edge.

    Samples of a piece name its parent, and lie in it. pieces: number of the first, and pieces (see Slices.upload).

    full: all texels of a slot, but for pieces, whose surroundings are other pieces; else, and for those, what the
    triangle needs (see needed_columns in strip.cl). Shading continues beyond the edges, up to one height and two texels
    outside. A sample's footprint is the longer of the two ways on the surface from texel to texel. A point has one
    sample, in its middle, with steps as if it were one texel high and long.
    """
    kernels = device.build(HERE / "emit.cl")
    lists, texels = _list_slots(device, strips, enlarge)
    run = max(1, -(-count // (runs or RUNS))) if device.is_cpu or runs else 1
    runs = -(-count // run)
    listed = (
        count,
        run,
        runs,
        int(full),
        ENLARGE[enlarge],
        pieces[0],
        triangles,
        places.slots,
        places.places,
        places.drawn,
        strips,
        lists,
    )
    local = 1 if device.is_cpu else None
    counts = device.recycled(runs, np.int32)
    device.launch(STAGE, kernels.count_samples, runs, *listed, counts, local=local)
    offsets, total = exclusive_scan(device, counts, runs, STAGE)
    s = Samples.allocate(device, total)
    known = (texels, footprints.words, scene.positions, scene.indices, pieces[1], atlas_width, counts, offsets)
    arrays = (s.triangle, s.bary1, s.bary2, s.footprint, s.texel)
    device.launch(STAGE, kernels.emit_samples, runs, *listed, *known, *arrays, local=local)
    return s


def _list_slots(device: Device, strips: Array, enlarge: str) -> tuple[Array, Array]:
    """What the triangles of each strip share, int32 (strips, 4), and the texels of its slots, int32: see emit.cl."""
    kernels, count = device.build(HERE / "emit.cl"), len(strips)
    sizes = device.recycled(count, np.int32)
    device.launch(STAGE, kernels.size_slots, count, count, strips, sizes)
    offsets, total = exclusive_scan(device, sizes, count, STAGE)
    texels, lists, run = device.recycled(total + 8, np.int32), device.recycled((count, 4), np.int32), -(-count // RUNS)
    known = (ENLARGE[enlarge], strips, sizes, offsets, texels, lists)
    device.launch(STAGE, kernels.list_slots, -(-count // run), count, run, *known, local=1)
    return lists, texels


def emit_twin(
    triangle: int,
    place: int,
    drawn: np.ndarray,
    word: int,
    strip: dict[str, int],
    corners: np.ndarray,
    atlas_width: int,
    full: bool,
    enlarge: str,
) -> dict[str, np.ndarray]:
    """The samples of one placed triangle, float64, by the names of Samples; corners (3, 3) are its vertices."""
    before, after, height = (int(value) for value in drawn[:3])
    turned = place >> 29 & 1
    sign, foot = 1 - 2 * turned, 8 * strip["inset"] + strip["before8"]
    origin, row = ((place & 0xFFFF) - sign * foot) // 8, place >> 16 & 0x1FFF
    largest = (strip["before8"], strip["before8"], strip["after8"], strip["height8"], strip["inset"])
    own = (strip["before8"], before, after, height, strip["inset"])
    column, line = [], []
    for y in range(strip["lines"] if full else lines_of(height)):
        first, last = needed_columns(*largest, y, enlarge)
        if not full:
            needed = needed_columns(*own, y, enlarge)
            first, last = max(first, needed[0]), min(last, needed[1])
        column += range(first, last + 1)
        line += [y] * max(0, last + 1 - first)
    column, line = np.array(column, np.int64), np.array(line, np.int64)
    x, y, shape = column - foot / 8, line, np.array([before, after, height]) / 8
    if height == 0:
        x, y, shape = np.array([1 / 3]), np.array([1 / 3]), np.array([0, 1, 1])
    bary, footprint = _surface(x, y, shape, word, corners)
    return {
        "triangle": np.full(len(column), triangle),
        "bary1": bary[:, 1],
        "bary2": bary[:, 2],
        "footprint": footprint,
        "texel": (row + sign * line) * atlas_width + origin + sign * column,
    }


def _surface(
    x: np.ndarray, y: np.ndarray, shape: np.ndarray, word: int, corners: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Object-space barycentrics (n, 3) and footprints (n) at texels x (from the tip), y of a triangle's plane."""
    before, after, height = shape
    a, turned = word >> 24 & 3, word >> 26 & 1
    order = [a, (a + 1 + turned) % 3, (a + 2 - turned) % 3]
    corner = np.array([[-before, 0, 1], [after, 0, 1], [0, height, 1]])
    plane = np.linalg.inv(corner).T  # rows: weight of each corner as across x + down y + at
    plane[order] = plane.copy()
    q = np.array([word >> shift & 255 for shift in (0, 8, 16)]) / 255
    mu = plane @ np.stack([x, y, np.ones_like(x, float)])
    lowest_q, centre = POSITIVE * q.min(), q.mean()
    beyond = q @ mu < lowest_q
    part = np.where(beyond, (centre - lowest_q) / np.where(beyond, centre - q @ mu, 1), 1)
    mu = 1 / 3 + part * (mu - 1 / 3)
    total = q @ mu
    bary = mu * q[:, None] / total
    edges = np.stack([corners[1] - corners[0], corners[2] - corners[0]]).astype(np.float64)
    ways = []
    for axis in (0, 1):
        change = (plane[1:, axis, None] * q[1:, None] - bary[1:] * (q @ plane[:, axis])) / total
        ways.append(np.linalg.norm(change.T @ edges, axis=1))
    heights = np.empty(3)
    heights[order] = (
        (before + after) * height / np.array([np.hypot(height, after), np.hypot(height, before), before + after])
    )
    lowest = -1 - OUTSIDE / np.maximum(heights, 1)
    with np.errstate(divide="ignore"):
        shrink = np.where(bary < lowest[:, None], (1 / 3 - lowest[:, None]) / (1 / 3 - bary), 1).min(axis=0)
    return (1 / 3 + shrink * (bary - 1 / 3)).T, np.maximum(*ways)
