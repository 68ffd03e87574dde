"""What becomes of each primitive: a single texel, an L of some level, or two right triangles."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.kernels.constants import constants_of
from shading_atlas_bench.packers.tss.kernels.bins import LONGEST, Bins
from shading_atlas_bench.packers.tss.kernels.pattern import LEVELS

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic.arrays import Bools, Floats, Longs
    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.packers.tss.kernels.bins import BinTables
    from shading_atlas_bench.packers.tss.kernels.primitives import Primitives

HERE = Path(__file__).parent

STAGE = "structs/forms"
DEFINED = constants_of(HERE / "limits.cl")
OVERSAMPLED = DEFINED.whole("OVERSAMPLED")  # as the kind of a form


def choose_strategies(
    device: Device, primitives: Primitives, scale: float, threshold: float, turns: Array, bins: BinTables
) -> tuple[Array, Array]:
    """Forms int32 (count, 4) and the bins of their items int32 (count, 2).

    scale: texels per pixel. threshold: longest edge over height from which a primitive is
    slanted (0: all, infinity: none). turns: int32 (count), when each primitive is placed.
    A form is kind, height, texels before and texels after the foot; kind is OVERSAMPLED for right triangles, else the
    level of the L, 0 for a single texel, which pieces of cut triangles never are. Bins are listed by turn, -1 for an
    item that a primitive does not have.
    """
    count, known = primitives.count, (primitives.shapes, primitives.parents, primitives.pieces)
    forms, items = device.recycled((count, 4), np.int32), device.recycled((count, 2), np.int32)
    tables = (turns, bins.of_level, bins.of_size, bins.size_class, bins.size_classes)
    kernel = device.build(HERE / "forms.cl").choose_strategies
    device.launch(STAGE, kernel, count, count, *known, float(scale), float(threshold), *tables, forms, items)
    return forms, items


def choose_strategies_twin(
    shapes: Floats, cut: Bools, scale: float, threshold: float, bins: Bins
) -> tuple[Longs, Longs]:
    """The same on the host, with bins in the order of primitives; cut: bool (n), pieces of cut triangles.

    Computes in float32 where it rounds.
    """
    level, base, height, foot = shapes.astype(np.float32).T
    factor = np.float32(scale)
    area = np.rint(level * factor).astype(int)
    tiny = area < 1
    width = np.where(tiny, 1, np.rint(np.clip(base * factor, 1, LONGEST))).astype(int)
    tall = np.where(tiny, 1, np.rint(np.clip(height * factor, 1, LONGEST))).astype(int)
    before = np.rint(foot * width.astype(np.float32)).astype(int)
    with np.errstate(invalid="ignore"):  # no height is slanted beyond infinity
        slanted = (base > np.float32(threshold) * height) & ~(tiny & (threshold > 0))
    kind = np.where(tiny & ~cut, 0, np.where(slanted, OVERSAMPLED, np.clip(area, 1, LEVELS)))
    halves = kind == OVERSAMPLED
    forms = np.stack([kind, halves * tall, halves * before, halves * (width - before)], axis=1)
    items = np.full((len(shapes), 2), -1)
    items[~halves, 0] = bins.of_level[kind[~halves]]
    for k in (0, 1):
        side = forms[:, 2 + k]
        p, q = np.maximum(side, forms[:, 1]), np.minimum(side, forms[:, 1])
        has = halves & (side > 0)
        items[has, k] = bins.of_size[bins.size_class[q[has]], bins.size_class[p[has]]]
    return forms, items
