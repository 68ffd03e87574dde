"""Cases of the roofline's own kernels."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Floats
from shading_atlas_bench.kernels.case import Bound, Cost, Result, Trial, case, seeded
from shading_atlas_bench.kernels.roofline.roofline import CHAINS, STEPS, copy, multiply_add, multiply_add_twin

if TYPE_CHECKING:
    from shading_atlas_bench.kernels.device import Device


def _values(kind: str, size: int) -> Floats:
    rng = seeded(kind)
    scale = 10.0 ** rng.uniform(-38, 37, size) if kind == "adversarial" else 1
    return (rng.normal(size=size) * scale).astype(np.float32)


@case({"roofline.copy": Cost("n", "8*n")}, 1 << 22)
def copying(device: Device, kind: str, size: int) -> Trial:
    values = _values(kind, size)
    source, target = device.upload(values), device.empty(size, np.float32)

    def results() -> list[Result]:
        copy(device, source, target)
        return [Result(target.get(), values)]

    return Trial({"n": size}, lambda: copy(device, source, target), results)


@case(
    {"roofline.multiply_add": Cost("n", "8*n", f"2*{CHAINS}*{STEPS}*n")},
    1 << 17,
    typical=Bound(2),
    adversarial=Bound(100),  # 256 roundings, one after the other
)
def arithmetic(device: Device, kind: str, size: int) -> Trial:
    values = _values(kind, size)
    working = device.upload(values)

    def results() -> list[Result]:
        fresh = device.upload(values)
        multiply_add(device, fresh)
        return [Result(fresh.get(), multiply_add_twin(values))]

    return Trial({"n": size}, lambda: multiply_add(device, working), results)
