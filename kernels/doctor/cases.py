"""Cases of the doctor's kernels."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Array
from shading_atlas_bench.kernels.case import Bound, Cost, Result, Trial, case, seeded
from shading_atlas_bench.kernels.doctor.elementary import elementary, elementary_twin
from shading_atlas_bench.kernels.doctor.smoke import DEGREE, smoke, smoke_twin

if TYPE_CHECKING:
    from shading_atlas_bench.kernels.device import Device


# The bound of the adversarial input is that of terms of up to 924, beside values of at most 10^-12.
@case({"smoke.smoke": Cost("n", "12*n", f"{2 * DEGREE}*n")}, 1 << 20, typical=Bound(8), adversarial=Bound(1.5e15))
def polynomial(device: Device, kind: str, size: int) -> Trial:
    """Adversarial: about the roots of (x - 1)^12, where terms of up to 924 cancel."""
    rng = seeded(kind)
    x = rng.uniform(-1, 1, size).astype(np.float32)
    coefficients: Array = rng.uniform(-1, 1, DEGREE + 1)
    if kind == "adversarial":
        x, coefficients = (1 - 0.1 * x**2).astype(np.float32), np.poly(np.ones(DEGREE))[::-1]

    def results() -> list[Result]:
        (values, hashes), (expected, expected_hashes) = smoke(device, x, coefficients), smoke_twin(x, coefficients)
        return [Result(values, expected), Result(hashes, expected_hashes)]

    return Trial({"n": size}, lambda: smoke(device, x, coefficients), results)


@case({"elementary.elementary": Cost("n", "20*n")}, 1 << 20, typical=Bound(2.5))
def functions(device: Device, kind: str, size: int) -> Trial:
    """Adversarial: about 1 for the logarithm, about whole numbers for the power."""
    rng, size = seeded(kind), -(-size // 8) * 8
    first, second = rng.uniform(-20, 20, size), np.exp2(rng.uniform(-20, 20, size)) * rng.choice([-1, 1], size)
    if kind == "adversarial":
        first = np.rint(first) + 1e-6 * rng.normal(size=size)
        second = rng.choice([-1, 1], size) * (1 + 1e-6 * rng.normal(size=size))
    x, y = first.astype(np.float32), second.astype(np.float32)

    def results() -> list[Result]:
        return [Result(*pair) for pair in zip(elementary(device, x, y), elementary_twin(x, y), strict=True)]

    return Trial({"n": size}, lambda: elementary(device, x, y), results)
