"""Alpha masks: where masked triangles have holes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np

from shading_atlas_bench.arithmetic import arrays
from shading_atlas_bench.arithmetic.arrays import Bytes, Doubles, Floats, Ints, Longs
from shading_atlas_bench.arithmetic.functions import log2
from shading_atlas_bench.kernels.constants import constants_of
from shading_atlas_bench.kernels.texture.buffers import WRAP, TextureImage
from shading_atlas_bench.kernels.texture.mipmap import mip_chain
from shading_atlas_bench.kernels.texture.sample import neighbours

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device

DEFINED = constants_of(Path(__file__).with_name("mask.cl"))
# Effective cutoffs, from the material's to 255, at which thresholds are known where vertices fade.
FADED = DEFINED.whole("FADED")
OFFSETS = np.array([0.125, 0.375, 0.625, 0.875], np.float32)  # where `between` looks, in texels
SMALLEST = 8  # texels on the shorter side: smaller levels cannot hold a share of holes


class MaskedMaterial(Protocol):
    """What a mask reads of a material; a masked one is there where the product of the base colour's, the texture's and
    the vertices' alpha reaches the cutoff."""

    base_colour: tuple[float, float, float, float]
    base_texture: int
    alpha_mode: str
    alpha_cutoff: float


@dataclass(frozen=True)
class HostMask:
    """The arrays of a mask on the host, each as in AlphaMask."""

    slots: Ints
    corners: Floats
    chains: Ints
    levels: Ints
    alphas: Bytes
    fades: Floats | None
    thresholds: Floats | None


@dataclass(frozen=True)
class AlphaMask:
    """Alpha masks of a list of triangles, for the alpha test of the rasteriser (mask.cl); also shipped to clients.

    slots: int32 (T), row of `corners` of a masked triangle, -1 for others.
    corners: float32 (K, 8): u, v of corner 0, u, v from there to corner 1 and to corner 2, the bits of the chain's
        number, and log2 of the square root of the triangle's area in texels.
    chains: int32 (C, 2): first row of `levels`, and how many follow it.
    levels: int32 (L, 8): first texel, width, height, bits of the threshold (0..255), wrap_s, wrap_t, bits of the finest
        level's threshold, 0. Each level's threshold keeps the share of the area that passes at the finest one, so that
        foliage keeps its density.
    alphas: uint8, the texels of all levels.
    fades: float32 (K, 4): the vertices' alpha at corner 0, from there to corner 1 and to corner 2, 0; None where it is
        1 at all vertices of masked triangles.
    thresholds: float32 (L, FADED), with `fades` only: of each level, where the vertices' alpha makes the cutoff that of
        the material (first), 255 (last) and in even steps between.
    """

    slots: Array
    corners: Array
    chains: Array
    levels: Array
    alphas: Array
    fades: Array | None
    thresholds: Array | None
    host: HostMask

    @classmethod
    def upload(
        cls,
        device: Device,
        indices: arrays.Array,
        uvs: arrays.Array,
        material_ids: arrays.Array,
        materials: Sequence[MaskedMaterial],
        textures: Sequence[TextureImage],
        keep: bool = False,
        vertex_alphas: arrays.Array | None = None,
    ) -> AlphaMask | None:
        """The masks of a scene.

        indices: int (T, 3). uvs: float (V, 2). material_ids: int (T). vertex_alphas: float (V), 0..1, None for all 1.
        Where no triangle is masked: None, or with `keep` masks of no triangle.
        """
        masked = np.array([m.alpha_mode == "mask" for m in materials], bool)
        ids = np.flatnonzero(masked[material_ids])
        if len(ids) == 0 and not keep:
            return None
        used = np.unique(material_ids[ids])
        fades = None if vertex_alphas is None else _fades(vertex_alphas[indices[ids]])
        chains, levels, alphas, sizes, thresholds = _chains([materials[i] for i in used], textures, fades is not None)
        chain = np.searchsorted(used, material_ids[ids])
        slots = np.full(len(indices), -1, np.int32)
        slots[ids] = np.arange(len(ids))
        corners = _corners(uvs[indices[ids]], chain, sizes[chain])
        return cls(
            device.upload(slots),
            device.upload(corners),
            device.upload(chains),
            device.upload(levels),
            device.upload(alphas),
            None if fades is None else device.upload(fades),
            None if thresholds is None else device.upload(thresholds),
            HostMask(slots, corners, chains, levels, alphas, fades, thresholds),
        )

    @property
    def arguments(self) -> tuple[Array, ...]:
        """What a kernel takes for MASK_PARAMETERS, arrays as in AlphaMask."""
        always = (self.slots, self.corners, self.chains, self.levels, self.alphas)
        if self.fades is None or self.thresholds is None:
            return always
        return (*always, self.fades, self.thresholds)

    def of_triangles(self, device: Device, triangles: arrays.Array) -> AlphaMask:
        """The masks of another list of triangles, given by their numbers in this one: int (n)."""
        slots = np.ascontiguousarray(self.host.slots[triangles])
        return replace(self, slots=device.upload(slots), host=replace(self.host, slots=slots))


def _corners(uvs: Floats, chain: arrays.Array, sizes: Longs) -> Floats:
    """Rows of `corners` for triangles with uvs (K, 3, 2), their chains' numbers and finest sizes (K, 2)."""
    rows = np.zeros((len(uvs), 8), np.float32)
    sides = uvs[:, 1:].astype(np.float64) - uvs[:, :1]
    rows[:, 0:2] = uvs[:, 0]
    rows[:, 2:6] = sides.reshape(-1, 4)
    rows[:, 6] = chain.astype(np.int32).view(np.float32)
    area = np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]) / 2 * sizes.prod(axis=1)
    rows[:, 7] = 0.5 * log2(np.fmax(area, 1e-12))
    return rows


def _fades(alphas: Floats) -> Floats | None:
    """Rows of `fades` for triangles whose corners have these alphas (K, 3); None where all are 1."""
    if not (alphas < 1).any():
        return None
    rows = np.zeros((len(alphas), 4), np.float32)
    rows[:, 0] = alphas[:, 0]
    rows[:, 1:3] = alphas[:, 1:].astype(np.float64) - alphas[:, :1]
    return rows


def mask_defines(mask: AlphaMask | None) -> dict[str, int]:
    """What a kernel that draws with a mask, or with none, is built with."""
    return {"MASKED": int(mask is not None), "VERTEX_ALPHA": int(mask is not None and mask.fades is not None)}


def _chains(
    materials: list[MaskedMaterial], textures: Sequence[TextureImage], faded: bool
) -> tuple[Ints, Ints, Bytes, Longs, Floats | None]:
    """Chains, levels and alphas of the materials' masks, the finest size (width, height) of each, int (C, 2), and, if
    vertices fade, thresholds (L, FADED)."""
    chains: list[tuple[int, int]] = []
    levels: list[tuple[int, ...]] = []
    alphas: list[Bytes] = []
    sizes: list[tuple[int, int]] = []
    thresholds: list[Sequence[float]] = []
    offset = 0
    for material in materials:
        texture = textures[material.base_texture] if material.base_texture >= 0 else None
        alpha = texture.texels[..., 3].astype(np.float32) if texture else np.full((1, 1), 255, np.float32)
        modes = (WRAP[texture.wrap_s], WRAP[texture.wrap_t]) if texture else (0, 0)
        # A material whose own alpha is 0 shows nothing at any cutoff above 0: its threshold is out of reach.
        cutoff = 255 * material.alpha_cutoff / max(material.base_colour[3], 1e-6)
        cutoffs = list(np.linspace(cutoff, max(cutoff, 255), FADED)) if faded else [cutoff]
        points = between(alpha)
        passing = [float(np.mean(points >= value)) for value in cutoffs]
        chain = [level for i, level in enumerate(mip_chain(alpha)) if i == 0 or min(level.shape) >= SMALLEST]
        chains.append((len(levels), len(chain) - 1))
        sizes.append((alpha.shape[1], alpha.shape[0]))
        for i, level in enumerate(chain):
            quantised = np.round(level).astype(np.uint8)
            thresholds.append(cutoffs if i == 0 else _thresholds(quantised, passing, cutoffs))
            levels.append((offset, *level.shape[::-1], _bits(thresholds[-1][0]), *modes, _bits(cutoff), 0))
            alphas.append(quantised.ravel())
            offset += level.size
    return (
        np.array(chains, np.int32).reshape(-1, 2),
        np.array(levels, np.int32).reshape(-1, 8),
        np.concatenate([np.empty(0, np.uint8), *alphas]),
        np.array(sizes, np.int64).reshape(-1, 2),
        np.array(thresholds, np.float32) if faded else None,
    )


def _bits(value: float) -> int:
    """Of a number as float32."""
    return int(np.float32(value).view(np.int32))


def _thresholds(level: Bytes, passing: Sequence[float], cutoffs: Sequence[float]) -> list[float]:
    """The thresholds that the given shares of a level's area reach."""
    points = between(level)
    return [
        float(np.quantile(points, 1 - share)) if 0 < share < 1 else 0.0 if share else float(cutoff)
        for share, cutoff in zip(passing, cutoffs, strict=True)
    ]


def between(level: arrays.Array) -> Floats:
    """A level's bilinear values at 4 x 4 points per texel, float32 (16, H, W), edges wrapped."""
    level = level.astype(np.float32)
    beside, below = np.roll(level, -1, axis=1), np.roll(level, -1, axis=0)
    both = np.roll(below, -1, axis=1)
    weights = [(x, y) for y in OFFSETS for x in OFFSETS]
    return np.stack([(level * (1 - x) + beside * x) * (1 - y) + (below * (1 - x) + both * x) * y for x, y in weights])


def margin_twin(
    mask: AlphaMask, triangles: arrays.Array, b1: arrays.Array, b2: arrays.Array, pixels: arrays.Array
) -> Doubles:
    """How far above the threshold (in 0..255, negative: a hole) alpha is at points of masked triangles, float64 (n).

    triangles: int (n); b1, b2: weights of corners 1 and 2; pixels: the triangles' areas on screen.
    """
    host = mask.host
    corners = host.corners[host.slots[triangles]]
    chains = host.chains[corners[:, 6].view(np.int32)]
    level = np.floor(corners[:, 7] - 0.5 * np.log2(np.maximum(pixels, 1e-6)) + 0.5)
    level_row = chains[:, 0] + np.clip(level, 0, chains[:, 1]).astype(int)
    rows = host.levels[level_row]
    place = corners.astype(np.float64)
    u = place[:, 0] + b1 * place[:, 2] + b2 * place[:, 4]
    v = place[:, 1] + b1 * place[:, 3] + b2 * place[:, 5]
    x0, x1, fx = neighbours(u, rows[:, 1], rows[:, 4])
    y0, y1, fy = neighbours(v, rows[:, 2], rows[:, 5])

    def alpha(x: arrays.Array, y: arrays.Array) -> Doubles:
        texels: Doubles = host.alphas[rows[:, 0] + y * rows[:, 1] + x].astype(np.float64)
        return texels

    upper = alpha(x0, y0) * (1 - fx) + alpha(x1, y0) * fx
    lower = alpha(x0, y1) * (1 - fx) + alpha(x1, y1) * fx
    threshold, cutoff = (rows[:, column].copy().view(np.float32).astype(np.float64) for column in (3, 6))
    if host.fades is not None and host.thresholds is not None:
        first, along1, along2, _ = host.fades[host.slots[triangles]].astype(np.float64).T
        wanted = cutoff / np.clip(first + b1 * along1 + b2 * along2, 1e-6, 1)
        threshold = _faded(host.thresholds[level_row].astype(np.float64), cutoff, wanted)
    margin: Doubles = upper * (1 - fy) + lower * fy - threshold
    return margin


def _faded(thresholds: Doubles, cutoff: Doubles, wanted: Doubles) -> Doubles:
    """Thresholds (n) at the cutoffs `wanted` (n), from rows (n, FADED) of levels and their materials' cutoffs (n)."""
    share = (wanted - cutoff) / np.where(cutoff < 255, 255 - cutoff, 1)
    step = np.clip(share, 0, 1) * (FADED - 1)
    first = np.minimum(step.astype(int), FADED - 2)
    low, high = (np.take_along_axis(thresholds, (first + more)[:, None], axis=1)[:, 0] for more in (0, 1))
    return np.where(wanted > 255, wanted, low + (step - first) * (high - low))
