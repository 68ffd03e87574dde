"""Environment maps: what glossy surfaces reflect of their surroundings, by direction and roughness; the lookup's twin.

A map is one point's view in all directions on the square of an octahedron (Cigolle 2014, "A Survey of Efficient
Representations for Independent Unit Vectors"), y up, blurred as GGX surfaces of five roughnesses do that are seen from
straight above (Karis 2013, "Real Shading in Unreal Engine 4"). Each texel holds all five, so that one load gets two of
them; the blurred ones are computed on coarser squares. Everything here is float64, summed in a fixed order, so that a
map's bytes are the same on every machine.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Doubles, Floats
from shading_atlas_bench.arithmetic.matrices import dot
from shading_atlas_bench.kernels.constants import constants_of

DEFINED = constants_of(Path(__file__).with_name("environment.cl"))
SIDE = 128  # texels of a map, without its border
SIZES = (SIDE, 64, 32, 16, 8)  # texels along the side of the square that a level is computed on
SMOOTHEST = DEFINED.number("SMOOTHEST")  # roughness of the first level
FULL = 0.6  # up to it nothing but the map counts
MATT = DEFINED.number("MATT")  # roughness of the last level
ROUGHNESSES = tuple(SMOOTHEST + (MATT - SMOOTHEST) * k / (len(SIZES) - 1) for k in range(len(SIZES)))
SHAPE = (SIDE + 3, SIDE + 2, 16)  # one row more: eight floats are read at a time, beyond the last texel's end
BLOCK = 16  # texels blurred at a time, so that their weights stay in the processor's cache
ACROSS = 4  # directions that a texel of the first level averages, along each side
BLURRED_FROM = 64  # texels along a side of the picture that further levels are blurred from


def directions(size: int) -> tuple[Doubles, Doubles]:
    """Unit vectors (size, size, 3) through the middles of the texels of an octahedron's square, and how large the solid
    angles (size, size) of the texels are beside each other."""
    step = (2 * np.arange(size) + 1) / size - 1
    x, z = np.meshgrid(step, step)
    y = 1 - np.abs(x) - np.abs(z)
    below = y < 0
    x, z = (np.where(below, (1 - np.abs(other)) * np.where(one < 0, -1.0, 1.0), one) for one, other in ((x, z), (z, x)))
    points = np.stack([x, y, z], axis=-1)
    length = np.sqrt(dot(points, points))
    return points / length[..., None], 1 / (length * length * length)


def environment_map(radiance: Callable[[Doubles], Doubles]) -> Floats:
    """float32 SHAPE: the map of what is seen, radiance (n, 3) as a function of unit directions (n, 3).

    A texel holds RGB of each level, one after the other. The border, one texel wide, holds what lies beyond the
    square's edges.
    """
    fine = SIDE * ACROSS
    seen = np.asarray(radiance(directions(fine)[0].reshape(-1, 3)), np.float64).reshape(fine, fine, 3)
    sharp = _averaged(seen, SIDE)
    coarse = _averaged(sharp, BLURRED_FROM).reshape(-1, 3)
    texels = np.zeros(SHAPE, np.float32)
    for level, (size, roughness) in enumerate(zip(SIZES, ROUGHNESSES, strict=True)):
        blurred = _enlarged(_blurred(coarse, size, roughness)) if level else sharp
        texels[:-1, :, 3 * level : 3 * level + 3] = _bordered(blurred)
    return texels


def _averaged(picture: Doubles, size: int) -> Doubles:
    """A picture (n, n, 3) with the averages of its squares: (size, size, 3)."""
    step = len(picture) // size
    parts = picture.reshape(size, step, size, step, 3).transpose(1, 3, 0, 2, 4)
    return _total(parts.reshape(step * step, size, size, 3)) / (step * step)


def _total(parts: Doubles) -> Doubles:
    """The sum over the first axis, a power of two, of halves that are added again and again."""
    while len(parts) > 1:
        middle = len(parts) // 2
        parts = parts[:middle] + parts[middle:]
    total: Doubles = parts[0]
    return total


def _blurred(seen: Doubles, size: int, roughness: float) -> Doubles:
    """(size, size, 3): the picture (BLURRED_FROM squared, 3) as surfaces of a roughness reflect it that face the
    viewer."""
    sources, angles = (part.reshape(len(seen), -1) for part in directions(BLURRED_FROM))
    targets = directions(size)[0].reshape(-1, 3)
    squared = roughness * roughness * roughness * roughness
    level = np.empty((len(targets), 3))
    for start in range(0, len(targets), BLOCK):
        block = slice(start, start + BLOCK)
        x, y, z = targets[block].T
        cosine = sources[:, :1] * x + sources[:, 1:2] * y + sources[:, 2:] * z
        # GGX of the half vector, at whose angle to both the cosine's square is (1 + cosine) / 2.
        narrow = (1 + cosine) * (0.5 * (squared - 1)) + 1
        weights = np.maximum(cosine, 0) * angles / (narrow * narrow)
        whole = _total(weights)
        for channel in range(3):
            level[block, channel] = _total(weights * seen[:, channel, None]) / whole
    return level.reshape(size, size, 3)


def _enlarged(level: Doubles) -> Doubles:
    """A smaller level (S, S, 3), bilinear at the texels of a map: (SIDE, SIDE, 3)."""
    wide = _bordered(level)
    place = (np.arange(SIDE) + 0.5) / SIDE * len(level) + 0.5
    low = np.floor(place).astype(int)
    share = (place - low)[:, None, None]
    wide = wide[low] + (wide[low + 1] - wide[low]) * share
    enlarged: Doubles = wide[:, low] + (wide[:, low + 1] - wide[:, low]) * share[None, :, 0]
    return enlarged


def _bordered(level: Doubles) -> Doubles:
    """A level (S, S, 3) with its border (S + 2, S + 2, 3): beyond an edge the square goes on at the edge's mirror."""
    size = len(level)
    wide = np.zeros((size + 2, size + 2, 3))
    wide[1:-1, 1:-1] = level
    wide[1:-1, 0], wide[1:-1, -1] = level[::-1, 0], level[::-1, -1]
    wide[0, 1:-1], wide[-1, 1:-1] = level[0, ::-1], level[-1, ::-1]
    wide[[0, 0, -1, -1], [0, -1, 0, -1]] = level[[-1, -1, 0, 0], [-1, 0, -1, 0]]
    return wide


def map_share(roughness: Doubles) -> Doubles:
    """The share (...), at roughness (...), of what surfaces reflect that comes from the map: 1 up to FULL, falling to 0
    at MATT."""
    return np.clip((MATT - roughness) / (MATT - FULL), 0, 1)


def look_up(texels: Floats, direction: Doubles, roughness: Doubles) -> Doubles:
    """Radiance (n, 3) of a map, float32 SHAPE, from around directions (n, 3) of any length, for roughnesses (n)."""
    x, y, z = (np.asarray(direction, np.float64) / np.abs(direction).sum(axis=-1, keepdims=True)).T
    u, v = (np.where(y < 0, (1 - np.abs(other)) * np.where(one < 0, -1, 1), one) for one, other in ((x, z), (z, x)))
    column, row = ((place + 1) / 2 * SIDE + 0.5 for place in (u, v))
    left, upper = np.floor(column).astype(int), np.floor(row).astype(int)
    across, down = (column - left)[:, None], (row - upper)[:, None]
    corners = [[texels[upper + i, left + j].astype(np.float64) for j in (0, 1)] for i in (0, 1)]
    top, bottom = (first + (second - first) * across for first, second in corners)
    levels = (top + (bottom - top) * down)[:, :15].reshape(-1, len(SIZES), 3)
    last = len(SIZES) - 1
    level = np.clip((roughness - SMOOTHEST) * last / (MATT - SMOOTHEST), 0, last)
    whole = np.minimum(np.floor(level), last - 1).astype(int)
    each = np.arange(len(levels))
    smooth, rough = levels[each, whole], levels[each, whole + 1]
    seen: Doubles = smooth + (rough - smooth) * (level - whole)[:, None]
    return seen
