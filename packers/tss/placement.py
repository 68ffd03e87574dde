"""What the server decided about a frame, on the host: the form and the place of each primitive."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic.arrays import Floats, Ints
    from shading_atlas_bench.packers.tss.mapping import Mapped


@dataclass(frozen=True)
class Placement:
    """camera: float32 (21), the server's. scale: texels per pixel. pieces: int32 (rows). forms (m, 4), places (m, 2),
    firsts (m): int32, see packers.tss.kernels. ranks: int32 (m), of first items. regions: int32 (B, 6), of all bins.
    """

    camera: Floats
    scale: float
    pieces: Ints
    forms: Ints
    places: Ints
    firsts: Ints
    ranks: Ints
    regions: Ints


def read_placement(mapped: Mapped, places: Array, camera: Floats) -> Placement:
    """What was decided, brought to the host. places: int32 (m, 2) on the device. camera: float32 (21)."""
    primitives, count = mapped.primitives, mapped.primitives.count

    def table(array: Array, width: int) -> Ints:
        rows: Ints = array.get().reshape(-1)[: width * count].reshape(count, width)
        return rows

    first_ranks = table(mapped.items.ranks, 2)[mapped.items.turns.get()[:count], 0]
    return Placement(
        camera=camera,
        scale=mapped.scale,
        pieces=primitives.pieces.get()[: primitives.rows],
        forms=table(mapped.forms, 4),
        places=table(places, 2),
        firsts=primitives.firsts.get()[:count],
        ranks=first_ranks,
        regions=mapped.regions.get(),
    )


def find_lost(placement: Placement, parents: Ints) -> Ints:
    """Rows, int32 (n), of the triangles that have not all of their items placed; takes the places of the others from
    them. parents: int32 (m), the primitives' rows."""
    forms, places = placement.forms, placement.places
    halves = forms[:, 0] < 0
    missing = (places[:, 0] < 0) & (~halves | (forms[:, 2] > 0)) | halves & (forms[:, 3] > 0) & (places[:, 1] < 0)
    lost = np.unique(parents[missing])
    places[np.isin(parents, lost)] = -1
    return lost
