"""Every surface that rays through some pixels meet, in float64."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Bools, Doubles, Ints
from shading_atlas_bench.harness.measure.exact import DEPTH
from shading_atlas_bench.harness.measure.validity import Whole
from shading_atlas_bench.harness.measure.verification.truth import Points, Truth
from shading_atlas_bench.kernels.raster.camera import SUBPIXELS, Camera
from shading_atlas_bench.kernels.raster.resolve import locate_samples_twin
from shading_atlas_bench.kernels.texture.mask import margin_twin
from shading_atlas_bench.kernels.triangles import Triangles
from shading_atlas_bench.packers.interface import View

SLACK = 1 / 64  # pixels, which cover snapping to 1/256 and what float32 rounds
CLEAR = 24.0  # of 255, by which alpha must miss a mask's threshold for rounding not to matter


@dataclass(frozen=True)
class Hits(Points):
    """Surfaces met, ray by ray, nearest first.

    ray: int (n). depth, reach: float64 (n); the depth is near plane over distance, and may be off by `reach`.
    opacity: float64 (n, 2), from and to, of 255. certain: bool (n), false where rounding may decide otherwise.
    """

    ray: Whole
    depth: Doubles
    reach: Doubles
    opacity: Doubles
    certain: Bools

    def at(self, chosen: Whole) -> Hits:
        """Those of these numbers, int (k)."""
        return Hits(*(getattr(self, field.name)[chosen] for field in fields(self)))


def cast_rays(truth: Truth, view: View, ids: Ints, columns: Whole, rows: Whole) -> Hits:
    """Through the centres of pixels, int columns and rows (k), all triangles `ids` int (m) that are drawn."""
    camera = Camera.of(view.view, view.projection, view.width, view.height)
    triangles = truth.triangles
    corners = camera.project(triangles.host_positions[triangles.host_indices[ids]])
    x = corners[..., 0] / SUBPIXELS + corners[..., 3] * view.width / 2
    y = corners[..., 1] / SUBPIXELS + corners[..., 3] * view.height / 2
    z, w = corners[..., 2], corners[..., 3]
    centres = np.stack([columns, rows], axis=1, dtype=np.float64) + 0.5
    ray, found = _near_pixels(x, y, w, centres)
    homogeneous = np.stack([x[found], y[found], w[found]], axis=-1)
    edges = np.cross(np.roll(homogeneous, -1, axis=1), np.roll(homogeneous, -2, axis=1))
    volume = (edges[:, 0] * homogeneous[:, 0]).sum(axis=1)
    sided = (triangles.host_flags[ids[found]] & Triangles.DOUBLE_SIDED) > 0
    at = np.concatenate([centres[ray], np.ones((len(ray), 1))], axis=1)
    with np.errstate(all="ignore"):
        plane = (z[found][..., None] * edges).sum(axis=1) / volume[:, None]
        edges = edges * np.sign(volume)[:, None, None]
        margins = (edges * at[:, None]).sum(axis=2) / np.linalg.norm(edges[..., :2], axis=2)
        depth = (plane * at).sum(axis=1)
        reach = np.linalg.norm(plane[:, :2], axis=1) * SLACK + DEPTH * np.abs(depth)
    met = (margins >= -SLACK).all(axis=1) & (depth + reach > 0) & (depth - reach <= 1) & ((volume < 0) | sided)
    certain = (margins > SLACK).all(axis=1) & (depth + reach < 1) & (depth - reach > 0)
    area = np.where((w[found] > 0).all(axis=1), _areas(x[found], y[found], w[found]), np.nan)
    kept = np.flatnonzero(met)
    triangle, column, row = ids[found[kept]], columns[ray[kept]], rows[ray[kept]]
    with np.errstate(all="ignore"):
        bary, footprint = locate_samples_twin(
            triangles, triangle, column, row, view.view, view.projection, view.width, view.height
        )
    points = Points(triangle, np.nan_to_num(bary), np.nan_to_num(footprint))
    opacity = truth.opacity(points)
    hits = Hits(
        points.triangle,
        points.bary,
        points.footprint,
        ray=ray[kept],
        depth=depth[kept],
        reach=reach[kept],
        opacity=opacity,
        certain=certain[kept] & (opacity[:, 0] > 2),
    )
    return _sorted(_unmasked(truth, hits, area[kept]))


def _near_pixels(x: Doubles, y: Doubles, w: Doubles, centres: Doubles) -> tuple[Whole, Whole]:
    """Pairs of pixels and triangles whose box on screen holds them: numbers of both."""
    with np.errstate(all="ignore"):
        corners = [(values / w).T.copy() for values in (x, y)]  # NumPy is slow over axes of three
        boxes = [[f(values, axis=0) for f in (np.min, np.max)] for values in corners]
    anywhere = ~(w > 0).all(axis=1)
    (left, right), (top, low) = (
        (np.where(anywhere, -np.inf, first - 1), np.where(anywhere, np.inf, last + 1)) for first, last in boxes
    )
    behind = (w <= 0).all(axis=1)
    rays, found = [], []
    for number, (column, row) in enumerate(centres):
        inside = np.flatnonzero((left <= column) & (right >= column) & (top <= row) & (low >= row) & ~behind)
        rays.append(np.full(len(inside), number))
        found.append(inside)
    return np.concatenate(rays), np.concatenate(found)


def _areas(x: Doubles, y: Doubles, w: Doubles) -> Doubles:
    """Pixels, of triangles (n, 3) wholly in front of the eye."""
    with np.errstate(all="ignore"):
        x, y = x / w, y / w
        twice = (x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0]) - (x[:, 2] - x[:, 0]) * (y[:, 1] - y[:, 0])
        areas: Doubles = np.abs(twice) / 2
    return areas


def _unmasked(truth: Truth, hits: Hits, area: Doubles) -> Hits:
    """Without what masks cut away. area: pixels (n) of their triangles, NaN of those not wholly in front of the eye."""
    mask, masked = truth.scene.mask, np.flatnonzero(truth.triangles.host_flags[hits.triangle] & Triangles.MASKED)
    if mask is None or not masked.size:
        return hits
    triangle, (bary1, bary2) = hits.triangle[masked], hits.bary[masked].T
    pixels, known = np.nan_to_num(area[masked], nan=1), np.isfinite(area[masked])
    tries = [margin_twin(mask, triangle, bary1, bary2, pixels * by) for by in (0.5, 1.0, 2.0)]
    low, high = np.min(tries, axis=0), np.max(tries, axis=0)
    certain, kept = hits.certain.copy(), np.ones(len(area), bool)
    certain[masked] &= (low > CLEAR) & known
    kept[masked] = (high > -CLEAR) | ~known
    return replace(hits, certain=certain).at(np.flatnonzero(kept))


def _sorted(hits: Hits) -> Hits:
    return hits.at(np.lexsort((hits.triangle, -hits.depth, hits.ray)))
