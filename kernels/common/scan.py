"""Exclusive prefix sum of int32 values on the device."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic import arrays
from shading_atlas_bench.arithmetic.arrays import Longs

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device

RUNS_ON_A_GPU = 16384  # enough work-items to fill one; a CPU is best served by `Device.chunks` long runs


def exclusive_scan(device: Device, values: Array, count: int, stage: str = "scan") -> tuple[Array, int]:
    """The sums of all earlier values, and the sum of all.

    values: int32 device array, of which the first `count` are used. Returns the offsets, a new int32 device array
    (count), and the total. Waits for the device, because the total goes to the host. The same result for every
    number of runs. Raises ValueError if the values sum to 2^31 or more.
    """
    if count <= 0:
        return device.empty(0, np.int32), 0
    kernels = device.build("common/scan.cl")
    local = 1 if device.is_cpu else None
    run = -(-count // (device.chunks if device.is_cpu else RUNS_ON_A_GPU))
    runs = -(-count // run)
    sums = device.recycled(runs, np.int64)
    device.launch(stage, kernels.run_sums, runs, count, run, values, sums, local=local)
    ends = np.cumsum(sums.get())
    total = int(ends[-1])
    if total > np.iinfo(np.int32).max:
        raise ValueError(f"The {count} values to scan for {stage} sum to {total}, which is beyond 32 bits.")
    bases = device.upload(np.concatenate([[0], ends[:-1]]).astype(np.int32))
    offsets = device.recycled(count, np.int32)
    device.launch(stage, kernels.run_offsets, runs, count, run, values, bases, offsets, local=local)
    return offsets, total


def exclusive_scan_twin(values: arrays.Array) -> tuple[Longs, int]:
    """The same for a host array."""
    ends = np.cumsum(values, dtype=np.int64)
    return np.concatenate([[0], ends])[: len(values)], int(ends[-1]) if len(values) else 0
