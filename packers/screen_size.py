"""How large triangles are on screen, in pixels: what a packer decides by how many texels to give them."""

from __future__ import annotations

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Doubles, Floats
from shading_atlas_bench.arithmetic.matrices import transform
from shading_atlas_bench.packers.interface import View


def edge_pixels(view: View, corners: Floats | Doubles) -> Doubles:
    """Lengths of triangles' edges in a view's picture, in its pixels: float64 (n, 3), from corner 0 to 1 to 2 to 0.

    corners: (n, 3, 3), relative to the scene's origin, as of `scene.host.positions[scene.host.indices[frame.pvs]]`.
    In `Frame.server` they are pixels of the client's picture as well: both have the same density at their centres.
    Away from it perspective makes them longer, as in any picture.

    What lies before the near plane is cut off: an edge wholly before it, or behind the eye, has 0 pixels. What lies
    beside the picture counts, because a client may turn there.
    """
    near = view.projection[2, 3]
    starts = transform(view.matrix, corners)  # clip coordinates; the last is the distance along the view's axis
    ends = np.roll(starts, -1, axis=1)
    half = np.array([view.width, view.height]) / 2
    apart = half * (_projected(starts, ends, near) - _projected(ends, starts, near))
    shown = (starts[..., 3] >= near) | (ends[..., 3] >= near)
    lengths: Doubles = np.where(shown, np.sqrt(apart[..., 0] * apart[..., 0] + apart[..., 1] * apart[..., 1]), 0.0)
    return lengths


def _projected(points: Doubles, others: Doubles, near: float) -> Doubles:
    """x and y from -1 to 1 across the picture, of points that are moved to the near plane, along their edges to the
    others, where they lie before it and the others do not."""
    depth, other = points[..., 3], others[..., 3]
    crosses = (depth < near) & (other >= near)
    share = np.where(crosses, near - depth, 0.0) / np.where(crosses, other - depth, 1.0)
    moved = points[..., :2] + share[..., None] * (others[..., :2] - points[..., :2])
    projected: Doubles = moved / np.maximum(depth, near)[..., None]
    return projected
