"""The shading samples of allocated blocks: which texels, on which triangle, where on it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.kernels.common.scan import exclusive_scan
from shading_atlas_bench.kernels.samples import Samples
from shading_atlas_bench.packers.sas.kernels.bias import levels_at
from shading_atlas_bench.packers.sas.kernels.layout import (
    POINTS,
    ROLE_WEIGHTS,
    corner_points,
    pack_location,
    unpack_location,
)

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.kernels.triangles import Triangles
    from shading_atlas_bench.packers.sas.kernels.inputs import Soup

HERE = Path(__file__).parent

STAGE, BUDGET = "gather/emit", "structs/budget"
RUNS = 512  # on a CPU: patches differ in size by 65536, so more runs than cores by far


# For each code a1, b1, c1, a2, b2, c2, 0, 0: barycentric k of a triangle is ak + bk u + ck v.
CODE_WEIGHTS = np.zeros((15, 8), np.float32)
CODE_WEIGHTS[:, :6] = ROLE_WEIGHTS[
    np.arange(15)[:, None] // 3, (np.arange(1, 3) - np.arange(15)[:, None] % 3) % 3
].reshape(15, 6)


@dataclass(frozen=True)
class Unfolded:
    """What emitting needs of a scene's patches, on the device.

    members: int32 (P, 3). codes: uint8 (T), roles and rotations. weights: float32 (15, 8), CODE_WEIGHTS. ways: float32
    (T, 2), the ways on each triangle's surface along u and along v from one side of the patch to the other.
    """

    members: Array
    codes: Array
    weights: Array
    ways: Array

    @classmethod
    def measure(cls, device: Device, members: Array, codes: Array, triangles: Triangles) -> Unfolded:
        """Upload the weights and measure the ways."""
        weights, ways = device.upload(CODE_WEIGHTS), device.empty((triangles.count, 2), np.float32)
        arrays = (codes, weights, triangles.indices, triangles.positions, ways)
        device.launch(
            "prepare/ways", device.build(HERE / "emit.cl").texel_derivatives, triangles.count, triangles.count, *arrays
        )
        return cls(members, codes, weights, ways)


def emit_samples(
    device: Device,
    patches: Array,
    masks: Array,
    count: int,
    words: Array,
    unfolded: Unfolded,
    atlas_width: int,
    complete: bool,
    runs: int | None = None,
) -> tuple[Samples, int]:
    """The samples of the blocks of `count` patches, in the order of patches, rows and columns; and how many triangles
    in the set have a block, but own no texel of it.

    patches: int32 (count). masks: uint8 (count), bit k for member k in the set. words: uint32 (P), locations.
    Of each block the texels that bilinear lookups inside the triangles in the set touch, row by row from the first to
    the last such column; all of it where `complete`. A texel belongs to the patch's triangle that it lies in, or that
    continues there. Its barycentrics follow from the half-texel inset: corners lie at the centres of the corner texels;
    along a side of one texel the middle stands for all. The footprint is the longer of the two ways on the surface
    between neighbouring texels.
    """
    run, runs = _runs(device, count, runs)
    listed = (count, run, runs, int(complete), patches, masks, unfolded.members, words)
    counts, without = _counted(device, listed, STAGE)
    offsets, total = exclusive_scan(device, counts, runs, STAGE)
    bare = int(without.get()[0])
    s = Samples.allocate(device, total)
    kernels, local = device.build(HERE / "emit.cl"), 1 if device.is_cpu else None
    known = (unfolded.codes, unfolded.weights, unfolded.ways, atlas_width, counts, offsets)
    arrays = (s.triangle, s.bary1, s.bary2, s.footprint, s.texel)
    device.launch(STAGE, kernels.emit_samples, runs, *listed, *known, *arrays, local=local)
    return s, bare


def _runs(device: Device, count: int, runs: int | None = None) -> tuple[int, int]:
    """How many patches one work-item goes through, and how many work-items that are."""
    run = max(1, -(-count // (runs or RUNS))) if device.is_cpu or runs else 1
    return run, -(-count // run)


def _counted(device: Device, listed: tuple, stage: str) -> tuple[Array, Array]:
    """Samples of each run, and the number of triangles without a texel."""
    counts, without = device.empty(listed[2], np.int32), device.empty(1, np.int32)
    device.fill(without, 0, stage)
    kernel, local = device.build(HERE / "emit.cl").count_samples, 1 if device.is_cpu else None
    device.launch(stage, kernel, listed[2], *listed, counts, without, local=local)
    return counts, without


def count_asked(
    device: Device,
    patches: Array,
    masks: Array,
    count: int,
    sizes: Array,
    bias: int,
    top: int,
    patch_count: int,
    members: Array,
    complete: bool,
) -> int:
    """The samples that `count` patches of the scene's `patch_count` have in blocks as large as they ask for.

    sizes: as from `measure_sides`. bias: in eighths. top: log2 of a superblock's side. The rest as in `emit_samples`.
    """
    words = device.recycled(patch_count, np.uint32)
    device.launch(BUDGET, device.build(HERE / "emit.cl").ask_in_corner, count, count, patches, sizes, bias, top, words)
    run, runs = _runs(device, count)
    counts, _ = _counted(device, (count, run, runs, int(complete), patches, masks, members, words), BUDGET)
    return exclusive_scan(device, counts, runs, BUDGET)[1]


def count_asked_twin(masks: np.ndarray, sizes: np.ndarray, bias: int, top: int, soup: Soup) -> int:
    """The same for patches 0, 1, ... of which `masks` and `sizes` are."""
    zeros, patches = np.zeros(len(sizes), np.int64), np.arange(len(sizes))
    words = pack_location(zeros, zeros, levels_at(sizes & 0xFF, bias, top), levels_at(sizes >> 8, bias, top))
    arrays = (soup.members, soup.codes, soup.indices, soup.positions)
    return len(emit_samples_twin(patches, masks, words, *arrays, 1, False)["texel"])


def without_texel_twin(
    patches: np.ndarray, masks: np.ndarray, words: np.ndarray, members: np.ndarray, triangle: np.ndarray
) -> int:
    """Triangles in the set with a block of which they own no texel, from the triangles of all samples."""
    placed = (masks[:, None] >> np.arange(3) & 1 > 0) & (words[patches] > 0)[:, None]
    return int((~np.isin(members[patches][placed], triangle)).sum())


def emit_samples_twin(
    patches: np.ndarray,
    masks: np.ndarray,
    words: np.ndarray,
    members: np.ndarray,
    codes: np.ndarray,
    indices: np.ndarray,
    positions: np.ndarray,
    atlas_width: int,
    complete: bool,
) -> dict[str, np.ndarray]:
    """The samples by the names of Samples, float64."""
    blocks = []
    for patch, mask in zip(patches, masks, strict=True):
        if words[patch]:
            own = members[patch][members[patch] >= 0]
            corners = positions[indices[own]].astype(np.float64)
            blocks.append(_emit_block(words[patch], 7 if complete else mask, own, codes[own], corners, atlas_width))
    names = ("triangle", "bary1", "bary2", "footprint", "texel")
    return {name: np.concatenate([block[name] for block in blocks]) if blocks else np.empty(0) for name in names}


def _emit_block(
    word: np.uint32, mask: int, members: np.ndarray, codes: np.ndarray, corners: np.ndarray, atlas_width: int
) -> dict[str, np.ndarray]:
    """The samples of one block; members (1 to 3) are triangles, codes and corners (3, 3) one of each per member."""
    x0, y0, w, h = (int(value[0]) for value in unpack_location(np.array([word])))
    w, h = 1 << w, 1 << h
    column, row = (grid.reshape(-1) for grid in np.meshgrid(np.arange(w), np.arange(h)))
    if mask != 7:
        kept = _touched(w, h, mask, codes)
        column, row = column[kept], row[kept]
    u = column / (w - 1) if w > 1 else np.full(len(column), 0.5)
    v = row / (h - 1) if h > 1 else np.full(len(row), 0.5)
    if len(members) == 1 and w == h == 1:  # the middle of the triangle, not of its rectangle
        u, v = np.full(1, 1 / 3), np.full(1, 1 / 3)
    elif len(members) == 1 and w == 1:
        u = (1 - v) / 2
    elif len(members) == 1 and h == 1:
        v = (1 - u) / 2
    owner = _owner(u, v, len(members), mask)
    weights = [ROLE_WEIGHTS[code // 3][(np.arange(3) - code % 3) % 3] for code in codes.astype(int)]
    basis = np.stack([np.ones_like(u), u, v])
    bary = np.stack([weight @ basis for weight in weights])[owner, :, np.arange(len(u))]
    sides = [weight[:, 1:].T @ corner for weight, corner in zip(weights, corners, strict=True)]
    sizes = [np.linalg.norm(side, axis=1) / [max(w - 1, 1), max(h - 1, 1)] for side in sides]
    return {
        "triangle": members[owner],
        "bary1": bary[:, 1],
        "bary2": bary[:, 2],
        "footprint": np.array([size.max() for size in sizes])[owner],
        "texel": (y0 + row) * atlas_width + x0 + column,
    }


def _owner(u: np.ndarray, v: np.ndarray, members: int, mask: int) -> np.ndarray:
    """Slot of the triangle that owns each position; on a shared edge the first, if it is in the set."""
    margin = 1e-9 if mask & 1 else -1e-9
    owner = np.zeros(len(u), np.int64)
    if members == 2:
        owner[u + v - 1 > margin] = 1
    if members == 3:
        owner[2 * u - v - 1 > margin] = 1
        owner[1 - 2 * u - v > margin] = 2
    return owner


def _touched(w: int, h: int, mask: int, codes: np.ndarray) -> np.ndarray:
    """bool (h * w): columns of each row between the first and last that lookups inside the triangles in `mask` touch.

    A lookup touches the texels less than one away in both directions; a triangle comes that near a texel if, cut by the
    two rows around it, it has a width that comes that near.
    """
    touched = np.zeros((h, w), bool)
    for slot, code in enumerate(codes):
        if not mask >> slot & 1:
            continue
        corners = POINTS[corner_points(np.array([code]))[0]] * [w - 1, h - 1]
        for row in range(h):
            low, high = _extent(corners, row - 1, row + 1)
            column = np.arange(w)
            touched[row] |= (column > low - 1 + 1e-9) & (column < high + 1 - 1e-9)
    filled = np.maximum.accumulate(touched, axis=1) & np.maximum.accumulate(touched[:, ::-1], axis=1)[:, ::-1]
    return filled.reshape(-1)


def _extent(corners: np.ndarray, above: float, below: float) -> tuple[float, float]:
    """Lowest and highest x of a triangle (3, 2) between two rows."""
    found = [x for x, y in corners if above <= y <= below]
    for k in range(3):
        (x0, y0), (x1, y1) = corners[k], corners[(k + 1) % 3]
        for y in (above, below):
            if y0 != y1 and min(y0, y1) <= y <= max(y0, y1):
                found.append(x0 + (x1 - x0) * (y - y0) / (y1 - y0))
    return (min(found), max(found)) if found else (np.inf, -np.inf)
