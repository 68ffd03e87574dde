"""Which of several views from one eye a ray belongs to.

A view cell may see more than one perspective view shows well; then several views cover it, and their pictures overlap.
So that nothing is drawn or sent twice, each ray from the eye belongs to exactly one of them: the view whose axis it is
nearest to, of equals the first.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Bools, Doubles, Ints, Longs
from shading_atlas_bench.arithmetic.matrices import matvec, product
from shading_atlas_bench.packers.interface import View


def owners(views: Sequence[View], rays: Doubles) -> Longs:
    """int64 (n), the number of the view that each ray, float64 (n, 3) in scene axes, belongs to."""
    axes = np.stack([-view.view[2, :3] for view in views])
    nearest: Longs = np.argmax(product(rays, axes.T), axis=-1)
    return nearest


def owned_spans(views: Sequence[View], number: int) -> Ints:
    """int32 (h, 2): in each row of views[number], the first pixel whose centre's ray belongs to it, and the one behind
    the last; both equal where there is none. Views meet in planes through the eye, so that a row holds one run."""
    view = views[number]
    (scale_x, scale_y), (shift_x, shift_y) = view.projection[[0, 1], [0, 1]], view.projection[:2, 2]
    step, start = 2 / view.width / scale_x, (1 / view.width - 1 + shift_x) / scale_x  # of tan x along a row
    y = (1 - (2 * np.arange(view.height) + 1) / view.height + shift_y) / scale_y
    first: Doubles = np.zeros(view.height)
    end: Doubles = np.full(view.height, float(view.width))
    for other, rival in enumerate(views):
        if other == number:
            continue
        axis = matvec(view.view[:3, :3], -rival.view[2, :3])
        # The rival's axis in this eye space. Of the ray (x, y, -1), own cosine less the rival's, times its length:
        lead, slope = 1 + axis[2] - axis[0] * start - axis[1] * y, -axis[0] * step
        wins = lead > 0 if other < number else lead >= 0
        if slope == 0:
            end = np.where(wins, end, 0)
            continue
        meeting = -lead / slope  # the column where both are equal
        if slope > 0:
            first = np.maximum(first, np.floor(meeting) + 1 if other < number else np.ceil(meeting))
        else:
            end = np.minimum(end, np.ceil(meeting) if other < number else np.floor(meeting) + 1)
    first = np.minimum(first, view.width)
    return np.stack([first, np.maximum(first, end)], axis=1).astype(np.int32)


def owned_pixels(views: Sequence[View], number: int) -> Bools:
    """bool (h, w): the pixels of views[number] whose centres' rays belong to it."""
    if len(views) == 1:
        return np.ones((views[0].height, views[0].width), bool)
    first, end = owned_spans(views, number).T[..., None]
    columns = np.arange(views[number].width)
    owned: Bools = (columns >= first) & (columns < end)
    return owned
