"""The device's roofline: its copy bandwidth and its arithmetic rate, by two small kernels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Doubles, Floats

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device

WIDTH = 16  # floats of a vector
CHAINS, STEPS = 8, 256
A, B = 0.75, 0.5
COPIED = 1 << 24  # floats: beyond any cache
VECTORS = 1 << 14
RUNS = 5


@dataclass(frozen=True)
class Roofline:
    """bandwidth: bytes per second read and written while copying. arithmetic: additions and multiplications of
    float32 per second."""

    bandwidth: float
    arithmetic: float


def copy(device: Device, source: Array, target: Array) -> None:
    """Copy `source` to `target`, float32 (n), n a multiple of 16, as many work-items as the device likes."""
    count = len(source) // WIDTH
    run, local = (-(-count // device.chunks), 1) if device.is_cpu else (1, None)
    kernel = device.build("roofline/roofline.cl", CHAINS=CHAINS, STEPS=STEPS).copy
    device.launch("roofline/copy", kernel, -(-count // run), count, run, source, target, local=local)


def multiply_add(device: Device, values: Array) -> None:
    """Replace each of float32 (n), n a multiple of 16, by the sum over k < CHAINS of STEPS steps x = A x + B from
    x + k."""
    kernel = device.build("roofline/roofline.cl", CHAINS=CHAINS, STEPS=STEPS).multiply_add
    count = len(values) // WIDTH
    device.launch("roofline/arithmetic", kernel, count, count, A, B, values)


def multiply_add_twin(values: Floats) -> Doubles:
    """The same on the host."""
    x = values.astype(np.float64)[:, None] + np.arange(CHAINS)
    for _ in range(STEPS):
        x = A * x + B
    totals: Doubles = x.sum(axis=1)
    return totals


def measure(device: Device) -> Roofline:
    """The best of several runs, in the device's own time."""
    source, target = device.zeros(COPIED, np.float32), device.zeros(COPIED, np.float32)
    values = device.zeros(VECTORS * WIDTH, np.float32)
    best: dict[str, float] = {}
    for _ in range(RUNS):
        with device.record() as record:
            copy(device, source, target)
            multiply_add(device, values)
        for stage, milliseconds in record.milliseconds.items():
            best[stage] = min(milliseconds, best.get(stage, np.inf))
    flops = 2 * VECTORS * WIDTH * CHAINS * STEPS
    return Roofline(2 * source.nbytes * 1e3 / best["roofline/copy"], flops * 1e3 / best["roofline/arithmetic"])
