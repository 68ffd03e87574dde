"""The case of the alpha test."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.kernels.case import Cost, Result, Trial, case, seeded
from shading_atlas_bench.kernels.texture.inputs import masked_soup
from shading_atlas_bench.kernels.texture.mask import margin_twin, mask_defines

if TYPE_CHECKING:
    from shading_atlas_bench.kernels.device import Device


@case({"mask.alpha_test": Cost("n", "20*n", "40*n")}, 1 << 20, 1 << 17)
def masking(device: Device, kind: str, size: int) -> Trial:
    """Adversarial: footprints over 16 magnitudes, weights outside the triangle, vertices that fade. Ties of alpha and
    threshold differ."""
    rng, hard = seeded(kind), kind == "adversarial"
    mask, material_ids = masked_soup(device, faded=hard)
    triangles = rng.choice(np.flatnonzero(material_ids), size).astype(np.int32)
    b1, b2 = rng.uniform(-1 if hard else 0, 1 if hard else 0.5, (2, size)).astype(np.float32)
    pixels = (10.0 ** (rng.uniform(-8, 8, size) if hard else rng.uniform(0, 3, size))).astype(np.float32)
    kept, kernel = device.empty(size, np.int32), device.build("texture/mask.cl", **mask_defines(mask)).alpha_test
    inputs = [device.upload(array) for array in (triangles, b1, b2, pixels)]

    def run() -> None:
        device.launch("mask", kernel, size, size, *inputs, kept, *mask.arguments)

    def results() -> list[Result]:
        run()
        return [Result(kept.get() != 0, margin_twin(mask, triangles, b1, b2, pixels) > 0)]

    return Trial({"n": size}, run, results)
