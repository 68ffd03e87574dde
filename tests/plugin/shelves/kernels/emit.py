"""The shading samples of square cells: the launcher of emit.cl, and its twin."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench import Samples
from shading_atlas_bench.arithmetic.arrays import Array, Floats, Ints

from ..cells import Cells

if TYPE_CHECKING:
    from shading_atlas_bench.kernels.device import Device

HERE = Path(__file__).parent


def emit_samples(device: Device, ids: Ints, cells: Cells, lengths: Floats, width: int, stage: str) -> Samples:
    """The samples of triangles in their cells, in an atlas `width` texels wide.

    ids: int32 (n), of the triangles. lengths: float32 (n), of their longest edges on the surface, in scene units.
    """
    sides = cells.sides.astype(np.int64)
    counts = sides * sides - (sides - 1) * (sides - 2) // 2  # a square without what lies beyond its diagonal
    first = np.cumsum(counts) - counts
    samples = Samples.allocate(device, int(counts.sum()))
    inputs = (ids, cells.levels, cells.columns, cells.rows, first.astype(np.int32), lengths)
    outputs = (samples.triangle, samples.bary1, samples.bary2, samples.footprint, samples.texel)
    kernel = device.build(HERE / "emit.cl").emit_samples
    device.launch(stage, kernel, len(ids), len(ids), width, *map(device.upload, inputs), *outputs)
    return samples


def emit_samples_twin(ids: Ints, cells: Cells, lengths: Floats, width: int) -> list[Array]:
    """The same on the host, in float64: triangle, bary1, bary2, footprint and texel of all samples."""
    parts: list[list[Array]] = []
    for i, side in enumerate(cells.sides.tolist()):
        row, column = np.nonzero(np.add.outer(np.arange(side), np.arange(side)) <= side)
        last = max(side - 1, 1)
        texel = (cells.rows[i] + row) * width + cells.columns[i] + column
        triangle, footprint = np.full(len(row), ids[i]), np.full(len(row), float(lengths[i]) / side)
        parts.append([triangle, column / last, row / last, footprint, texel])
    return [np.concatenate(columns) for columns in zip(*parts, strict=True)]
