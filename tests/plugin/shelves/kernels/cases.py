"""Cases of the shelves packer: cells of all sizes, and cells that differ as much as they can."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.kernels.case import Bound, Cost, Result, Trial, case, seeded

from ..cells import LEVELS, place_cells
from .emit import emit_samples, emit_samples_twin

if TYPE_CHECKING:
    from shading_atlas_bench import Samples
    from shading_atlas_bench.kernels.device import Device

WIDTH = 1024


@case({"emit.emit_samples": Cost("n", "24*t + 20*n")}, size=20_000, checked=500, typical=Bound(ulp=1))
def samples(device: Device, kind: str, size: int) -> Trial:
    """Real values are quotients, rounded once. Adversarial: one largest cell among cells of one texel."""
    rng = seeded(kind)
    levels = rng.integers(0, LEVELS, size).astype(np.int32)
    if kind == "adversarial":
        levels[:] = 0
        levels[size // 2] = LEVELS - 1
    ids, lengths = np.arange(7, size + 7, dtype=np.int32), rng.random(size, np.float32)
    cells = place_cells(levels, WIDTH)

    def run() -> Samples:
        return emit_samples(device, ids, cells, lengths, WIDTH, "gather/emit")

    def results() -> list[Result]:
        found = run()
        arrays = (found.triangle, found.bary1, found.bary2, found.footprint, found.texel)
        expected = emit_samples_twin(ids, cells, lengths, WIDTH)
        return [Result(array.get()[: found.count], twin) for array, twin in zip(arrays, expected, strict=True)]

    return Trial({"n": run().count, "t": size}, run, results)
