"""The case of filling an atlas."""

from __future__ import annotations

from typing import TYPE_CHECKING

from shading_atlas_bench.kernels.case import Cost, Result, Trial, case, seeded
from shading_atlas_bench.kernels.fill.fill import Filler, fill_twin
from shading_atlas_bench.kernels.inputs.atlases import random_atlas

if TYPE_CHECKING:
    from shading_atlas_bench.kernels.device import Device

COSTS = {
    "fill.pull": Cost("4*n/3", "4*n*5/3"),
    "fill.push": Cost("n/3", "4*n*3/4"),
    "fill.finish": Cost("n", "4*n*13/4"),
}


@case(COSTS, 1024)
def filling(device: Device, kind: str, size: int) -> Trial:
    """Adversarial: one texel in a thousand owned, sides that no power of two divides."""
    rng, hard = seeded(kind), kind == "adversarial"
    height, width, owned = (size - 1, size + 3, 0.001) if hard else (size, size, 0.6)
    atlas = random_atlas(rng, height, width, owned)
    uploaded, filler = device.upload(atlas), Filler(device, width, height)

    def results() -> list[Result]:
        filler.reset()
        return [Result(filler.fill(uploaded).get(), fill_twin(atlas, None))]

    return Trial({"n": height * width}, lambda: filler.fill(uploaded), results)
