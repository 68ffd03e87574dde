"""Slices: triangles that dominate the screen, cut along the view's frustum into pieces (section 3.1).

A piece is a triangle in the plane of its parent, numbered from the scene's number of triangles on. On the host, because
there are a handful of them at most.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from shading_atlas_bench.arithmetic.matrices import dot, product, transform
from shading_atlas_bench.packers.snakebinning.kernels.corners import locate_corners_twin
from shading_atlas_bench.packers.snakebinning.kernels.pieces import PIECE_FLOATS, Pieces

if TYPE_CHECKING:
    from shading_atlas_bench.arithmetic import arrays
    from shading_atlas_bench.arithmetic.arrays import Bools, Doubles, Ints
    from shading_atlas_bench.kernels.device import Device

MOST = 256  # pieces in a frame
WIDER = 1.15
LEAST = 1 / 16  # weight: float32 barycentrics tell the corners of pieces apart that round by less


@dataclass(frozen=True)
class Slices:
    """Pieces of sliced triangles; those of one parent follow one another.

    parents: int32 (k). corners: float64 (k, 3, 3). bary: float64 (k, 3, 3), the corners' barycentrics in the parent.
    inside: bool (k), whether the piece lies inside the frustum.
    """

    parents: Ints = field(default_factory=lambda: np.empty(0, np.int32))
    corners: Doubles = field(default_factory=lambda: np.empty((0, 3, 3)))
    bary: Doubles = field(default_factory=lambda: np.empty((0, 3, 3)))
    inside: Bools = field(default_factory=lambda: np.empty(0, bool))

    def upload(self, device: Device, first: int) -> Pieces:
        """For the kernels, numbered from `first` on."""
        rows = np.zeros((MOST, PIECE_FLOATS), np.float32)
        count = len(self.parents)
        rows[:count, :9] = self.corners.reshape(count, 9)
        rows[:count, 9:15] = self.bary[:, :, 1:].reshape(count, 6)
        rows[:count, 15] = self.parents.astype(np.int32).view(np.float32)
        return Pieces(first, device.upload(rows))


def side_planes(matrix: Doubles, margin: float = 0.0) -> Doubles:
    """The four sides of a frustum, float64 (4, 4), positive inside, `margin` further out; matrix: projection @ view."""
    planes = np.stack([matrix[3] + matrix[0], matrix[3] - matrix[0], matrix[3] + matrix[1], matrix[3] - matrix[1]])
    planes /= np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
    planes[:, 3] += margin
    return planes


def split_polygon(polygon: Doubles, distances: Doubles) -> tuple[Doubles, Doubles]:
    """The parts of a convex polygon, rows (n, 3), where linear `distances` (n) are positive, and where they are not."""
    kept: list[Doubles] = []
    rest: list[Doubles] = []
    for i in range(len(polygon)):
        j = (i + 1) % len(polygon)
        (kept if distances[i] > 0 else rest).append(polygon[i])
        if (distances[i] > 0) != (distances[j] > 0):
            # From the positive end, so that both neighbours of an edge get the same point.
            a, b = (i, j) if distances[i] > 0 else (j, i)
            point = polygon[a] + distances[a] / (distances[a] - distances[b]) * (polygon[b] - polygon[a])
            kept.append(point)
            rest.append(point)
    return np.array(kept).reshape(-1, 3), np.array(rest).reshape(-1, 3)


def _distances(polygon: Doubles, corners: Doubles, plane: Doubles) -> Doubles:
    """Of the points with barycentrics `polygon` (n, 3) in a triangle from a plane."""
    return dot(polygon, dot(corners, plane[:3]) + plane[3])


def cut(corners: Doubles, matrix: Doubles, margin: float) -> tuple[list[Doubles], list[Doubles]]:
    """Barycentrics (n, 3, 3) of pieces of a triangle, corners (3, 3): inside a frustum `margin` wider than that of
    `matrix`, cut along its two middle planes, so that each fits a screen of its own; and outside."""
    inside: list[Doubles] = [np.eye(3)]
    outside: list[Doubles] = []
    for plane in side_planes(matrix, margin):
        parts = [split_polygon(p, _distances(p, corners, plane)) for p in inside]
        inside = [kept for kept, _ in parts if len(kept) > 2]
        outside += [rest for _, rest in parts if len(rest) > 2]
    for plane in (matrix[0], matrix[1]):
        halves = [half for p in inside for half in split_polygon(p, _distances(p, corners, plane))]
        inside = [half for half in halves if len(half) > 2]
    return _fans(inside), _fans(outside)


def _fans(polygons: list[Doubles]) -> list[Doubles]:
    pieces = [polygon[[0, i, i + 1]] for polygon in polygons for i in range(1, len(polygon) - 1)]
    return [piece for piece in pieces if np.abs(weight_steps(piece[None])).sum(axis=2).max() <= LEAST]


def weight_steps(bary: Doubles) -> Doubles:
    """By how much the weights of a piece's corners change where barycentrics 1 and 2 in its parent are rounded to
    float32: float64 (k, 3, 2), for one and the other, infinite for a piece without area. bary: (k, 3, 3), those of
    the corners of k pieces."""
    corner = bary[:, :, 1:]
    along = corner[:, [2, 0, 1]] - corner[:, [1, 2, 0]]  # of the edges opposite the corners
    turned = np.stack([-along[..., 1], along[..., 0]], axis=-1)
    area = (turned[:, 0] * along[:, 1]).sum(axis=1)
    rounding = np.spacing(np.abs(corner).max(axis=1).astype(np.float32)) / 2
    with np.errstate(divide="ignore", invalid="ignore"):
        steps = turned * rounding[:, None].astype(np.float64) / area[:, None, None]
    return np.where((area == 0)[:, None, None], np.inf, steps)


def texel_steps(bary: Doubles, lengths: arrays.Array, words: arrays.Array) -> Doubles:
    """By how many texels of the atlas that rounding moves a sample of each of k pieces, in the worse direction and at
    the worst of its corners: float64 (k). bary: float64 (k, 3, 3), see Slices. lengths, words: of the pieces, as in
    Footprints."""
    place = locate_corners_twin(np.ones(len(bary), np.uint32), lengths, words)  # anywhere
    w = place[..., 2]
    at = place[..., :2] / w[..., None]
    # The derivative of sum(lambda x w) / sum(lambda w) by a weight, at each corner.
    moved = (at[:, :, None] - at[:, None]) * (w[:, :, None] / w[:, None])[..., None]
    steps = product(moved.transpose(0, 2, 3, 1), weight_steps(bary)[:, None])
    worst: Doubles = np.abs(steps).sum(axis=3).max(axis=(1, 2), initial=0)
    return worst


def screen_shares(corners: Doubles, matrix: Doubles) -> Doubles:
    """Shares of a view's picture, `matrix` = projection @ view, that triangles, corners (n, 3, 3), cover if nothing
    hides them: float64 (n)."""
    points, count = transform(matrix, corners)[..., [0, 1, 3]], np.full(len(corners), 3)
    for axis, sign in ((0, 1), (0, -1), (1, 1), (1, -1)):
        points, count = _clip(points, count, points[..., 2] + sign * points[..., axis])
    w = np.where(np.arange(points.shape[1]) < count[:, None], points[..., 2], np.inf)
    at = points[..., :2] / np.where((w > 0) & (w < np.inf), w, 1)[..., None]
    at = np.where(np.isinf(w)[..., None], at[:, :1], at)  # beyond the last corner the first again, which adds nothing
    x, y = at[..., 0], at[..., 1]
    area = np.abs((x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)).sum(axis=1)) / 8
    return np.where(count < 3, 0.0, np.where((w > 0).all(axis=1), area, 1.0))  # or it reaches the eye


def _clip(points: Doubles, count: NDArray[np.intp], distances: Doubles) -> tuple[Doubles, NDArray[np.intp]]:
    """The parts of convex polygons, of `count` (n) corners each, points (n, m, 3), where linear `distances` (n, m) are
    positive: points (n, m + 1, 3), and how many count."""
    most = points.shape[1]
    corner = np.arange(most)
    used, after = corner < count[:, None], np.where(corner + 1 < count[:, None], corner + 1, 0)
    further = np.take_along_axis(distances, after, axis=1)
    crosses = used & ((distances > 0) != (further > 0))
    part = distances / np.where(crosses, distances - further, 1)
    between = points + part[..., None] * (np.take_along_axis(points, after[..., None], axis=1) - points)
    valid = np.stack([used & (distances > 0), crosses], axis=2).reshape(-1, 2 * most)
    found = np.stack([points, between], axis=2).reshape(-1, 2 * most, 3)
    first = np.argsort(~valid, axis=1, kind="stable")[:, : most + 1]
    return np.take_along_axis(found, first[..., None], axis=1), valid.sum(axis=1)


def slice_dominating(
    ids: arrays.Array, corners: Doubles, clients: list[Doubles], server: Doubles, margin: float, share: float
) -> Slices:
    """Slices of those triangles, ids (n) and corners float64 (n, 3, 3), that cover at least `share` of the picture of
    one of the client views, given as projection @ view, float64 (4, 4), like `server`.

    They are cut along the frustum of `server`, WIDER in tangents and `margin` further out, so that views may turn and
    move a little before they see a piece outside.
    """
    server = server * np.array([1 / WIDER, 1 / WIDER, 1, 1])[:, None]
    parents: list[int] = []
    places: list[Doubles] = []
    bary: list[Doubles] = []
    inside: list[bool] = []
    dominating = np.flatnonzero(np.max([screen_shares(corners, client) for client in clients], axis=0) >= share)
    for triangle, triangle_corners in zip(ids[dominating], corners[dominating], strict=True):
        within, beyond = cut(triangle_corners, server, margin)
        if len(parents) + len(within) + len(beyond) > MOST:
            break
        for piece, is_inside in [(p, True) for p in within] + [(p, False) for p in beyond]:
            parents.append(int(triangle))
            bary.append(piece)
            places.append(product(piece, triangle_corners))
            inside.append(is_inside)
    if not parents:
        return Slices()
    return Slices(np.array(parents, np.int32), np.array(places), np.array(bary), np.array(inside))
