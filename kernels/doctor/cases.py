"""The case of the doctor's kernel."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kernels.case import Cost, Result, Trial, case, seeded
from kernels.doctor.smoke import DEGREE, smoke, smoke_twin

if TYPE_CHECKING:
    from kernels.device import Device


@case({"smoke.smoke": Cost("n", "12*n", f"{2 * DEGREE}*n")}, 1 << 20)
def polynomial(device: Device, kind: str, size: int) -> Trial:
    """Adversarial: about the roots of (x - 1)^12, where terms of up to 924 cancel."""
    rng = seeded(kind)
    x = rng.uniform(-1, 1, size).astype(np.float32)
    coefficients = rng.uniform(-1, 1, DEGREE + 1)
    if kind == "adversarial":
        x, coefficients = (1 - 0.1 * x**2).astype(np.float32), np.poly(np.ones(DEGREE))[::-1]

    def results() -> list[Result]:
        return [Result(*pair) for pair in zip(smoke(device, x, coefficients), smoke_twin(x, coefficients), strict=True)]

    return Trial({"n": size}, lambda: smoke(device, x, coefficients), results)
