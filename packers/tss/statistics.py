"""What Tessellated Shading Streaming reports of a frame beyond the common columns."""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.packers.tss.kernels.emit import row_length
from shading_atlas_bench.packers.tss.kernels.forms import OVERSAMPLED
from shading_atlas_bench.packers.tss.kernels.pattern import LEVELS, cell_count, vertex_count
from shading_atlas_bench.packers.tss.placement import Placement

if TYPE_CHECKING:
    from shading_atlas_bench.arithmetic.arrays import Ints, Longs

CELLS = np.array([1, *(cell_count(level) for level in range(1, LEVELS + 1))])
COPIES = CELLS - np.array([1, *(vertex_count(level) for level in range(1, LEVELS + 1))])


@cache
def half_samples(p: int, q: int) -> tuple[int, int, int]:
    """Of a right triangle with p >= q texels to its sides: samples, those inside, and the count of equation 10."""
    rows = range(q + 1)
    return sum(row_length(p, q, row) for row in rows), sum(p * (q - row) // q + 1 for row in rows), published(p, q)


def published(w: int, h: int) -> int:
    """Equation 10 with R = ceil(w / h) + 1 (equation 9 cannot be read): blocks of R rows, and borders."""
    rows = -(-w // h) + 1
    blocks = w // rows
    return rows * blocks * (2 * h - blocks - 1) // 2 + 2 * h + w + 1


def samples_by_primitive(forms: Ints, places: Ints) -> Longs:
    """Samples of each primitive, int (m): forms int32 (m, 4), places int32 (m, 2), as in Placement."""
    counts = np.where(forms[:, 0] == OVERSAMPLED, 0, CELLS[np.maximum(forms[:, 0], 0)]) * (places[:, 0] >= 0)
    for k in (0, 1):
        has = (forms[:, 0] == OVERSAMPLED) & (places[:, k] >= 0)
        sides = np.sort(forms[has][:, [1, 2 + k]], axis=1)
        pairs, index = np.unique(sides[:, 0] * 1024 + sides[:, 1], return_inverse=True)
        exact = np.array([half_samples(int(pair) % 1024, int(pair) // 1024)[0] for pair in pairs], np.int64)
        counts[has] += exact[index.reshape(-1)]
    return counts


def describe(placement: Placement) -> dict[str, float]:
    """Primitives, samples and levels by strategy."""
    placed = (placement.places >= 0).any(axis=1)
    forms, places = placement.forms[placed], placement.places[placed]
    halves = forms[:, 0] == OVERSAMPLED
    levels = forms[~halves, 0]
    by_level = np.bincount(levels, minlength=LEVELS + 1)
    sides = np.concatenate([np.column_stack([forms[halves, 1], forms[halves, 2 + k]]) for k in (0, 1)])
    sides = np.sort(sides[np.concatenate([places[halves, k] >= 0 for k in (0, 1)])], axis=1)
    pairs, number = np.unique(sides[:, 0] * 1024 + sides[:, 1], return_counts=True)
    counts = np.array([half_samples(int(pair) % 1024, int(pair) // 1024) for pair in pairs]).reshape(-1, 3)
    exact, inside, paper = (int(k) for k in (number[:, None] * counts).sum(axis=0)) if len(pairs) else (0, 0, 0)
    cut = placement.pieces > 1
    return {
        "primitives": len(placement.forms),
        "split_triangles": int(cut.sum()),
        "pieces": int(np.square(placement.pieces[cut]).sum()),
        "single_texels": int(by_level[0]),
        "lpacking_primitives": len(levels) - int(by_level[0]),
        "oversampling_primitives": int(halves.sum()),
        "oversampling_share": float(halves.mean()) if len(forms) else 0.0,
        "lpacking_samples": int((by_level * CELLS)[1:].sum()),
        "lpacking_duplicates": int((by_level * COPIES).sum()),
        "oversampling_inside": inside,
        "oversampling_outside": exact - inside,
        "oversampling_outside_share": (exact - inside) / exact if exact else 0.0,
        "oversampling_published": paper,
        "scale": placement.scale,
        **_levels(by_level),
    }


def _levels(by_level: Longs) -> dict[str, float]:
    """Primitives by level, in doublings: level_1, level_2, level_4 (3 and 4) to level_64 (33 to 64)."""
    ends = [0, *(1 << k for k in range(7))]
    return {f"level_{b}": int(by_level[a + 1 : b + 1].sum()) for a, b in pairwise(ends)}
