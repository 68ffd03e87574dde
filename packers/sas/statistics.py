"""What Shading Atlas Streaming reports of its allocation beyond the common columns."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from shading_atlas_bench.arithmetic.arrays import Ints
    from shading_atlas_bench.packers.sas.kernels.allocate import Allocator
    from shading_atlas_bench.packers.sas.kernels.tables import Patches


def describe(patches: Patches, visible: Ints, allocator: Allocator) -> dict[str, float]:
    """The visible patches, int32 (n), by their triangles, and the superblocks and blocks in use."""
    sizes = np.bincount(patches.sizes(visible), minlength=4)
    in_use, blocks = allocator.superblocks_in_use(), allocator.blocks_by_class()
    by_size: dict[str, float] = {f"patches_of_{k}": int(sizes[k]) for k in (1, 2, 3)}
    return by_size | {
        "resets": allocator.resets,
        "superblocks": in_use,
        "blocks": int(blocks.sum()),
        "size_classes": int((blocks > 0).sum()),
        "reserved_texels": in_use << 2 * allocator.grid.top,
    }
