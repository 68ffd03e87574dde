"""Procedural textures, drawn with NumPy from a seed: uint8 (H, W, 4), sRGB colours, alpha 255 unless they are cut out.

All repeat seamlessly except signs, screens and cards. Each has detail down to single texels, so undersampling shows.
"""

from __future__ import annotations

import functools
import zlib
from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from shading_atlas_bench.arithmetic import draws
from shading_atlas_bench.arithmetic.arrays import Array, Bytes, Doubles, Floats, Ints
from shading_atlas_bench.arithmetic.fourier import inverse_real
from shading_atlas_bench.arithmetic.functions import cos, exp, hypot, log, sin, sin_cos

# A 5 x 7 font, seven rows of five bits each, top row first.
GLYPHS = {
    "A": "0E11111F111111", "B": "1E11111E11111E", "C": "0E11101010110E", "D": "1E11111111111E", "E": "1F10101E10101F",
    "F": "1F10101E101010", "G": "0E11101711110F", "H": "1111111F111111", "I": "0E04040404040E", "J": "0702020202120C",
    "K": "11121418141211", "L": "1010101010101F", "M": "111B1515111111", "N": "11191513111111", "O": "0E11111111110E",
    "P": "1E11111E101010", "Q": "0E11111115120D", "R": "1E11111E141211", "S": "0F10100E01011E", "T": "1F040404040404",
    "U": "1111111111110E", "V": "11111111110A04", "W": "11111115151B11", "X": "11110A040A1111", "Y": "11110A04040404",
    "Z": "1F01020408101F", "0": "0E11131519110E", "1": "040C040404040E", "2": "0E11010608101F", "3": "1E01010E01011E",
    "4": "02060A121F0202", "5": "1F101E0101110E", "6": "0608101E11110E", "7": "1F010204080808", "8": "0E11110E11110E",
    "9": "0E11110F01020C", "-": "0000001F000000", ".": "0000000000000C", ":": "000C0C000C0C00", "!": "04040404040004",
}  # fmt: skip


def generator(seed: int, name: str) -> draws.Generator:
    """Random numbers of one named thing: adding another thing changes nothing here."""
    return draws.generator([seed, zlib.crc32(name.encode())])


def fractal(size: int, rng: draws.Generator, slope: float = 1.2, stretch: tuple[float, float] = (1, 1)) -> Floats:
    """Seamless noise float32 (size, size) in 0..1, mean 0.5: amplitudes fall as frequency ** -slope.

    stretch: how much longer features are along u and v.
    """
    half = size // 2
    fu, fv = np.arange(half + 1) * stretch[0], np.arange(half + 1)[:, None] * stretch[1]
    amplitude = exp(-slope * log(1 + np.sqrt(fu * fu + fv * fv)))
    amplitude[0, 0] = 0
    amplitude = np.concatenate([amplitude, amplitude[half - 1 : 0 : -1]])  # negative frequencies along v
    spectrum = _directions(rng, amplitude.shape)
    spectrum *= amplitude.astype(np.float32)
    noise = inverse_real(spectrum)
    noise *= np.float32(0.2 / noise.std(dtype=np.float64))
    noise += np.float32(0.5)
    return np.clip(noise, 0, 1, out=noise)


def _directions(rng: draws.Generator, shape: tuple[int, ...]) -> Floats:
    """Cosines and sines (2, *shape) of random angles: of 2 ** 24, as sums of a coarse and a fine one from a table."""
    angle = (rng.random(shape, np.float32) * 2**24).astype(np.int64)
    (coarse_x, coarse_y), (fine_x, fine_y) = (
        [row.take(part) for row in table] for table, part in zip(_angles(), (angle >> 12, angle & 4095), strict=True)
    )
    out = np.empty((2, *shape), np.float32)
    np.subtract(coarse_x * fine_x, coarse_y * fine_y, out=out[0])
    np.add(coarse_y * fine_x, coarse_x * fine_y, out=out[1])
    return out


@functools.cache
def _angles() -> tuple[Floats, Floats]:
    """Cosines and sines (2, 4096) of the multiples of a turn's 4096th part, and of that part's 4096th part."""
    steps = np.arange(4096) * (2 * np.pi)
    coarse, fine = (np.stack(sin_cos(steps / parts)[::-1]).astype(np.float32) for parts in (2**12, 2**24))
    return coarse, fine


def _coordinates(size: int) -> tuple[Floats, Floats]:
    """Texel centres (x, y) in 0..1, broadcastable to (size, size)."""
    t = np.arange(size, dtype=np.float32)
    t += 0.5
    t /= size
    return t[None, :], t[:, None]


def _mix(a: ArrayLike, b: ArrayLike, t: Array) -> Array:
    """Colours a and b, (..., 3) or (3,), mixed by t (H, W)."""
    low, high = np.asarray(a, np.float32), np.asarray(b, np.float32)
    out: Array = np.empty((*t.shape, 3), np.result_type(t, np.float32))
    for channel in range(3):  # whole pictures at once: NumPy is slow along an axis of three
        out[..., channel] = low[..., channel] + (high[..., channel] - low[..., channel]) * t
    return out


def _blend(a: Array | float, b: Array | float, share: Array) -> Array:
    """a where the share is 0, b where it is 1."""
    blended: Array = a + (b - a) * share
    return blended


def _texels(colour: Array, alpha: Array | None = None) -> Bytes:
    """uint8 (H, W, 4) of colours (H, W, 3) and alpha (H, W) in 0..1."""
    out = np.full((*colour.shape[:2], 4), 255, np.uint8)
    bytes_ = np.clip(colour, 0, 1)
    bytes_ *= 255
    bytes_ += 0.5
    out[..., :3] = bytes_
    if alpha is not None:
        out[..., 3] = np.clip(alpha, 0, 1) * 255 + 0.5
    return out


def _wear(roughness: Array, metal: Array | float = 1.0) -> Bytes:
    """A texture of roughness (H, W) in green and metalness in blue, as glTF has them; red is not read."""
    out = np.ones((*roughness.shape, 3), np.float32)
    out[..., 1], out[..., 2] = roughness, metal
    return _texels(out)


def normal_map(height: Array, metres_per_texel: float) -> Bytes:
    """A tangent-space normal map, uint8 (H, W, 4), linear, of a seamless height field, float (H, W), in metres; green
    points up in the image."""
    du = (np.roll(height, -1, 1) - np.roll(height, 1, 1)) / (2 * metres_per_texel)
    dv = (np.roll(height, -1, 0) - np.roll(height, 1, 0)) / (2 * metres_per_texel)
    length = np.sqrt(du * du + dv * dv + 1)
    return _texels(np.stack([-du / length, dv / length, 1 / length], axis=-1) * 0.5 + 0.5)


def _wall(size: int, columns: int, rows: int, joint: float, shift: float) -> tuple[Ints, Doubles]:
    """A running bond: the stone's random-number index (H, W), and how far inside it a texel is (0 joint .. 1).

    joint: width of a joint in courses; shift: how far every other course is shifted, in stones.
    """
    x, y = _coordinates(size)
    row = np.floor(y * rows).astype(np.int32)
    along = x * columns + (row % 2) * np.float32(shift)
    column = np.floor(along).astype(np.int32) % columns
    aspect = rows / columns
    edge_x = np.minimum(along % 1, 1 - along % 1) * aspect
    edge_y = np.minimum(y * rows % 1, 1 - y * rows % 1)
    inside = np.clip((np.minimum(edge_x, edge_y) - joint / 2) / 0.06, 0, 1)
    return row * columns + column, inside


def brick(seed: int, size: int = 512) -> tuple[Bytes, Bytes]:
    """A brick wall of 8 x 24 bricks (for a tile of 2 m) and its normal map; uint8 (size, size, 4) each."""
    rng = generator(seed, "brick")
    stone, inside = _wall(size, 8, 24, 0.14, 0.5)
    grain = fractal(size, rng, 0.7)
    tone = rng.random(8 * 24, np.float32)[stone]
    colour = _mix((0.50, 0.22, 0.16), (0.70, 0.40, 0.28), tone) * (0.7 + 0.6 * grain)[..., None]
    colour = _mix((0.62, 0.60, 0.56), colour, inside)
    return _texels(colour), normal_map(inside * 0.006 + grain * inside * 0.003, 2 / size)


def tiles(seed: int, count: int = 4, size: int = 512) -> Bytes:
    """Square tiles, some darker, for a tile of 1.2 m; uint8 (size, size, 4)."""
    rng = generator(seed, "tiles")
    stone, inside = _wall(size, count, count, 0.03, 0.0)
    grain = fractal(size, rng, 1.0)
    tone = rng.random(count * count, np.float32)[stone]
    checker = ((stone // count + stone % count) % 2).astype(np.float32)
    colour = _mix((0.60, 0.61, 0.60), (0.70, 0.70, 0.67), tone) * (0.82 + 0.3 * grain - 0.10 * checker)[..., None]
    speckle = (rng.random((size, size), np.float32) > 0.985) * inside
    colour = _mix((0.30, 0.30, 0.29), colour * (1 - 0.45 * speckle)[..., None], inside)
    return _texels(colour)


def tile_wear(seed: int, count: int = 4, size: int = 256) -> Bytes:
    """Roughness of `tiles` under a sealing coat: smears, scuffs, some tiles worn more than others, matt joints; linear,
    uint8 (size, size, 4)."""
    rng = generator(seed, "tile wear")
    stone, inside = _wall(size, count, count, 0.03, 0.0)
    smear, scuff = fractal(size, rng, 1.3), fractal(size, rng, 0.6, (0.05, 1))
    worn = rng.random(count * count, np.float32)[stone]
    rough = 0.08 + 0.08 * worn + 0.5 * np.clip(smear - 0.5, 0, 1) + 0.5 * np.clip(scuff * 3 - 2.1, 0, 1)
    return _wear(_blend(0.8, np.minimum(rough, 0.6), inside))


def concrete(seed: int, size: int = 512) -> Bytes:
    """Grey concrete with pores and stains; uint8 (size, size, 4)."""
    rng = generator(seed, "concrete")
    grain, stain = fractal(size, rng, 0.6), fractal(size, rng, 1.6)
    pores = rng.random((size, size), np.float32) > 0.992
    shade = 0.42 + 0.28 * grain + 0.25 * (stain - 0.5) - 0.15 * pores
    return _texels(shade[..., None] * np.array([1.0, 0.98, 0.94], np.float32))


def paint(seed: int, size: int = 512) -> Bytes:
    """Near-white painted metal with scratches and grime, to be tinted; uint8 (size, size, 4)."""
    rng = generator(seed, "paint")
    grain = fractal(size, rng, 0.9)
    scratch = np.clip(fractal(size, rng, 0.5, (0.03, 1)) * 3 - 2.2, 0, 1)
    fine = rng.random((size, size), np.float32)
    return _texels((0.83 + 0.14 * grain - 0.35 * scratch - 0.06 * fine)[..., None].repeat(3, -1))


def paint_wear(seed: int, size: int = 512) -> Bytes:
    """Roughness of `paint` of a size, at half of it: gloss where it is sound, dull scratches and grime; linear, uint8
    (size / 2, size / 2, 4)."""
    rng = generator(seed, "paint")
    grain = fractal(size, rng, 0.9)
    scratch = np.clip(fractal(size, rng, 0.5, (0.03, 1)) * 3 - 2.2, 0, 1)
    grime = np.clip(fractal(size // 2, generator(seed, "grime"), 1.3) - 0.5, 0, 1)
    grain, scratch = grain[::2, ::2], scratch[::2, ::2]
    return _wear(np.clip(0.24 + 0.9 * grime + 0.2 * (0.5 - grain) + 0.4 * scratch, 0.16, 0.8))


def metal_wear(seed: int, size: int = 256) -> Bytes:
    """Roughness and metalness of brushed metal plates: fine lines, and dull oxide in patches; linear, uint8
    (size, size, 4)."""
    rng = generator(seed, "metal wear")
    brushed, patches = fractal(size, rng, 0.5, (0.05, 1)), fractal(size, rng, 1.4)
    oxide = np.clip(patches * 3 - 2, 0, 1)
    return _wear(0.32 + 0.35 * (brushed - 0.3) + 0.35 * oxide, 1 - 0.6 * oxide)


def rivets(seed: int, size: int = 512) -> tuple[Bytes, Bytes]:
    """Metal plates, 2 x 2 in a tile of 2 m, with rows of rivets, and their normal map; uint8 (size, size, 4) each."""
    rng = generator(seed, "rivets")
    plate, inside = _wall(size, 2, 2, 0.01, 0.0)
    x, y = _coordinates(size)
    brushed = fractal(size, rng, 0.5, (0.05, 1))
    px, py = x * 2 % 1, y * 2 % 1
    on_rim = (np.minimum(np.minimum(px, 1 - px), np.minimum(py, 1 - py)) < 0.1).astype(np.float32)
    rx, ry = (px * 10 % 1) - 0.5, (py * 10 % 1) - 0.5
    head = np.clip(1 - (rx * rx + ry * ry) / 0.05, 0, 1) * on_rim
    tone = rng.random(4, np.float32)[plate]
    shade = (0.5 + 0.12 * tone + 0.25 * (brushed - 0.5)) * (0.45 + 0.55 * inside) + 0.12 * head
    height = inside * 0.004 + np.sqrt(head) * 0.008
    return _texels(shade[..., None] * np.array([0.96, 0.98, 1.0], np.float32)), normal_map(height, 2 / size)


def tread(seed: int, size: int = 512) -> Bytes:
    """Tread plate: short raised bars in alternating directions; uint8 (size, size, 4)."""
    rng = generator(seed, "tread")
    x, y = _coordinates(size)
    u, v = (x + y) * 12, (x - y) * 12
    cell = (np.floor(u) + np.floor(v)).astype(np.int32) % 2
    a, b = u % 1 - 0.5, v % 1 - 0.5
    a, b = np.where(cell, a, b), np.where(cell, b, a)
    bar = np.clip(1.3 - (a * a / 0.15 + b * b / 0.012), 0, 1)
    shade = 0.34 + 0.12 * fractal(size, rng, 1.0) + 0.38 * bar
    return _texels(shade[..., None].repeat(3, -1))


def stripes(seed: int, size: int = 256) -> Bytes:
    """Yellow and black diagonal hazard stripes; uint8 (size, size, 4)."""
    x, y = _coordinates(size)
    yellow = (((x + y) * 4) % 1 < 0.5).astype(np.float32)
    grain = fractal(size, generator(seed, "stripes"), 0.9)
    return _texels(_mix((0.08, 0.08, 0.08), (0.92, 0.74, 0.08), yellow) * (0.75 + 0.4 * grain)[..., None])


def ruler(size: int = 512) -> Bytes:
    """A calibration board: checkers of three sizes, rings and a ruler along the lower edge; uint8 (size, size, 4)."""
    x, y = _coordinates(size)
    checks = np.where(x < 0.5, 8, 32)
    checks = np.where(y < 0.5, checks, np.where(x < 0.5, 64, 16))
    board = (np.floor(x * checks) + np.floor(y * checks)) % 2
    ring = hypot(x - 0.75, y - 0.75)
    board = np.where(ring < 0.2, np.floor(ring * 100) % 2, board)
    mark = np.floor(x * 100).astype(np.int32)
    length = np.where(mark % 10 == 0, 0.07, np.where(mark % 5 == 0, 0.05, 0.03))
    scale = np.where((x * 100 % 1 < 0.35) & (1 - y < length), 0, 1)
    return _texels(np.where(y > 0.92, scale, board)[..., None].repeat(3, -1) * 0.85 + 0.06)


@functools.cache
def _glyph(character: str) -> Floats:
    """Bits (7, 6) of a character, with an empty column after it."""
    rows = bytes.fromhex(GLYPHS.get(character, "00" * 7))
    return np.array([[row >> (4 - k) & 1 if k < 5 else 0 for k in range(6)] for row in rows], np.float32)


def text(lines: Sequence[str], scale: int) -> Floats:
    """Coverage (H, W) of lines of text, each texel of the font `scale` texels wide."""
    width = max(len(line) for line in lines)
    rows = [np.vstack([np.hstack([_glyph(c) for c in line.ljust(width)]), np.zeros((2, width * 6))]) for line in lines]
    return np.vstack(rows).astype(np.float32).repeat(scale, axis=0).repeat(scale, axis=1)


Boards: TypeAlias = tuple[tuple[tuple[str, ...], str], ...]

# The ground and ink colours of signs, and the signs: their lines and the name of their colours.
INKS = {
    "white": ((0.93, 0.93, 0.90), (0.08, 0.09, 0.15)),
    "yellow": ((0.95, 0.78, 0.05), (0.05, 0.05, 0.05)),
    "green": ((0.05, 0.45, 0.20), (0.95, 0.98, 0.95)),
    "red": ((0.75, 0.08, 0.08), (0.97, 0.97, 0.97)),
    "blue": ((0.10, 0.25, 0.55), (0.96, 0.96, 0.96)),
    "brown": ((0.72, 0.56, 0.38), (0.20, 0.12, 0.06)),
}
SIGNS: Boards = (
    (("CELL A-1",), "white"),
    (("DANGER", "ROBOT"), "yellow"),
    (("EXIT",), "green"),
    (("NO ENTRY",), "red"),
    (("BAY 07",), "blue"),
    (("400 V", "HIGH", "VOLTAGE"), "yellow"),
    (("LAB 2.14", "DYNAMICS"), "white"),
    (("WEAR", "GOGGLES"), "blue"),
    (("FRAGILE", "THIS SIDE UP", "25 KG"), "brown"),
    (("PARTS", "NO. 8341"), "brown"),
    (("MAX LOAD", "1200 KG"), "white"),
    (("FIRE",), "red"),
    (("RACK 12-B",), "white"),
    (("STOP",), "red"),
    (("SPEED 10",), "white"),
    (("KEEP CLEAR", "AT ALL TIMES"), "yellow"),
)


def sign_cell(index: int) -> tuple[float, float, float, float]:
    """Texture coordinates (u0, v0, u1, v1) of a sign of `signs`, whose cells are 256 x 256 texels, 4 in a row."""
    u, v = index % 4 / 4, index // 4 / 4
    return (u + 0.002, v + 0.002, u + 0.248, v + 0.248)


def signs(boards: Boards = SIGNS) -> Bytes:
    """Sixteen square signs with text, 4 x 4 in a texture; uint8 (1024, 1024, 4)."""
    out = np.empty((1024, 1024, 3), np.float32)
    for index, (lines, colours) in enumerate(boards):
        ground, ink = INKS[colours]
        cell = np.zeros((256, 256), np.float32)
        cell[6:250, 6:12] = cell[6:250, 244:250] = cell[6:12, 6:250] = cell[244:250, 6:250] = 1
        scale = max(1, min(224 // (6 * max(len(line) for line in lines)), 200 // (9 * len(lines))))
        letters = text(lines, scale)
        top, left = (256 - letters.shape[0]) // 2, (256 - letters.shape[1]) // 2
        cell[top : top + letters.shape[0], left : left + letters.shape[1]] = letters
        row, column = divmod(index, 4)
        out[row * 256 : row * 256 + 256, column * 256 : column * 256 + 256] = _mix(ground, ink, cell)
    return _texels(out)


def screen(seed: int, size: int = 512) -> Bytes:
    """A monitor: lines of text, a curve on a grid and bars; uint8 (size, size, 4)."""
    rng = generator(seed, "screen")
    letters = list("ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789     -.:")
    lines = ["".join(rng.choice(letters, 20)) for _ in range(26)]
    ink = np.zeros((size, size), np.float32)
    block = text(lines, 2)
    ink[16 : 16 + block.shape[0], 16 : 16 + block.shape[1]] = block[: size - 32]
    colour = _mix((0.02, 0.05, 0.09), (0.35, 0.95, 0.55), ink)
    x, y = _coordinates(size // 2)
    plot = (np.minimum((x * 10) % 1, (y * 10) % 1) < 0.06) * 0.35
    curve = np.abs(0.5 + 0.3 * sin(x * 17) * cos(x * 5) - y) < 0.012
    colour[16 : 16 + size // 2, size // 2 - 16 : size - 16] = _mix((0.02, 0.06, 0.12), (0.2, 0.6, 0.9), plot)
    colour[16 : 16 + size // 2, size // 2 - 16 : size - 16][curve] = (1.0, 0.85, 0.2)
    bars = rng.random(12)
    for k, bar in enumerate(bars):
        colour[int(size - 20 - bar * 180) : size - 20, 270 + k * 19 : 284 + k * 19] = (
            (0.9, 0.35, 0.2) if bar > 0.8 else (0.3, 0.7, 0.9)
        )
    return _texels(colour)


def planks(seed: int, count: int = 8, size: int = 512) -> Bytes:
    """Boards along v with wood grain, knots and gaps, `count` across; uint8 (size, size, 4)."""
    rng = generator(seed, "planks")
    x, _ = _coordinates(size)
    board = np.floor(x * count).astype(np.int32) % count
    warp = fractal(size, rng, 1.4, (0.12, 1))
    fine = fractal(size, rng, 0.4, (0.02, 1))
    rings = 0.5 + 0.5 * sin((warp * 9 + x * count * 1.5 + rng.random(count, np.float32)[board] * 6) * 6.28)
    tone = 0.25 * rng.random(count, np.float32)[board] + 0.4 * rings + 0.6 * (fine - 0.5) + 0.2
    edge = np.minimum(x * count % 1, 1 - x * count % 1)
    gap = np.clip(edge / 0.03, 0.12, 1)
    return _texels(_mix((0.30, 0.20, 0.12), (0.56, 0.41, 0.26), tone) * gap[..., None])


def cardboard(seed: int, size: int = 256) -> Bytes:
    """Corrugated cardboard; uint8 (size, size, 4)."""
    rng = generator(seed, "cardboard")
    x, _ = _coordinates(size)
    ridge = 0.5 + 0.5 * sin(x * 2 * np.pi * 64)
    shade = 0.80 + 0.16 * fractal(size, rng, 0.8) + 0.07 * ridge
    return _texels(shade[..., None] * np.array([0.78, 0.60, 0.41], np.float32))


def _cells(size: int, count: int, rng: draws.Generator) -> tuple[Array, Array, Ints]:
    """Seamless irregular cells: distances to the nearest and second nearest point, in cells, and the cell's index."""
    points = rng.random((count, count, 2), np.float32) * 0.8 + 0.1
    x, y = _coordinates(size)
    gx, gy = np.floor(x * count).astype(np.int32), np.floor(y * count).astype(np.int32)
    near = np.full((size, size), 9, np.float32)
    second, index = near.copy(), np.zeros((size, size), np.int32)
    for oy in (-1, 0, 1):
        for ox in (-1, 0, 1):
            number = (gy + oy) % count * count + (gx + ox) % count
            across = points[:, :, 0].ravel()[number] + (gx + ox - x * count)
            along = points[:, :, 1].ravel()[number] + (gy + oy - y * count)
            away = across * across + along * along
            second = np.minimum(second, np.maximum(near, away))
            index = np.where(away < near, number, index)
            near = np.minimum(near, away)
    return np.sqrt(near), np.sqrt(second), index


def cobbles(seed: int, size: int = 512) -> tuple[Bytes, Bytes]:
    """Rounded field stones in mortar (a tile of 2 m holds 9 x 9) and their normal map; uint8 (size, size, 4) each."""
    rng = generator(seed, "cobbles")
    near, second, index = _cells(size, 9, rng)
    dome = np.clip((second - near) / 0.35, 0, 1)
    tone = rng.random(81, np.float32)[index]
    grain = fractal(size, rng, 0.7)
    stone = _mix((0.40, 0.39, 0.37), (0.60, 0.57, 0.52), tone) * (0.72 + 0.5 * grain)[..., None]
    return _texels(_mix((0.30, 0.27, 0.22), stone, dome)), normal_map(np.sqrt(dome) * 0.03 + grain * 0.008, 2 / size)


def paving(seed: int, size: int = 512) -> tuple[Bytes, Bytes, Bytes]:
    """Trodden cobbles after rain: colours, normal map and roughness, uint8 (size, size, 4) each.

    Stones are polished; in wet patches they are dark and water stands in the joints, level.
    """
    colour, _ = cobbles(seed, size)
    rng = generator(seed, "cobbles")
    near, second, index = _cells(size, 9, rng)
    dome = np.clip((second - near) / 0.35, 0, 1)
    tone = rng.random(81, np.float32)[index]
    wet = np.clip(fractal(size, generator(seed, "rain"), 1.5) * 4 - 1.7, 0, 1)
    water = np.clip((wet * 0.75 - np.sqrt(dome)) * 6 + 1, 0, 1)
    height = np.maximum(np.sqrt(dome), wet * 0.75) * 0.03
    dark = 1 - 0.45 * wet - 0.25 * water
    rough = _blend(0.85 - 0.30 * dome + 0.2 * (tone - 0.5), 0.35, wet)
    shade = colour[..., :3].astype(np.float32) / 255 * dark[..., None]
    return _texels(shade), normal_map(height, 2 / size), _wear(_blend(rough, 0.06, water))


def mud(seed: int, size: int = 512) -> tuple[Bytes, Bytes]:
    """Trodden earth after rain: colours and roughness, uint8 (size, size, 4) each.

    Where it is damp it is dark, and in the middle stands water.
    """
    earth = dirt(seed, size)[..., :3].astype(np.float32) / 255
    depth = fractal(size, generator(seed, "rain on earth"), 1.6)
    damp, water = np.clip(depth * 5 - 2.6, 0, 1), np.clip(depth * 12 - 8.4, 0, 1)
    rough = _blend(_blend(0.95, 0.5, damp), 0.06, water)
    return _texels(earth * (1 - 0.35 * damp - 0.2 * water)[..., None]), _wear(rough)


def grass(seed: int, size: int = 512) -> Bytes:
    """Meadow from above: short strokes in many greens; uint8 (size, size, 4)."""
    rng = generator(seed, "grass")
    blades = fractal(size, rng, 0.45, (0.35, 1)) * 0.5 + fractal(size, rng, 0.45, (1, 0.35)) * 0.5
    patches = fractal(size, rng, 1.3)
    colour = _mix((0.21, 0.25, 0.12), (0.45, 0.47, 0.26), np.clip(blades * 1.5 - 0.25, 0, 1))
    return _texels(
        _mix(colour, colour * np.array([1.12, 1.0, 0.8], np.float32), patches) * (0.75 + 0.5 * patches)[..., None]
    )


def dirt(seed: int, size: int = 512) -> Bytes:
    """Trodden earth with pebbles; uint8 (size, size, 4)."""
    rng = generator(seed, "dirt")
    near, _, index = (np.tile(part, (2, 2)) for part in _cells(size // 2, 12, rng))
    pebble = (near < 0.24) * (rng.random(144, np.float32)[index] > 0.55)
    earth = _mix((0.34, 0.26, 0.18), (0.55, 0.45, 0.32), fractal(size, rng, 0.8))
    stone = _mix((0.45, 0.42, 0.38), (0.66, 0.62, 0.56), rng.random(144, np.float32)[index])
    return _texels(_mix(earth, stone * (1.1 - near * 1.5)[..., None], pebble.astype(np.float32)))


def bark(seed: int, size: int = 512) -> Bytes:
    """Furrowed bark along v; uint8 (size, size, 4)."""
    rng = generator(seed, "bark")
    ridge = np.abs(fractal(size, rng, 0.9, (0.25, 1.5)) - 0.5) * 3
    grain = fractal(size, rng, 0.5)
    return _texels(_mix((0.17, 0.13, 0.09), (0.45, 0.37, 0.28), np.clip(ridge, 0, 1)) * (0.7 + 0.6 * grain)[..., None])


def shingle(seed: int, size: int = 512) -> Bytes:
    """Split wood for shingles, weathered grey, grain along v; uneven dark lower edges every eighth; uint8
    (size, size, 4)."""
    rng = generator(seed, "shingle")
    _, y = _coordinates(size)
    grain = fractal(size, rng, 0.5, (0.04, 1))
    stain = fractal(size, rng, 1.2)
    colour = _mix((0.24, 0.20, 0.17), (0.52, 0.46, 0.40), np.clip(grain * 1.4 - 0.2, 0, 1))
    edge = 0.75 + 0.25 * np.clip((1 - (y * 8 % 1)) * 5, 0, 1)
    return _texels(colour * (0.65 + 0.7 * stain)[..., None] * edge[..., None])


def plaster(seed: int, size: int = 512) -> Bytes:
    """Lime plaster over daub, with straw and cracks; uint8 (size, size, 4)."""
    rng = generator(seed, "plaster")
    stain, grain = fractal(size, rng, 1.3), fractal(size, rng, 0.5)
    crack = np.clip(1 - np.abs(fractal(size, rng, 1.1) - 0.5) * 90, 0, 1)
    straw = (fractal(size, rng, 0.35, (1, 0.1)) > 0.93) * 0.1
    shade = 0.66 + 0.14 * grain + 0.18 * (stain - 0.5) - 0.25 * crack - straw
    return _texels(shade[..., None] * np.array([1.0, 0.95, 0.83], np.float32))


def cloth(size: int = 256) -> Bytes:
    """Woven stripes of red and cream; uint8 (size, size, 4)."""
    x, y = _coordinates(size)
    stripe = ((x * 8) % 1 < 0.5).astype(np.float32) * np.ones_like(y)
    weave = 0.85 + 0.15 * (sin(x * 2 * np.pi * 64) * sin(y * 2 * np.pi * 64) > 0)
    return _texels(_mix((0.80, 0.75, 0.62), (0.58, 0.14, 0.11), stripe) * weave[..., None])


class _Leaf(NamedTuple):
    """A pointed ellipse about (x, y), turned by an angle in radians; lengths are shares of the picture's side."""

    x: float
    y: float
    angle: float
    length: float
    width: float
    colour: ArrayLike


def _stamped(size: int, leaves: list[_Leaf], ground: ArrayLike) -> Bytes:
    """Leaves over a transparent ground colour."""
    colour = np.broadcast_to(np.asarray(ground, np.float32), (size, size, 3)).copy()
    alpha = np.zeros((size, size), np.float32)
    turns = np.stack(sin_cos(np.array([leaf.angle for leaf in leaves])), axis=1).tolist()
    for (cx, cy, _, length, width, tint), (sine, cosine) in zip(leaves, turns, strict=True):
        reach_x = int((length * abs(cosine) + width * abs(sine)) * size / 2) + 2
        reach_y = int((length * abs(sine) + width * abs(cosine)) * size / 2) + 2
        x0, y0 = int(cx * size), int(cy * size)
        rows = slice(max(0, y0 - reach_y), min(size, y0 + reach_y))
        columns = slice(max(0, x0 - reach_x), min(size, x0 + reach_x))
        u = (np.arange(columns.start, columns.stop) + 0.5)[None, :] / size - cx
        v = (np.arange(rows.start, rows.stop) + 0.5)[:, None] / size - cy
        along = (u * cosine + v * sine) / (length / 2)
        across = (v * cosine - u * sine) / (width / 2)
        inside = np.abs(across) < 1 - along * along
        vein = 0.8 + 0.3 * np.clip(np.abs(across) * 4, 0, 1) - 0.12 * (np.abs(across) % 0.5 < 0.1)
        colour[rows, columns][inside] = np.asarray(tint, np.float32) * vein[inside][:, None]
        alpha[rows, columns][inside] = 1
    return _texels(colour, alpha)


def leaves(seed: int, size: int = 512) -> Bytes:
    """A twig full of leaves, cut out by alpha; uint8 (size, size, 4)."""
    rng = generator(seed, "leaves")
    stamps = [_Leaf(0.5, 0.62, np.pi / 2, 0.7, 0.03, (0.25, 0.19, 0.12))]
    for _ in range(150):
        r, a = 0.43 * np.sqrt(rng.random()), rng.uniform(0, 2 * np.pi)
        tint = np.array((0.24, 0.38, 0.11)) * rng.uniform(0.6, 1.25) + np.array((0.10, 0.04, 0.0)) * rng.random()
        stamps.append(_Leaf(0.5 + r * cos(a), 0.5 + r * sin(a), a + rng.normal(0, 0.7), 0.13, 0.06, tint))
    return _stamped(size, stamps, (0.22, 0.33, 0.11))


def needles(seed: int, size: int = 512) -> Bytes:
    """A fir branch pointing down in the image, cut out by alpha; uint8 (size, size, 4)."""
    rng = generator(seed, "needles")
    stamps = []
    for k in range(130):
        y = 0.03 + 0.93 * k / 130
        side = 1 if k % 2 else -1
        length = (0.42 * (1 - y) + 0.08) * rng.uniform(0.7, 1.1)
        angle = np.pi / 2 - side * rng.uniform(0.7, 1.1)
        tint = np.array((0.13, 0.26, 0.15)) * rng.uniform(0.6, 1.35)
        x, y = 0.5 + cos(angle) * length / 2, min(0.98, y + sin(angle) * length / 2)
        stamps.append(_Leaf(x, y, angle, length, 0.034, tint))
    stamps.append(_Leaf(0.5, 0.5, np.pi / 2, 0.98, 0.03, (0.24, 0.18, 0.12)))
    return _stamped(size, stamps, (0.12, 0.22, 0.13))


def blades(seed: int, size: int = 512) -> Bytes:
    """A tuft of grass blades growing from the lower edge, cut out by alpha; uint8 (size, size, 4)."""
    rng = generator(seed, "blades")
    x = (np.arange(size, dtype=np.float32) + 0.5) / size
    colour = np.broadcast_to(np.array((0.30, 0.38, 0.14), np.float32), (size, size, 3)).copy()
    alpha = np.zeros((size, size), np.float32)
    up = 1 - x
    for _ in range(70):
        root, lean, tall = rng.uniform(0.12, 0.88), rng.normal(0, 0.22), rng.uniform(0.45, 0.98)
        tint = np.array((0.38, 0.47, 0.17)) * rng.uniform(0.65, 1.25) + np.array((0.12, 0.06, 0)) * rng.random()
        t = np.clip(up / tall, 0, 1)
        centre = root + lean * t * t
        half = 0.013 * (1 - t) * (up < tall)
        low, high = int(size * max(0, centre.min() - 0.02)), int(size * (centre.max() + 0.02)) + 1
        inside = np.abs(x[None, low:high] - centre[:, None]) < half[:, None]
        row, column = np.nonzero(inside)
        colour[row, low + column] = (0.55 + 0.5 * t[row])[:, None] * tint
        alpha[row, low + column] = 1
    return _texels(colour, alpha)
