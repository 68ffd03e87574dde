"""Lists as they are sent: the header and the links around their fragments (sections 2.1 and 2.2 of the thesis)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic.arrays import Words
    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.packers.ppll.kernels.lists import Lists

HERE = Path(__file__).parent

LAYOUTS = ("paper", "shuffled")


def write_lists(device: Device, nodes: Sequence[Lists], layout: str, stage: str) -> Array:
    """uint32 (words): the lists of one or more nodes, of equal words per fragment, one after the other.

    paper: uint32 per pixel, 1 + its first fragment, 0 where it has none; then the fragments, each its words and `next`,
    1 + the next fragment of its pixel, 0 for its last. shuffled: whether a pixel has any fragment, each word of the
    fragments, and whether one is followed by another of its pixel; of each first all lowest bytes, then all second ones
    and so on. Both take as many bytes. Fragments are counted from each node's first.

    Raises ValueError for other layouts.
    """
    if layout not in LAYOUTS:
        raise ValueError(f"There is no layout {layout!r} of lists: give one of {', '.join(LAYOUTS)}.")
    kernels = device.build(HERE / "wire.cl", WORDS=nodes[0].words, SHUFFLED=int(layout == "shuffled"))
    ends = np.cumsum([0, *(node.pixels + node.count * (node.words + 1) for node in nodes)]).tolist()
    wire = device.recycled(ends[-1], np.uint32)
    for node, start in zip(nodes, ends, strict=False):
        pixels, count = node.pixels, node.count
        device.launch(stage, kernels.write_fragments, count, count, node.rows, start + pixels, wire)
        device.launch(stage, kernels.write_ends, pixels, pixels, count, node.offsets, start, wire)
    return wire


def write_twin(offsets: NDArray[np.integer[Any]], rows: Words, layout: str) -> bytes:
    """As write_lists, of one node: offsets int (P + 1), rows uint32 (n, words)."""
    used, last = np.diff(offsets) > 0, np.isin(np.arange(len(rows)), offsets[1:] - 1)
    if layout == "shuffled":
        fields = [used, *rows.T, ~last]
        return b"".join(field.astype("<u4").view(np.uint8).reshape(-1, 4).T.tobytes() for field in fields)
    header = np.where(used, offsets[:-1] + 1, 0)
    links = np.where(last, 0, np.arange(len(rows)) + 2)
    return header.astype("<u4").tobytes() + np.column_stack([rows, links]).astype("<u4").tobytes()
