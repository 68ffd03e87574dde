"""What per-pixel linked lists report of a frame beyond the common columns."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from shading_atlas_bench.packers.ppll.server import NodeLists
    from shading_atlas_bench.packers.ppll.wire import Head


def describe(nodes: Sequence[NodeLists], heads: Sequence[Head], deleted: int) -> dict[str, float]:
    """Fragments, layers and bytes over all views and nodes. deleted: fragments sent that delete what is held."""
    built, sent = sum(node.built for node in nodes), sum(sum(head.counts) for head in heads)
    header_bytes = sum(head.header_bytes for head in heads)
    longest = max(len(node.pixels_by_layers) for node in nodes)
    histogram = np.zeros(longest, np.int64)
    for node in nodes:
        histogram[: len(node.pixels_by_layers)] += node.pixels_by_layers
    layers: dict[str, float] = {f"pixels_of_{k}_layers": int(n) for k, n in enumerate(histogram[:16])}
    return layers | {
        "pixels_of_more_layers": int(histogram[16:].sum()),
        "most_layers": longest - 1,
        "fragments_built": built,
        "fragments_kept": sum(node.lists.count for node in nodes),
        "fragments_sent": sent,
        "fragments_deleted": deleted,
        "share_saved": 1 - sent / built if built else 0.0,
        "header_bytes": header_bytes,
        "list_bytes": sum(head.raw_bytes for head in heads) - header_bytes,
        "padded_bytes": sum(head.padded_bytes for head in heads),
    }
