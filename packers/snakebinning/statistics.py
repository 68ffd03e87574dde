"""What SnakeBinning reports of a frame beyond the common columns."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from shading_atlas_bench.packers.interface import FULL

if TYPE_CHECKING:
    from shading_atlas_bench.packers.snakebinning.filling import Filling


def statistics_of(filling: Filling, samples: int) -> dict[str, float]:
    """Of a layout that has so many samples; of footprints and bins, of the last frame that was not frozen."""
    slots, superblocks = filling.slots, filling.slots.superblocks
    numbers, strips, blocks = superblocks.numbers, superblocks.live_strips(), superblocks.live_superblocks()
    sinks = int(np.count_nonzero(strips["count"] > slots.mapping.sink))
    mapped = {"sinks": sinks, "sources": max(0, slots.bins_before_mapping - sinks)} if slots.mapping.is_on else {}
    return {
        **filling.measured.noted,
        **mapped,
        "shading_rate": filling.rate,
        FULL: int(filling.step > 0),
        "bins_before_mapping": slots.bins_before_mapping,
        "bins_after_mapping": int(np.count_nonzero(strips["count"])),
        "superblocks": len(blocks),
        "rebuilds": filling.freezing.rebuilds,
        "remappings": slots.mapping.remappings + filling.resets,
        "resets": filling.resets,
        "collapsed": numbers["collapsed"],
        "outgrown": numbers["outgrown"],
        "shrunk": numbers["shrunk"],
        "frozen_frames": filling.freezing.frozen_frames,
        **_wasted(strips, blocks, filling.atlas.width * filling.atlas.lines, samples),
    }


def _wasted(strips: NDArray[np.void], blocks: NDArray[np.void], texels: int, samples: int) -> dict[str, float]:
    """Texels of the atlas that no sample fills; strips, blocks: STRIP and SUPERBLOCK records."""
    placed = strips[strips["superblock"] >= 0]
    rows = placed["rows"].astype(np.int64)
    in_slots = int((rows * placed["per_row"] * placed["texels"]).sum())
    in_rows = int((rows * placed["lines"] * blocks["width"][placed["superblock"]]).sum())
    in_superblocks = int((blocks["width"].astype(np.int64) * blocks["height"]).sum())
    return {
        "wasted_in_slots": in_slots - samples,
        "wasted_row_ends": in_rows - in_slots,
        "wasted_in_superblocks": in_superblocks - in_rows,
        "unallocated": texels - in_superblocks,
    }
