"""Lists of fragments per pixel as both ends hold them, and what changes from one to another (chapter 4)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from shading_atlas_bench.kernels.common.scan import RUNS_ON_A_GPU, exclusive_scan

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic.arrays import Bools, Ints, Words
    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.packers.interface import View

HERE = Path(__file__).parent


@dataclass(frozen=True)
class Lists:
    """offsets int32 (width * height + 1) into rows, uint32 (count, words), nearest first; on the device."""

    width: int
    height: int
    count: int
    words: int
    offsets: Array
    rows: Array

    @property
    def pixels(self) -> int:
        return self.width * self.height

    @classmethod
    def empty(cls, device: Device, width: int, height: int, words: int) -> Lists:
        """Without any fragment."""
        return cls(width, height, 0, words, device.zeros(width * height + 1, np.int32), device.empty(0, np.uint32))

    @classmethod
    def upload(cls, device: Device, width: int, height: int, offsets: NDArray[np.integer[Any]], rows: Words) -> Lists:
        """From host arrays: offsets int (P + 1), rows uint32 (n, words)."""
        count, words = rows.shape
        return cls(width, height, count, words, device.upload(offsets.astype(np.int32)), device.upload(rows))

    def host(self) -> tuple[Ints, Words]:
        """Offsets (P + 1) and rows (count, words) on the host."""
        return self.offsets.get(), self.rows.get().ravel()[: self.count * self.words].reshape(-1, self.words)


class ListView(NamedTuple):
    """A list view's camera, and the lists of each of its nodes, of its size."""

    view: View
    lists: list[Lists]


def cut_lists(device: Device, lists: Lists, counts: Array, stage: str) -> Lists:
    """The first counts[p] fragments of each pixel, int32 (P + 1) with a 0 at the end; transparent ones, all zero,
    where there are fewer."""
    offsets, total = exclusive_scan(device, counts, lists.pixels + 1, stage)
    rows = device.recycled((total, lists.words), np.uint32)
    inputs = (lists.pixels, lists.words, lists.offsets, lists.rows, offsets, rows)
    device.launch(stage, device.build(HERE / "lists.cl").cut_lists, lists.pixels, *inputs)
    return Lists(lists.width, lists.height, total, lists.words, offsets, rows)


def count_deleted(device: Device, lists: Lists, stage: str) -> int:
    """How many fragments are transparent: they delete what is held."""
    if not lists.count:
        return 0
    local = 1 if device.is_cpu else None
    run = -(-lists.count // (device.chunks if device.is_cpu else RUNS_ON_A_GPU))
    sums = device.recycled(-(-lists.count // run), np.int32)
    inputs = (lists.count, run, lists.words, lists.rows, sums)
    device.launch(stage, device.build(HERE / "lists.cl").count_deleted, sums.size, *inputs, local=local)
    return int(sums.get().sum(dtype=np.int64))


def splice_lists(device: Device, held: Lists, fresh: Lists, stage: str) -> Lists:
    """`held` with the lists that `fresh` has in place of its own."""
    kernels, pixels = device.build(HERE / "lists.cl"), held.pixels
    counts = device.recycled(pixels + 1, np.int32)
    device.fill(counts[pixels:], 0, stage)
    device.launch(stage, kernels.count_spliced, pixels, pixels, held.offsets, fresh.offsets, counts)
    offsets, total = exclusive_scan(device, counts, pixels + 1, stage)
    rows = device.recycled((total, held.words), np.uint32)
    inputs = (held.offsets, held.rows, fresh.offsets, fresh.rows, offsets, rows)
    device.launch(stage, kernels.splice_lists, pixels, pixels, held.words, *inputs)
    return Lists(held.width, held.height, total, held.words, offsets, rows)


def changed_colours(device: Device, lists: Lists, shown: Array, now: Array, tolerance: int, stage: str) -> Lists:
    """The lists of pixels whose blended colours, uint8 (P, 4), differ by more than `tolerance` in any channel.

    shown: what is held, blended; becomes that of what is held with the changed lists spliced in. now: `lists` blended.
    """
    counts = device.recycled(lists.pixels + 1, np.int32)
    device.fill(counts[lists.pixels :], 0, stage)
    kernel = device.build(HERE / "lists.cl").count_changed_colours
    device.launch(stage, kernel, lists.pixels, lists.pixels, tolerance, shown, now, lists.offsets, counts)
    return cut_lists(device, lists, counts, stage)


def changed_lists(device: Device, lists: Lists, held: Lists, tolerance: int, share: float, stage: str) -> Lists:
    """The lists of colours and depths that differ from those held: in number, by more than `tolerance` in a channel of
    a colour, or by more than `share` of a depth."""
    counts = device.recycled(lists.pixels + 1, np.int32)
    device.fill(counts[lists.pixels :], 0, stage)
    inputs = (tolerance, float(share), held.offsets, held.rows, lists.offsets, lists.rows, counts)
    device.launch(stage, device.build(HERE / "lists.cl").count_changed_lists, lists.pixels, lists.pixels, *inputs)
    return cut_lists(device, lists, counts, stage)


Host: TypeAlias = tuple[NDArray[np.integer[Any]], NDArray[np.uint32]]  # offsets and rows, as Lists.host


def cut_twin(lists: Host, counts: NDArray[np.integer[Any]]) -> Host:
    """As cut_lists; counts int (P)."""
    offsets, rows = lists
    parts = []
    for pixel, count in enumerate(counts):
        part = rows[offsets[pixel] : offsets[pixel + 1]][:count]
        parts += [part, np.zeros((count - len(part), rows.shape[1]), np.uint32)]
    return np.concatenate([[0], np.cumsum(counts)]), np.concatenate([rows[:0], *parts])


def deleted_twin(lists: Host) -> int:
    """As count_deleted."""
    return int((lists[1][:, 0] >> 24 == 0).sum())


def splice_twin(held: Host, fresh: Host) -> Host:
    """As splice_lists."""
    parts = []
    for pixel in range(len(held[0]) - 1):
        new = fresh[1][fresh[0][pixel] : fresh[0][pixel + 1]]
        parts.append(new if len(new) else held[1][held[0][pixel] : held[0][pixel + 1]])
    counts = [len(part) for part in parts]
    return np.concatenate([[0], np.cumsum(counts)]), np.concatenate([held[1][:0], *parts])


def changed_twin(lists: Host, held: Host, tolerance: int, share: float) -> Bools:
    """bool (P): the pixels whose lists changed_lists gives."""
    changed = np.zeros(len(lists[0]) - 1, bool)
    for pixel in range(len(changed)):
        new, old = (rows[offsets[pixel] : offsets[pixel + 1]] for offsets, rows in (lists, held))
        old = old[old[:, 0] >> 24 > 0] if len(old) == 1 else old
        changed[pixel] = len(new) != len(old)
        if not changed[pixel]:
            colours = [np.ascontiguousarray(part[:, 0]).view(np.uint8).astype(int) for part in (new, old)]
            depths = [np.ascontiguousarray(part[:, 1]).view(np.float32) for part in (new, old)]
            moved = np.abs(depths[0] - depths[1]) > np.float32(share) * depths[0]
            changed[pixel] = (np.abs(colours[0] - colours[1]) > tolerance).any() or moved.any()
    return changed
