"""The wire format: a head with matrices, and per node the header and the fragments of the thesis, in two layouts.

The head (metadata), little-endian:

    uint8 (4)     "PPLL"
    uint32 (9)    version, mode, layout, width, height, words per fragment without `next`, nodes, CRC-32 of the lists,
                  merge
    float32       threshold of the merge
    uint32 (n)    fragments of each node
    float64 (32)  view and projection of the lists

Lists of several views have one such head after the other, which differ in sizes, numbers of fragments, matrices and
checksums only.

The lists, view after view and node after node:

    uint32 (h, w)     1 + the first fragment of each pixel, 0 where it has none
    fragments         colour fragments (12 bytes): RGBA, depth, next. Normal fragments (24 bytes): RGBA, normal, x, y,
                      distance, next. `next` is 1 + the next fragment of the pixel, 0 for its last.

`paper` sends the header and one structure after the other. `shuffled` sends, for the header and then each field, first
all lowest bytes, then all second ones and so on; as fragments lie pixel after pixel, nearest first, its header only
says which pixels have any (1), and its `next` which fragments are followed by another of their pixel (1). The lists are
written on the device (packers/ppll/kernels/wire.py); here are their head and the reading.
"""

from __future__ import annotations

import itertools
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.packers.geometry import unshuffle
from shading_atlas_bench.packers.ppll.kernels.wire import LAYOUTS

if TYPE_CHECKING:
    from shading_atlas_bench.arithmetic.arrays import Bools, Doubles, Longs, Words

MODES = ("full", "depth-limited", "difference", "bilateral")
DIFFERENCES = ("difference", "bilateral")  # modes whose lists are what changes of those held
MERGES = ("exact", "paper")
VERSION = 1
HEAD = 4 + 10 * 4
MATRICES = 32 * 8
LARGEST_SIDE = 16384
MOST_PIXELS = LARGEST_SIDE * LARGEST_SIDE  # of all views
MOST_NODES = 255
MOST_FRAGMENTS = 1 << 28
WORDS = (2, 5)  # of colour fragments, and of normal fragments, which bilateral differences consist of


class WireError(ValueError):
    """A message that cannot be what an encoder sent; the sentence says why."""


@dataclass(frozen=True, kw_only=True)
class Head:
    """What is said of the lists of one view in one frame.

    view, projection: float64 (4, 4), of the camera that saw them, see View.
    words: uint32 of a fragment without `next`. counts: fragments of each node. merge, threshold: how bilateral
    differences are applied, see packers.ppll.kernels.match.
    """

    mode: str
    layout: str
    width: int
    height: int
    view: Doubles
    projection: Doubles
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
    """One view's lists as they arrive.

    nodes: of each, offsets int64 (P + 1) and rows uint32 (n, words), nearest first.
    """

    nodes: tuple[tuple[Longs, Words], ...]


def encode(heads: Sequence[Head], lists: bytes) -> bytes:
    """The bytes of the heads, one for each view, that go with these bytes of lists."""
    ends = np.cumsum([0, *(head.raw_bytes for head in heads)]).tolist()
    parts = (memoryview(lists)[start:end] for start, end in itertools.pairwise(ends))
    return b"".join(_encode_head(head, part) for head, part in zip(heads, parts, strict=True))


def _encode_head(head: Head, lists: memoryview) -> bytes:
    numbers = [VERSION, MODES.index(head.mode), LAYOUTS.index(head.layout), head.width, head.height]
    numbers += [head.words, len(head.counts), zlib.crc32(lists), MERGES.index(head.merge)]
    numbers += [int(np.float32(head.threshold).view(np.uint32)), *head.counts]
    matrices = np.concatenate([head.view.ravel(), head.projection.ravel()]).astype("<f8")
    return b"PPLL" + np.array(numbers, "<u4").tobytes() + matrices.tobytes()


def decode(head: bytes, lists: bytes) -> tuple[Message, ...]:
    """The messages of heads and their lists, one for each view. Raises WireError for anything that `encode` cannot have
    written; nothing larger than the input is allocated before it is known to fit."""
    heads: list[Head] = []
    checksums: list[int] = []
    at = 0
    while at < len(head) or not heads:
        one, checksum, at = _decode_head(head, at)
        heads.append(one)
        checksums.append(checksum)
    if any(_shared(one) != _shared(heads[0]) for one in heads):
        raise WireError("The lists' heads differ in more than views have of their own.")
    if sum(one.width * one.height for one in heads) > MOST_PIXELS:
        raise WireError("The lists' heads claim more pixels than lists can have.")
    ends = np.cumsum([0, *(one.raw_bytes for one in heads)]).tolist()
    if ends[-1] != len(lists):
        raise WireError(f"The lists have {len(lists)} bytes where their head announces {ends[-1]}.")
    parts = [memoryview(lists)[start:end] for start, end in itertools.pairwise(ends)]
    if any(zlib.crc32(part) != checksum for part, checksum in zip(parts, checksums, strict=True)):
        raise WireError("The lists are damaged: their checksum differs.")
    return tuple(_decode_lists(*pair) for pair in zip(heads, parts, strict=True))


def _shared(head: Head) -> tuple[str, str, int, int, str, float]:
    """What is the same in the heads of all views."""
    return head.mode, head.layout, head.words, len(head.counts), head.merge, head.threshold


def _decode_head(head: bytes, at: int) -> tuple[Head, int, int]:
    """The head that begins at a byte, the checksum of its lists, and where the next one begins."""
    if len(head) < at + HEAD + MATRICES or head[at : at + 4] != b"PPLL":
        raise WireError("The lists' head is truncated or damaged.")
    numbers = np.frombuffer(head, "<u4", 9, at + 4).astype(int).tolist()
    version, mode, layout, width, height, words, nodes, checksum, merge = numbers
    threshold = float(np.frombuffer(head, "<f4", 1, at + 40)[0])
    known = mode < len(MODES) and layout < len(LAYOUTS) and merge < len(MERGES) and 0 <= threshold <= 1
    if version != VERSION or not known or words != WORDS[MODES[mode] == "bilateral"]:
        raise WireError("The lists' head names a version, mode, layout or merge that this client does not know.")
    if not (1 <= width <= LARGEST_SIDE and 1 <= height <= LARGEST_SIDE and 1 <= nodes <= MOST_NODES):
        raise WireError(f"The lists' head claims {width} x {height} pixels of {nodes} nodes, which is out of range.")
    end = at + HEAD + 4 * nodes + MATRICES
    if len(head) < end:
        raise WireError("The lists' head is not as long as its number of nodes requires.")
    counts = np.frombuffer(head, "<u4", nodes, at + HEAD).astype(np.int64)
    if counts.max() > MOST_FRAGMENTS:
        raise WireError(f"The lists' head announces {counts.max()} fragments of a node, which is out of range.")
    matrices = np.frombuffer(head, "<f8", 32, end - MATRICES).reshape(2, 4, 4).astype(np.float64)
    if not np.isfinite(matrices).all():
        raise WireError("The lists' matrices are not finite.")
    decoded = Head(
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
    )
    return decoded, checksum, end


def _decode_lists(head: Head, lists: memoryview) -> Message:
    """One view's lists, whose length and checksum are right."""
    pixels = head.width * head.height
    ends = np.cumsum([0, *(4 * (pixels + count * (head.words + 1)) for count in head.counts)]).tolist()
    parts = (lists[start:end] for start, end in itertools.pairwise(ends))
    nodes = tuple(_decode_node(part, head.layout, pixels, head.words) for part in parts)
    return Message(**{field.name: getattr(head, field.name) for field in fields(Head)}, nodes=nodes)


def _decode_node(data: memoryview, layout: str, pixels: int, words: int) -> tuple[Longs, Words]:
    count = (len(data) // 4 - pixels) // (words + 1)
    if layout == "shuffled":
        flags = unshuffle(data, np.uint32, pixels)
        fields = [unshuffle(data, np.uint32, count, 4 * (pixels + k * count)) for k in range(words + 1)]
        if max(flags.max(), fields[-1].max(initial=0)) > 1:
            raise WireError("The lists are damaged: a flag is neither 0 nor 1.")
        rows, used, follows = np.stack(fields[:-1], axis=1), flags > 0, fields[-1] > 0
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


def _offsets(used: Bools, follows: Bools) -> Longs:
    """Offsets (P + 1) from which pixels have a list and which fragments are not the last of theirs."""
    ends = np.flatnonzero(~follows) + 1
    if len(ends) != np.count_nonzero(used) or (len(follows) and follows[-1]):
        raise WireError("The lists are damaged: there are not as many lists as pixels that have one.")
    offsets = np.zeros(len(used) + 1, np.int64)
    offsets[1:][used] = np.diff(ends, prepend=0)
    return np.cumsum(offsets)


def _check_values(rows: Words) -> None:
    """Depths, distances and positions are finite; depths and distances are not negative."""
    reals = rows.view(np.float32)[:, 1 if rows.shape[1] == 2 else 2 :]
    if not np.isfinite(reals).all() or (reals[:, -1] < 0).any():
        raise WireError("The lists are damaged: a fragment lies nowhere.")
