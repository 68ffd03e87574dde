"""Limiting the depth of fragment lists (chapter 3 of the thesis)."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from shading_atlas_bench.kernels.common.scan import exclusive_scan
from shading_atlas_bench.kernels.fragments.build import Fragments
from shading_atlas_bench.kernels.samples import Samples

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic.arrays import Ints, Longs
    from shading_atlas_bench.kernels.device import Device

HERE = Path(__file__).parent

EVERY_LAYER = np.iinfo(np.int32).max
NO_THRESHOLD = 2.0  # opacity reaches 1 at most


@dataclass(frozen=True)
class Depth:
    """How deep lists go: at most `layers` fragments, none behind the one at which opacity reaches `threshold`."""

    layers: int = EVERY_LAYER
    threshold: float = NO_THRESHOLD

    @property
    def limits(self) -> bool:
        return self.layers < EVERY_LAYER or self.threshold <= 1


def limit_fragments(
    device: Device, fragments: Fragments, opacity: Array | None, depth: Depth, spans: Ints, stage: str
) -> tuple[Fragments, Array | None]:
    """The visible fragments of each pixel, to this depth.

    opacity: int32 (n), 0..255; None where every fragment is opaque. spans: int32 (height, 2), in each row the first
    pixel that keeps any, and the one behind the last. Returns the fragments kept and their opacity.
    """
    blended = () if opacity is None else (opacity,)
    kernels = device.build(HERE / "limit.cl", BLENDED=len(blended))
    pixels = fragments.pixels
    counts = device.recycled(pixels + 1, np.int32)
    device.fill(counts[pixels:], 0, stage)
    lists = (pixels, fragments.width, fragments.offsets)
    limits = (device.upload(spans), depth.layers, float(depth.threshold))
    device.launch(stage, kernels.count_kept, pixels, *lists, *limits, counts, *blended)
    offsets, total = exclusive_scan(device, counts, pixels + 1, stage)
    source = device.recycled(total, np.int32)
    device.launch(stage, kernels.list_kept, pixels, pixels, fragments.offsets, offsets, source, *blended)
    kept, depths = Samples.allocate(device, total), device.recycled(total, np.float32)
    copied = [(*_arrays(samples), z) for samples, z in ((fragments.samples, fragments.depth), (kept, depths))]
    device.launch(stage, kernels.copy_kept, total, total, source, *copied[0], *copied[1])
    picked = None
    if opacity is not None:
        picked = device.recycled(total, np.int32)
        device.launch(stage, kernels.pick, total, total, source, opacity, picked)
    return Fragments(fragments.width, fragments.height, kept, depths, offsets), picked


def _arrays(samples: Samples) -> tuple[Array, ...]:
    return samples.triangle, samples.texel, samples.bary1, samples.bary2, samples.footprint


def limit_twin(offsets: NDArray[np.integer[Any]], opacity: Ints, depth: Depth, spans: Ints, width: int) -> Longs:
    """Which fragments are kept, int64 (m) ascending; offsets int (P + 1), opacity 0..255 (n), spans int (rows, 2)."""
    kept = []
    for pixel, (first, end) in enumerate(itertools.pairwise(offsets)):
        if not spans[pixel // width, 0] <= pixel % width < spans[pixel // width, 1]:
            continue
        through, taken = 1.0, 0
        for at in range(first, end):
            if opacity[at] == 0:
                continue
            kept.append(at)
            taken += 1
            through *= 1 - opacity[at] / 255
            if taken >= depth.layers or 1 - through >= depth.threshold:
                break
    return np.array(kept, np.int64)
