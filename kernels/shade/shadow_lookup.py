"""The twin of shadow map lookups, in float64."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Doubles, Floats
from shading_atlas_bench.kernels.constants import constants_of

DEFINED = constants_of(Path(__file__).with_name("shadow_lookup.cl"))
NORMAL_OFFSET = DEFINED.number("NORMAL_OFFSET")  # texels
LIGHT_OFFSET = DEFINED.number("LIGHT_OFFSET")


def shadow_visibility(
    light: Doubles, shadow_maps: Floats, position: Doubles, normal: Doubles, to_light: Doubles
) -> Doubles:
    """The share (n) of a light that arrives at points: 3x3 bilinear taps, each with a ramp one texel deep.

    light: a light's record (48); position, normal (unit, on the lit side), to_light: (n, 3). shadow_maps:
    float32, all maps one after the other. All lit without a map.
    """
    size = int(light[37])
    if size == 0:
        return np.ones(len(position))
    rows = light[20:36].reshape(4, 4)
    start = int(np.float32(light[36]).view(np.int32))
    texel = light[38] + light[39] * (position @ rows[3, :3] + rows[3, 3])
    sine = np.sqrt(np.maximum(1 - (normal @ light[8:11]) ** 2, 0))
    point = position + normal * (texel * NORMAL_OFFSET * sine)[:, None] + to_light * (texel * LIGHT_OFFSET)[:, None]
    x, y, depth, w = (point @ rows[:, :3].T + rows[:, 3]).T
    ahead = w > 0
    x, y, depth = (value / np.where(ahead, w, 1) for value in (x, y, depth))
    ramp = np.maximum(texel * (light[40] + light[41] * depth**2), 1e-12)
    inside = ahead & (x >= 2) & (x <= size - 2) & (y >= 2) & (y <= size - 2)
    column, row = (np.where(inside, np.floor(value - 0.5), 1).astype(np.int64) for value in (x, y))
    fx, fy = x - 0.5 - column, y - 0.5 - row
    across = np.stack([1 - fx, np.ones_like(fx), np.ones_like(fx), fx])
    down = np.stack([1 - fy, np.ones_like(fy), np.ones_like(fy), fy])
    lit = np.zeros(len(position))
    for i in range(4):
        for j in range(4):
            seen = shadow_maps[start + (row - 1 + i) * size + column - 1 + j]
            lit += down[i] * across[j] * np.clip(1 + (depth - seen) / ramp, 0, 1)
    return np.where(inside, lit / 9, 1.0)
