"""Shading samples of the triangles' slots (section 3.7)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.kernels.common.scan import exclusive_scan
from shading_atlas_bench.kernels.constants import constants_of
from shading_atlas_bench.kernels.samples import Samples
from shading_atlas_bench.packers.snakebinning.kernels.pieces import OUTSIDE
from shading_atlas_bench.packers.snakebinning.kernels.strip import ENLARGE, Lengths, SlotShape, lines_of, needed_columns

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic import arrays
    from shading_atlas_bench.arithmetic.arrays import Doubles, Longs
    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.packers.snakebinning.kernels.pieces import SlicedScene, TriangleList
    from shading_atlas_bench.packers.snakebinning.kernels.place import Placement

HERE = Path(__file__).parent

STAGE = "gather/emit"
RUNS = 512  # on a CPU
DEFINED = constants_of(HERE / "emit.cl")
POSITIVE = DEFINED.number("POSITIVE")  # share of the least inverse distance that the interpolated one stays above


@dataclass(frozen=True)
class Blowup:
    """By how much triangles are enlarged in their slots (sections 3.7 and 3.8).

    enlarge: "exact" or "paper", see needed_columns in strip.cl. full: to all texels of a slot, but for pieces, whose
    surroundings are other pieces.
    """

    enlarge: str = "exact"
    full: bool = False


def emit_samples(
    device: Device,
    listed: TriangleList,
    scene: SlicedScene,
    placement: Placement,
    blowup: Blowup,
    atlas_width: int,
    runs: int | None = None,
) -> Samples:
    """The samples of the triangles and pieces listed, in list order, each line by line from its longest edge.

    Samples of a piece name its parent, and lie in it. Shading continues beyond the edges, up to one height and two
    texels outside. A sample's footprint is the longer of the two ways on the surface from texel to texel. A point has
    one sample, in its middle, with steps as if it were one texel high and long.
    """
    kernels, count = device.build(HERE / "emit.cl"), listed.count
    places, strips = placement.places, placement.superblocks.strips
    lists, texels = _list_slots(device, strips, blowup.enlarge)
    run = max(1, -(-count // (runs or RUNS))) if device.is_cpu or runs else 1
    runs = -(-count // run)
    rules = (count, run, runs, int(blowup.full), ENLARGE[blowup.enlarge], scene.pieces.first)
    slots = (listed.ids, places.slots, places.places, places.drawn, strips, lists)
    local = 1 if device.is_cpu else None
    counts = device.recycled(runs, np.int32)
    device.launch(STAGE, kernels.count_samples, runs, *rules, *slots, counts, local=local)
    offsets, total = exclusive_scan(device, counts, runs, STAGE)
    s = Samples.allocate(device, total)
    corners = (scene.triangles.positions, scene.triangles.indices, scene.pieces.rows)
    shapes = (texels, placement.footprints.words, *corners, atlas_width, counts, offsets)
    written = (s.triangle, s.bary1, s.bary2, s.footprint, s.texel)
    device.launch(STAGE, kernels.emit_samples, runs, *rules, *slots, *shapes, *written, local=local)
    return s


def _list_slots(device: Device, strips: Array, enlarge: str) -> tuple[Array, Array]:
    """What the triangles of each strip share, int32 (strips, 4), and the texels of its slots, int32: see emit.cl."""
    kernels, count = device.build(HERE / "emit.cl"), len(strips)
    sizes = device.recycled(count, np.int32)
    device.launch(STAGE, kernels.size_slots, count, count, strips, sizes)
    offsets, total = exclusive_scan(device, sizes, count, STAGE)
    texels, lists, run = device.recycled(total + 8, np.int32), device.recycled((count, 4), np.int32), -(-count // RUNS)
    slots = (ENLARGE[enlarge], strips, sizes, offsets, texels, lists)
    device.launch(STAGE, kernels.list_slots, -(-count // run), count, run, *slots, local=1)
    return lists, texels


@dataclass(frozen=True)
class PlacedTriangle:
    """A triangle: its number, place, drawn lengths and word as in Places and Footprints, and its vertices (3, 3)."""

    number: int
    place: int
    drawn: arrays.Array
    word: int
    vertices: arrays.Array


def emit_twin(triangle: PlacedTriangle, slot: SlotShape, blowup: Blowup, atlas_width: int) -> dict[str, arrays.Array]:
    """The samples of one placed triangle, (m) each, by the names of Samples; floats are float64."""
    place, drawn = triangle.place, (int(triangle.drawn[0]), int(triangle.drawn[1]), int(triangle.drawn[2]))
    sign, foot = 1 - 2 * (place >> 29 & 1), 8 * slot.inset + slot.before8
    origin, row = ((place & 0xFFFF) - sign * foot) // 8, place >> 16 & 0x1FFF
    column, line = _texels(slot, drawn, blowup)
    if drawn[2] > 0:
        x, y, shape = column - foot / 8, line.astype(np.float64), np.array(drawn) / 8
    else:
        x, y, shape = np.array([1 / 3]), np.array([1 / 3]), np.array([0.0, 1.0, 1.0])
    bary, footprint = _surface(x, y, shape, triangle)
    return {
        "triangle": np.full(len(column), triangle.number),
        "bary1": bary[:, 1],
        "bary2": bary[:, 2],
        "footprint": footprint,
        "texel": (row + sign * line) * atlas_width + origin + sign * column,
    }


def _texels(slot: SlotShape, drawn: Lengths, blowup: Blowup) -> tuple[Longs, Longs]:
    """Columns and lines of the texels of a slot that a triangle of some lengths in 1/8 texel has, line by line."""
    columns: list[int] = []
    lines: list[int] = []
    for line in range(slot.lines if blowup.full else lines_of(drawn[2])):
        first, last = needed_columns(slot.before8, slot.lengths, slot.inset, line, blowup.enlarge)
        if not blowup.full:
            needed = needed_columns(slot.before8, drawn, slot.inset, line, blowup.enlarge)
            first, last = max(first, needed[0]), min(last, needed[1])
        columns += range(first, last + 1)
        lines += [line] * max(0, last + 1 - first)
    return np.array(columns, np.int64), np.array(lines, np.int64)


def _surface(x: arrays.Array, y: arrays.Array, shape: Doubles, triangle: PlacedTriangle) -> tuple[Doubles, Doubles]:
    """Object-space barycentrics (n, 3) and footprints (n) at texels x (from the tip), y of a triangle's plane."""
    before, after, height = shape
    word, corners = triangle.word, triangle.vertices
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
