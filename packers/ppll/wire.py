"""The wire format: a head with matrices, and per node the header and the fragments of the thesis, in two layouts.

The head (metadata), little-endian:

    uint8 (4)     "PPLL"
    uint32 (9)    version, mode, layout, width, height, words per fragment without `next`, nodes, CRC-32 of the lists,
                  merge
    float32       threshold of the merge
    uint32 (n)    fragments of each node
    float64 (32)  view and projection of the lists

The lists, node after node:

    uint32 (h, w)     1 + the first fragment of each pixel, 0 where it has none
    fragments         colour fragments (12 bytes): RGBA, depth, next. Normal fragments (24 bytes): RGBA, normal, x, y,
                      distance, next. `next` is 1 + the next fragment of the pixel, 0 for its last.

`paper` sends the header and one structure after the other. `shuffled` sends, for the header and then each field, first
all lowest bytes, then all second ones and so on; as fragments lie pixel after pixel, nearest first, its header only
says which pixels have any (1), and its `next` which fragments are followed by another of their pixel (1). The lists are
written on the device (kernels/ppll/wire.py); here are their head and the reading.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np

from kernels.ppll.wire import LAYOUTS
from packers.geometry import unshuffle

MODES = ("full", "depth-limited", "difference", "bilateral")
MERGES = ("exact", "paper")
VERSION = 1
HEAD = 4 + 10 * 4
MATRICES = 32 * 8
LARGEST_SIDE = 16384
MOST_NODES = 255
MOST_FRAGMENTS = 1 << 28
WORDS = (2, 5)  # of colour fragments, and of normal fragments, which bilateral differences consist of


class WireError(ValueError):
    """A message that cannot be what an encoder sent; the sentence says why."""


@dataclass(frozen=True, kw_only=True)
class Head:
    """What the head says of one frame's lists.

    words: uint32 of a fragment without `next`. counts: fragments of each node. merge, threshold: how bilateral
    differences are applied, see kernels.ppll.match.
    """

    mode: str
    layout: str
    width: int
    height: int
    view: np.ndarray
    projection: np.ndarray
    words: int
    counts: tuple[int, ...]
    merge: str = "exact"
    threshold: float = 0.0

    @property
    def header_bytes(self) -> int:
        """4 bytes per pixel and node."""
        return 4 * self.width * self.height * len(self.counts)

    @property
    def raw_bytes(self) -> int:
        """With 12 or 24 bytes per fragment: what the lists take in the thesis' structures."""
        return self.header_bytes + sum(self.counts) * 4 * (self.words + 1)

    @property
    def padded_bytes(self) -> int:
        """The same with fragments padded to 16 or 32 bytes."""
        return self.header_bytes + sum(self.counts) * (16 if self.words == WORDS[0] else 32)


@dataclass(frozen=True, kw_only=True)
class Message(Head):
    """One frame's lists as they arrive: per node offsets int64 (P + 1) and rows uint32 (n, words), nearest first."""

    nodes: tuple[tuple[np.ndarray, np.ndarray], ...]


def encode(head: Head, lists: bytes) -> bytes:
    """The bytes of the head that goes with these bytes of lists."""
    numbers = [VERSION, MODES.index(head.mode), LAYOUTS.index(head.layout), head.width, head.height]
    numbers += [head.words, len(head.counts), zlib.crc32(lists), MERGES.index(head.merge)]
    numbers += [int(np.float32(head.threshold).view(np.uint32)), *head.counts]
    matrices = np.concatenate([head.view.ravel(), head.projection.ravel()]).astype("<f8")
    return b"PPLL" + np.array(numbers, "<u4").tobytes() + matrices.tobytes()


def decode(head: bytes, lists: bytes) -> Message:
    """The message of a head and its lists. Raises WireError for anything that `encode` cannot have written; nothing
    larger than the input is allocated before it is known to fit."""
    if len(head) < HEAD + MATRICES or head[:4] != b"PPLL":
        raise WireError("The lists' head is truncated or damaged.")
    numbers = np.frombuffer(head, "<u4", 9, 4).astype(int).tolist()
    version, mode, layout, width, height, words, nodes, checksum, merge = numbers
    threshold = float(np.frombuffer(head, "<f4", 1, 40)[0])
    known = mode < len(MODES) and layout < len(LAYOUTS) and merge < len(MERGES) and 0 <= threshold <= 1
    if version != VERSION or not known or words != WORDS[MODES[mode] == "bilateral"]:
        raise WireError("The lists' head names a version, mode, layout or merge that this client does not know.")
    if not (1 <= width <= LARGEST_SIDE and 1 <= height <= LARGEST_SIDE and 1 <= nodes <= MOST_NODES):
        raise WireError(f"The lists' head claims {width} x {height} pixels of {nodes} nodes, which is out of range.")
    if len(head) != HEAD + 4 * nodes + MATRICES:
        raise WireError("The lists' head is not as long as its number of nodes requires.")
    counts = np.frombuffer(head, "<u4", nodes, HEAD).astype(np.int64)
    sizes = 4 * width * height + counts * (words + 1) * 4
    if counts.max() > MOST_FRAGMENTS or int(sizes.sum()) != len(lists):
        raise WireError(f"The lists have {len(lists)} bytes where their head announces {int(sizes.sum())}.")
    if zlib.crc32(lists) != checksum:
        raise WireError("The lists are damaged: their checksum differs.")
    matrices = np.frombuffer(head, "<f8", 32, HEAD + 4 * nodes).reshape(2, 4, 4).astype(np.float64)
    if not np.isfinite(matrices).all():
        raise WireError("The lists' matrices are not finite.")
    ends = np.cumsum(sizes)
    parts = [lists[end - size : end] for end, size in zip(ends.tolist(), sizes.tolist(), strict=True)]
    decoded = [_decode_node(part, LAYOUTS[layout], width * height, words) for part in parts]
    return Message(
        mode=MODES[mode],
        layout=LAYOUTS[layout],
        width=width,
        height=height,
        view=matrices[0],
        projection=matrices[1],
        words=words,
        counts=tuple(counts.tolist()),
        merge=MERGES[merge],
        threshold=threshold,
        nodes=tuple(decoded),
    )


def _decode_node(data: bytes, layout: str, pixels: int, words: int) -> tuple[np.ndarray, np.ndarray]:
    count = (len(data) // 4 - pixels) // (words + 1)
    if layout == "shuffled":
        used = unshuffle(data, np.uint32, pixels)
        fields = [unshuffle(data, np.uint32, count, 4 * (pixels + k * count)) for k in range(words + 1)]
        rows, follows = np.stack(fields[:-1], axis=1), fields[-1]
        if max(used.max(), follows.max(initial=0)) > 1:
            raise WireError("The lists are damaged: a flag is neither 0 nor 1.")
    else:
        header = np.frombuffer(data, "<u4", pixels)
        fragments = np.frombuffer(data, "<u4", count * (words + 1), 4 * pixels).reshape(count, words + 1)
        rows, following = np.empty((count, words), np.uint32), fragments[:, -1]
        for field in range(words):
            rows[:, field] = fragments[:, field]
        follows, used = following > 0, header > 0
        if (following != np.arange(2, count + 2, dtype=np.uint32) * follows).any():
            raise WireError("The lists are damaged: a fragment's next one does not follow it.")
    offsets = _offsets(used, follows)
    if layout == "paper" and (header != (offsets[:-1] + 1) * used).any():
        raise WireError("The lists are damaged: a pixel points to the wrong fragment.")
    _check_values(rows)
    return offsets, rows


def _offsets(used: np.ndarray, follows: np.ndarray) -> np.ndarray:
    """Offsets (P + 1) from which pixels have a list and which fragments are not the last of theirs."""
    ends = np.flatnonzero(follows == 0) + 1
    if len(ends) != np.count_nonzero(used) or (len(follows) and follows[-1]):
        raise WireError("The lists are damaged: there are not as many lists as pixels that have one.")
    offsets = np.zeros(len(used) + 1, np.int64)
    offsets[1:][used > 0] = np.diff(ends, prepend=0)
    return np.cumsum(offsets)


def _check_values(rows: np.ndarray) -> None:
    """Depths, distances and positions are finite; depths and distances are not negative."""
    reals = rows.view(np.float32)[:, 1 if rows.shape[1] == 2 else 2 :]
    if not np.isfinite(reals).all() or (reals[:, -1] < 0).any():
        raise WireError("The lists are damaged: a fragment lies nowhere.")
