"""Smooth lines through points, float64 (N, ...) along the first axis."""

from __future__ import annotations

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Array, Doubles
from shading_atlas_bench.arithmetic.functions import exp


def smoothed(values: Array, deviation: float) -> Doubles:
    """Values (N, ...), of any numbers, weighted by a Gaussian of a deviation in steps, cut at four: float64 (N, ...).

    The ends go on as they are.
    """
    reach = int(4 * deviation + 0.5)
    steps: Doubles = np.arange(1, reach + 1) / deviation
    weights = exp(-0.5 * steps * steps)
    count = len(values)
    ends = np.pad(values, ((reach, reach), *((0, 0),) * (values.ndim - 1)), mode="edge")
    total = np.array(values, np.float64)
    for step, weight in enumerate(weights, 1):
        total += weight * (ends[reach - step : reach - step + count] + ends[reach + step : reach + step + count])
    mean: Doubles = total / (1 + 2 * weights.sum())
    return mean


def curve(at: Doubles, points: Doubles, where: Doubles) -> Doubles:
    """Values (M, K) at `where` (M) of a curve through points (N, K) at growing places (N), which never overshoots.

    Cubic between the points (Fritsch and Butland 1984), its slope a weighted harmonic mean of the legs' slopes.
    """
    gaps = np.diff(at)[:, None]
    slopes = np.diff(points, axis=0) / gaps
    ends = np.concatenate([slopes[:1], slopes[-1:]])
    if len(gaps) > 1:
        ends = np.stack([_end(gaps[0], gaps[1], *slopes[:2]), _end(gaps[-1], gaps[-2], *slopes[:-3:-1])])
    heavy, light = 2 * gaps[1:] + gaps[:-1], gaps[1:] + 2 * gaps[:-1]
    same = np.sign(slopes[:-1]) * np.sign(slopes[1:]) > 0
    before, after = np.where(same, slopes[:-1], 1), np.where(same, slopes[1:], 1)
    middle = np.where(same, (heavy + light) / (heavy / before + light / after), 0)
    turns = np.concatenate([ends[:1], middle, ends[1:]])
    leg = np.clip(np.searchsorted(at, where, side="right") - 1, 0, len(gaps) - 1)
    square = (3 * slopes - 2 * turns[:-1] - turns[1:]) / gaps
    cube = (turns[:-1] + turns[1:] - 2 * slopes) / (gaps * gaps)
    step = (where - at[leg])[:, None]
    values: Doubles = points[leg] + step * (turns[leg] + step * (square[leg] + step * cube[leg]))
    return values


def _end(gap: Doubles, next_gap: Doubles, slope: Doubles, next_slope: Doubles) -> Doubles:
    """The curve's slope at an end, from its first two legs: of a parabola, but neither turned back nor too steep."""
    found = ((2 * gap + next_gap) * slope - gap * next_slope) / (gap + next_gap)
    steep = (np.sign(slope) != np.sign(next_slope)) & (np.abs(found) > 3 * np.abs(slope))
    return np.where(np.sign(found) != np.sign(slope), 0, np.where(steep, 3 * slope, found))
