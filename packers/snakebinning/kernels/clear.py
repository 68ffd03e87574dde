"""What is left of each strip, in its average colour (section 3.8)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic.arrays import Bytes
    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.packers.snakebinning.kernels.superblocks import Superblocks

HERE = Path(__file__).parent


def clear_strips(device: Device, blocks: Superblocks, atlas: Array) -> None:
    """Give texels of `atlas`, uint8 (H, W, 4), that lie in a strip and have alpha 0 the mean of its shaded ones.

    Alpha stays 0. The mean is over bytes, rounded to the nearest.
    """
    live = blocks.live_superblocks()
    corners = device.upload(np.stack([live[name] for name in ("x", "y", "width")], axis=1))
    count, kernel = blocks.numbers["strips"], device.build(HERE / "clear.cl").clear_strips
    device.launch("gather/average", kernel, count, count, blocks.strips, corners, atlas.shape[1], atlas)


def clear_strips_twin(strips: NDArray[np.void], blocks: NDArray[np.void], atlas: Bytes) -> Bytes:
    """The same for STRIP and SUPERBLOCK records."""
    cleared = atlas.copy()
    for strip in strips[(strips["bin"] >= 0) & (strips["superblock"] >= 0)]:
        block = blocks[strip["superblock"]]
        top = block["y"] + strip["y"]
        part = cleared[top : top + strip["rows"] * strip["lines"], block["x"] : block["x"] + block["width"]]
        shaded = part[..., 3] > 0
        total = max(int(shaded.sum()), 1)
        part[~shaded, :3] = (part[shaded, :3].sum(axis=0, dtype=np.int64) + total // 2) // total
    return cleared
