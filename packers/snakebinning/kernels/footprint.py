"""The footprint of triangles on the client's screen, as a shape on their longest edge, and their bin (3.1 and 3.2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from shading_atlas_bench.arithmetic.matrices import matvec
from shading_atlas_bench.kernels.constants import constants_of
from shading_atlas_bench.packers.snakebinning.kernels.bins import (
    ANGLES,
    HEIGHTS,
    POINTS,
    UNIT,
    HeightBins,
    bin_of,
    edge_table,
    indices_of,
)
from shading_atlas_bench.packers.snakebinning.kernels.pieces import OUTSIDE

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic import arrays
    from shading_atlas_bench.arithmetic.arrays import Bools, Bytes, Doubles, Floats, Longs
    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.packers.snakebinning.kernels.pieces import SlicedScene, TriangleList

HERE = Path(__file__).parent

STAGE = "structs/footprint"
DEFINED = constants_of(HERE / "footprint.cl")
VIEW_FLOATS = DEFINED.whole("VIEW_FLOATS")
Roles: TypeAlias = tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]  # vertices a, b, c (n) in the twin
# Notes on a triangle.
MOVED_BACK = DEFINED.whole("MOVED_BACK")
SLENDER = DEFINED.whole("SLENDER")
CLIPPED = DEFINED.whole("CLIPPED")
KEPT = DEFINED.whole("KEPT")
POINT = DEFINED.whole("POINT")
FLATTEST = DEFINED.number("FLATTEST")  # cot 15 degrees, the largest cotangent of alpha that is drawn
OBTUSE = DEFINED.number("OBTUSE")  # cot 102.5 degrees: how far an angle of a kept triangle may pass 90 degrees
STEEPEST = DEFINED.number("STEEPEST")  # of the perspective's change per texel
REACH = DEFINED.number("REACH")  # texels beyond an edge that lookups inside touch, at most


@dataclass(frozen=True)
class Fit:
    """What shapes have to fit into.

    heights: bins of the height. longest: length of the longest edge, in texels. perspective: whether samples are
    placed perspective-correct. near_height, near_angle: hysteresis in bins; -1 for none. point: texels of the longest
    edge below which a triangle is drawn as one texel; 0 for none.
    """

    heights: HeightBins
    longest: float
    perspective: bool = True
    near_height: int = 30
    near_angle: int = 5
    point: float = 0.0

    def without_hysteresis(self) -> Fit:
        """The same for triangles that do not keep their bins."""
        return replace(self, near_height=-1, near_angle=-1)


@dataclass(frozen=True)
class Footprints:
    """Per triangle of the scene, on the device, kept from frame to frame.

    bins: int32 (T), -1 for one never measured. lengths: uint16 (T, 4): before and after the height's foot, and height,
    in 1/8 texel, zeros for a point. words: uint32 (T): inverse distances of vertices 0 to 2 as parts of 255 in bits 0,
    8 and 16; roles in bits 24 and 25 (the vertex with the angle alpha) and 26 (set if beta is at the vertex before it,
    not after).
    """

    bins: Array
    lengths: Array
    words: Array

    @classmethod
    def allocate(cls, device: Device, count: int) -> Footprints:
        """For a scene of `count` triangles, none of them measured."""
        bins = device.empty(count, np.int32)
        device.fill(bins, -1)
        return cls(bins, device.zeros((max(1, count), 4), np.uint16), device.zeros(count, np.uint32))


def pack_views(matrices: Sequence[tuple[Doubles, Doubles, int]], rate: float) -> Floats:
    """float32 (n, 16) for the kernel from (view, projection, width) each: eye in two parts, up, right, texels per unit
    of tangent (`rate` texels per pixel), inverse half-angle tangents across and up, near."""
    rows = np.zeros((len(matrices), VIEW_FLOATS), np.float32)
    for row, (view, projection, width) in zip(rows, matrices, strict=True):
        eye = -matvec(view[:3, :3].T, view[:3, 3])
        row[:3] = eye
        row[3:6] = eye - row[:3]
        row[6:9], row[9:12] = view[1, :3], view[0, :3]
        row[12:] = projection[0, 0] * width / 2 * rate, projection[0, 0], projection[1, 1], projection[2, 3]
    return rows


def measure_triangles(
    device: Device, listed: TriangleList, scene: SlicedScene, views: Floats, fit: Fit, state: Footprints
) -> tuple[Bytes, Floats]:
    """Measure the triangles listed in all views (see pack_views) and update `state`.

    Returns, on the host, notes uint8 (n) and areas in the atlas float32 (n), in texels.

    Of all views the one counts in which the triangle is largest, seen by a camera turned to its middle, and moved back
    until it is all on the screen. A triangle whose bin is within fit.near_height and fit.near_angle of its old one,
    measured with its old roles, keeps everything. Notes are MOVED_BACK, SLENDER (alpha below 15 degrees, drawn as 15),
    CLIPPED (larger than the atlas), KEPT, and POINT (no piece is one). A point's area is that of the triangle itself,
    and it stays one while its longest edge is shorter than 1.125 of fit.point.
    """
    count, triangles, pieces, heights = listed.count, scene.triangles, scene.pieces, fit.heights
    notes, areas = device.recycled(count, np.uint8), device.recycled(count, np.float32)
    corners = (listed.ids, triangles.positions, triangles.indices, pieces.first, pieces.rows)
    seen = (len(views), device.upload(views), device.upload(edge_table()))
    shapes = (heights.scale, int(heights.logarithmic), float(heights.highest), float(fit.longest), float(fit.point))
    rules = (int(fit.perspective), fit.near_height, fit.near_angle)
    written = (state.bins, state.lengths, state.words, notes, areas)
    kernel = device.build(HERE / "footprint.cl").measure_triangles
    device.launch(STAGE, kernel, -(-count // 8), count, *corners, *seen, *shapes, *rules, *written)
    return notes.get()[:count], areas.get()[:count]


@dataclass(frozen=True)
class Measured:
    """The twin's result.

    shape: (n, 3), before, after, height in texels, not rounded. roles: (n), as in the words of Footprints. weights:
    (n, 3), inverse distances as parts of 255. bins, notes: int (n).
    """

    shape: Doubles
    roles: NDArray[np.intp]
    weights: Doubles
    bins: arrays.Array
    notes: arrays.Array


def measure_triangles_twin(corners: arrays.Array, views: Floats, fit: Fit) -> Measured:
    """The same for triangles (n, 3, 3) without a past, in float64."""
    screen = _project(corners.astype(np.float64), views.astype(np.float64))
    x, y = screen.x, screen.y
    c = np.argmax([(x[:, [2, 0, 1]] - x[:, [1, 2, 0]]) ** 2 + (y[:, [2, 0, 1]] - y[:, [1, 2, 0]]) ** 2], axis=2)[0]
    rows = np.arange(len(c))
    i, j = (c + 1) % 3, (c + 2) % 3

    def squared(k: NDArray[np.intp], m: NDArray[np.intp]) -> Doubles:
        lengths: Doubles = (x[rows, k] - x[rows, m]) ** 2 + (y[rows, k] - y[rows, m]) ** 2
        return lengths

    turned = squared(c, i) > squared(c, j)
    a, b = np.where(turned, j, i), np.where(turned, i, j)
    raw = _shape(screen, (a, b, c))
    point = raw[:, 0] + raw[:, 1] < fit.point
    shape, notes = fitted_twin(raw, fit)
    weights = _weights(screen.w, (a, b, c), shape) if fit.perspective else np.full((len(c), 3), 255.0)
    shape[point], weights[point], notes[point] = 0, 255, POINT
    notes |= np.where(screen.back > 0, MOVED_BACK, 0)
    return Measured(shape, a + 4 * turned, weights, bins_twin(shape, fit), notes)


@dataclass(frozen=True)
class Screen:
    """Corners on the screen of a camera turned to their triangle: x, y in texels and distances w (n, 3), and how far
    back the camera went (n)."""

    x: Doubles
    y: Doubles
    w: Doubles
    back: Doubles

    @property
    def areas(self) -> Doubles:
        """Twice the triangles' areas (n)."""
        x, y = self.x, self.y
        areas: Doubles = np.abs((x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0]) - (y[:, 1] - y[:, 0]) * (x[:, 2] - x[:, 0]))
        return areas

    def where(self, better: Bools, other: Screen) -> Screen:
        """This where `better` (n), else the other."""
        rows = better[:, None]
        x, y, w = (np.where(rows, *pair) for pair in ((self.x, other.x), (self.y, other.y), (self.w, other.w)))
        return Screen(x, y, w, np.where(better, self.back, other.back))


def _project(corners: Doubles, views: Doubles) -> Screen:
    """The corners (n, 3, 3) of triangles in that of the views in which each is largest, of equals the first."""
    best = _seen(corners, views[0])
    for view in views[1:]:
        seen = _seen(corners, view)
        best = seen.where(seen.areas > best.areas, best)
    return best


def _seen(corners: Doubles, view: Doubles) -> Screen:
    p = corners - view[:3] - view[3:6]
    n = _unit(p.sum(axis=1), 0.0, np.cross(view[6:9], view[9:12]))
    across = _unit(np.cross(n, view[6:9]), 1e-3, view[9:12])
    upwards = np.cross(across, n)
    x, y, z = (np.einsum("nkc,nc->nk", p, axis) for axis in (across, upwards, n))
    further = np.maximum(np.maximum(np.abs(x) * view[13] - z, np.abs(y) * view[14] - z), view[15] - z)
    back = np.maximum(further.max(axis=1), 0)
    w = z + back[:, None]
    return Screen(x * view[12] / w, y * view[12] / w, w, back)


def _unit(a: Doubles, shortest: float, otherwise: Doubles) -> Doubles:
    length = np.linalg.norm(a, axis=1, keepdims=True)
    return np.where(length > shortest, a / np.where(length > shortest, length, 1), otherwise)


def _shape(screen: Screen, roles: Roles) -> Doubles:
    """Before, after, height (n, 3) over the edge from a to b."""
    x, y, (a, b, c) = screen.x, screen.y, roles
    rows = np.arange(len(a))
    edge = np.stack([x[rows, b] - x[rows, a], y[rows, b] - y[rows, a]], axis=1)
    side = np.stack([x[rows, c] - x[rows, a], y[rows, c] - y[rows, a]], axis=1)
    length = np.linalg.norm(edge, axis=1)
    safe = np.where(length > 0, length, 1)
    before = (edge * side).sum(axis=1) / safe
    height = np.abs(edge[:, 0] * side[:, 1] - edge[:, 1] * side[:, 0]) / safe
    return np.stack([before, length - before, height], axis=1)


def fitted_twin(shape: Doubles, fit: Fit) -> tuple[Doubles, arrays.Array]:
    """Shapes (n, 3) in texels as strips can hold them, and notes, int (n)."""
    before, after, height = shape.T
    highest, longest = fit.heights.highest, fit.longest
    clipped = height > highest
    scale = np.where(clipped, highest / np.maximum(height, 1e-30), 1)
    height = np.maximum(height * scale, 1)
    before, after = np.maximum(before * scale, 0), np.maximum(after * scale, 0)
    slender = before > FLATTEST * height
    before = np.minimum(before, FLATTEST * height)
    wide = before + after > longest
    before = np.where(wide, np.minimum(before, longest / 2), before)
    after = np.where(wide, np.minimum(after, longest - before), after)
    after = np.where(before + after < 1, 1 - before, after)
    notes = np.where(slender, SLENDER, 0) | np.where(clipped | wide, CLIPPED, 0)
    return np.stack([before, after, height], axis=1), notes


def bins_twin(shape: Doubles, fit: Fit) -> arrays.Array:
    """Bins, int (n), of fitted shapes (n, 3), of which points are zeros."""
    edges = edge_table().astype(np.float64)
    before, after, height = shape.T
    alpha = (before[:, None] < edges[: ANGLES - 1] * height[:, None]).sum(axis=1)
    beta = (after[:, None] < edges[32 : 32 + ANGLES - 1] * height[:, None]).sum(axis=1)
    safe = np.maximum(height, 1)
    steps = fit.heights.scale * (np.log2(safe) if fit.heights.logarithmic else safe - 1)
    bins = bin_of(alpha, beta, np.clip(np.ceil(steps).astype(np.int64), 0, HEIGHTS - 1))
    return np.where(height > 0, bins, POINTS)


def _weights(w: Doubles, roles: Roles, shape: Doubles) -> Doubles:
    """Limited inverse distances as parts of 255, (n, 3), not rounded."""
    a, b, c = roles
    rows = np.arange(len(a))
    q = np.maximum(w.min(axis=1, keepdims=True) / w, 1 / 255)
    mean = q.mean(axis=1, keepdims=True)
    before, after, height = shape.T
    for step in range(8):
        along = (q[rows, b] - q[rows, a]) / (before + after)
        across = (q[rows, c] - q[rows, a] - along * before) / height
        least, most = q.min(axis=1), q.max(axis=1)
        steep = (np.abs(along) + np.abs(across)) * most > STEEPEST * least**2
        steep |= REACH * most > (height + OUTSIDE) * least
        part = 0.0 if step == 7 else 0.7
        q = np.where(steep[:, None], mean + part * (q - mean), q)
    weights: Doubles = q * 255 / q.max(axis=1, keepdims=True)
    return weights


def near_twin(old: arrays.Array, new: arrays.Array, fit: Fit) -> Bools:
    """Whether bins `new` are within the hysteresis of bins `old`, int (n); no point among them."""
    if fit.near_height < 0:
        return np.zeros(len(old), bool)
    alpha, beta, height = (np.abs(n - o) for o, n in zip(indices_of(old), indices_of(new), strict=True))
    near: Bools = (alpha <= fit.near_angle) & (beta <= fit.near_angle) & (height <= fit.near_height)
    return near


def rounded_twin(shape: Doubles) -> Longs:
    """Lengths in 1/8 texel, int (n, 3), of fitted shapes; of points as they are."""
    before, after, height = np.floor(UNIT * shape + 0.5).astype(np.int64).T
    return np.stack([before, np.where((before + after < UNIT) & (height > 0), UNIT - before, after), height], axis=1)
