"""Superblock management (section 3.5, algorithm 2): strips of bins in columns of the atlas, from frame to frame."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from kernels.snakebinning.bins import BINS, COLUMN
from kernels.snakebinning.strip import ENLARGE, row_width, slot_shape, slots_in

if TYPE_CHECKING:
    from pyopencl.array import Array

    from kernels.device import Device
    from kernels.snakebinning.count import BinCounts

STAGE = "structs/superblocks"
STRIP = np.dtype([(name, np.int32) for name in (
    "bin", "count", "superblock", "y", "rows", "per_row", "next", "before8", "after8", "height8", "inset", "extent",
    "lines", "odd", "period", "texels", "need_before8", "need_after8", "native", "base", "moved_at",
)])  # fmt: skip
SUPERBLOCK = np.dtype([(name, np.int32) for name in ("x", "y", "width", "first", "used", "peak", "room", "strips")])
STATE = ("strips", "superblocks", "cursor_x", "cursor_y", "full", "outgrown", "shrunk", "collapsed", "orphans", "free")


@dataclass(frozen=True)
class Atlas:
    """The atlas and how strips are given room.

    height: of superblocks. capacity: room over triangles of a strip that is placed. shrink: a strip with less than this
    share of its room in use gives up the rest. collapse: a superblock with less than this share of its highest use
    becomes empty. enlarge: "exact" or "paper".
    """

    width: int
    lines: int
    height: int
    capacity: float = 1.3
    shrink: float = 0.5
    collapse: float = 0.25
    enlarge: str = "exact"
    fit: str = "best"


class Superblocks:
    """Strips, superblocks and the strip of each bin, int32 (BINS), on the device."""

    def __init__(self, device: Device, atlas: Atlas) -> None:
        self.device, self.atlas = device, atlas
        self.kernels = device.build("snakebinning/superblocks.cl")
        self.strip_of = device.empty(BINS, np.int32)
        self.strips = device.zeros(0, STRIP)
        self.orphans = device.zeros(0, np.int32)
        self.blocks = device.zeros(max(1, atlas.width) * -(-atlas.lines // atlas.height), SUPERBLOCK)
        self.state = device.zeros(len(STATE), np.int32)
        self.numbers = dict.fromkeys(STATE, 0)
        self.reset()

    def reset(self) -> None:
        """Remove all strips and superblocks; counters of events stay."""
        self.device.fill(self.strip_of, -1, STAGE)
        kept = {name: self.numbers[name] for name in ("outgrown", "shrunk", "collapsed")}
        self.numbers = {name: kept.get(name, -1 if name == "free" else 0) for name in STATE}
        self.state.set(np.array(list(self.numbers.values()), np.int32))

    def update(self, frame: int, bins: BinCounts, targets: Array, tops: Array, frozen: bool) -> bool:
        """Give every strip of this frame its place; False if the atlas has no room for some.

        frame: a number that grows. targets: int32 (BINS). tops: int32, height of each bin of heights in 1/8 texel.
        frozen: the triangles counted join those that strips have, and only strips that these outgrow move.
        """
        self._grow(self.numbers["strips"] + bins.used_count)
        a = self.atlas
        counted = (bins.used_count, bins.used, targets, bins.counts, bins.widest, tops)
        rules = (a.width, a.lines, a.height, a.capacity, a.shrink, a.collapse, ENLARGE[a.enlarge], int(a.fit == "best"))
        arrays = (self.strips, self.blocks, self.state, self.orphans, self.strip_of)
        self.device.launch(STAGE, self.kernels.manage, 1, frame, int(frozen), *counted, *rules, *arrays, local=1)
        self.numbers = dict(zip(STATE, map(int, self.state.get()), strict=True))
        return not self.numbers["full"]

    def _grow(self, count: int) -> None:
        """Room for `count` strips."""
        if count <= len(self.strips):
            return
        larger = np.zeros(int(1.5 * count), STRIP)
        larger[: len(self.strips)] = self.strips.get()
        self.strips, self.orphans = self.device.upload(larger), self.device.empty(len(larger), np.int32)

    def live_strips(self) -> np.ndarray:
        """The strips that have triangles, as STRIP records."""
        strips = self.strips.get()[: self.numbers["strips"]]
        return strips[strips["bin"] >= 0]

    def live_superblocks(self) -> np.ndarray:
        """The superblocks, as SUPERBLOCK records."""
        return self.blocks.get()[: self.numbers["superblocks"]]


@dataclass
class SuperblocksTwin:
    """The same on the host: strips by bin, superblocks as lists of bins from top to bottom."""

    atlas: Atlas
    strips: dict[int, dict[str, int]] = field(default_factory=dict)
    blocks: list[dict] = field(default_factory=list)
    entries: list[int] = field(default_factory=list)  # bins in the order of the kernel's entries, -1 for free ones
    free: list[int] = field(default_factory=list)

    def update_twin(
        self,
        used: np.ndarray,
        targets: np.ndarray,
        counts: np.ndarray,
        widest: np.ndarray,
        tops: np.ndarray,
        frozen: bool = False,
    ) -> bool:
        """Place the strips of k used bins: their targets, triangles (k) and widest lengths (k, 2)."""
        self.full, self.frozen = False, frozen
        self._collect(used, targets, counts, widest, frozen)
        orphans = []
        for entry, number in enumerate(self.entries):
            if number < 0:
                continue
            strip = self.strips[number]
            if strip["count"] == 0:
                self._release(entry)
            elif strip["block"] is not None:
                orphans += [number] if self._must_move(number, frozen) else []
            else:
                self._shape(number, tops)
                orphans += [] if self._attach_anywhere(number) else [number]
        if not frozen:
            orphans += self._collapse()
        for number in orphans:
            self._shape(number, tops)
        for number in sorted(orphans, key=lambda n: -_width_class(self.strips[n]["extent"] + 1)):
            if not self._attach_anywhere(number) and not self._create(number):
                self.full = True
        return not self.full

    def _collect(self, used: np.ndarray, targets: np.ndarray, counts: np.ndarray, widest: np.ndarray, frozen: bool):
        for strip in self.strips.values():
            kept = strip["count"] if frozen else 0
            strip.update(count=kept, base=kept, need=(0, 0), native=False)
        for number, target, count, wide in zip(used, targets, counts, widest, strict=True):
            if target not in self.strips:
                self.strips[target] = dict.fromkeys(("count", "base", "before8", "after8"), 0)
                self.strips[target] |= {"block": None, "need": (0, 0), "native": False}
                if self.free:
                    self.entries[self.free.pop()] = target
                else:
                    self.entries.append(target)
            strip = self.strips[target]
            strip["count"] += int(count)
            if number == target:
                strip.update(native=True, need=(int(wide[0]), int(wide[1])))
            elif not strip["native"]:
                strip["need"] = tuple(max(a, int(b)) for a, b in zip(strip["need"], wide, strict=True))

    def _release(self, entry: int) -> None:
        self._detach(self.entries[entry])
        del self.strips[self.entries[entry]]
        self.entries[entry] = -1
        self.free.append(entry)

    def _detach(self, number: int) -> None:
        strip = self.strips[number]
        if strip["block"] is not None:
            block = self.blocks[strip["block"]]
            block["bins"].remove(number)
            block["peak"] = block["peak"] if block["bins"] else 0
            strip["block"] = None

    def _must_move(self, number: int, frozen: bool) -> bool:
        """Shrink a placed strip, or take it out."""
        strip = self.strips[number]
        room = strip["rows"] * strip["per_row"]
        wide = (
            strip["native"]
            and not frozen
            and any(
                8 * need > 9 * strip[name] + 32 for need, name in zip(strip["need"], ("before8", "after8"), strict=True)
            )
        )
        if strip["count"] > room or wide:
            self._detach(number)
            strip["base"] = 0
            return True
        if not frozen and strip["count"] < self.atlas.shrink * room:
            strip["rows"] = min(strip["rows"], self._rows(strip, strip["per_row"]))
        return False

    def _shape(self, number: int, tops: np.ndarray) -> None:
        strip = self.strips[number]
        need = np.maximum(strip["need"], [strip["before8"], strip["after8"]]) if self.frozen else strip["need"]
        strip.update(slot_shape(*map(int, need), int(tops[number % COLUMN]), self.atlas.enlarge))

    def _rows(self, strip: dict, per_row: int) -> int:
        room = max(strip["count"], int(np.float32(self.atlas.capacity) * np.float32(strip["count"])))
        return -(-room // per_row)

    def _wanted(self, strip: dict) -> float:
        return 0.5 * self.atlas.capacity * strip["count"] * strip["period"] * strip["lines"]

    def _gap(self, block: dict, lines: int) -> tuple[int, int] | None:
        """First line of the first gap of so many lines in a superblock, and its place among the strips."""
        end = 0
        for place, number in enumerate(block["bins"]):
            strip = self.strips[number]
            if strip["y"] - end >= lines:
                return end, place
            end = strip["y"] + strip["rows"] * strip["lines"]
        return (end, len(block["bins"])) if self.atlas.height - end >= lines else None

    def _attach_anywhere(self, number: int) -> bool:
        strip = self.strips[number]
        choices = []
        for index, block in enumerate(self.blocks):
            per_row = slots_in(strip, block["width"])
            lines = self._rows(strip, per_row) * strip["lines"] if per_row else 0
            if per_row and self._gap(block, lines):
                choices.append((index, lines * block["width"]))
        if not choices:
            return False
        if self.atlas.fit == "best":
            good = [c for c in choices if c[1] <= 1.2 * self._wanted(strip)]
            best = max(good, key=lambda c: self.blocks[c[0]]["width"]) if good else min(choices, key=lambda c: c[1])
        else:
            best = choices[0]
        self._attach(number, best[0])
        return True

    def _attach(self, number: int, index: int) -> None:
        strip, block = self.strips[number], self.blocks[index]
        per_row = slots_in(strip, block["width"])
        rows = self._rows(strip, per_row)
        y, place = self._gap(block, rows * strip["lines"])
        block["bins"].insert(place, number)
        strip.update(block=index, y=y, rows=rows, per_row=per_row)
        block["peak"] = max(block["peak"], self._used(block))

    def _used(self, block: dict) -> int:
        return sum(self.strips[n]["rows"] * self.strips[n]["lines"] for n in block["bins"])

    def _create(self, number: int) -> bool:
        a, strip, last = self.atlas, self.strips[number], self.blocks[-1] if self.blocks else None
        x, y = (last["x"] + last["width"], last["y"]) if last else (0, 0)
        width = self._width(strip, a.width - x)
        if not width and x > 0 and y + 2 * a.height <= a.lines:
            x, y, width = 0, y + a.height, self._width(strip, a.width)
        if not width:
            return False
        self.blocks.append({"x": x, "y": y, "width": width, "bins": [], "peak": 0})
        self._attach(number, len(self.blocks) - 1)
        return True

    def _width(self, strip: dict, left: int) -> int:
        blocks = max(1, int(np.sqrt(self._wanted(strip)) / strip["period"] + 0.5))
        while (
            row_width(strip, 2 * blocks) < left and self._rows(strip, 2 * blocks) * strip["lines"] > self.atlas.height
        ):
            blocks += 1 + blocks // 8
        per_row = min(1 if strip["count"] == 1 else 2 * blocks, slots_in(strip, left))
        if not per_row or self._rows(strip, per_row) * strip["lines"] > self.atlas.height:
            return 0
        return row_width(strip, per_row)

    def _collapse(self) -> list[int]:
        orphans = []
        for block in self.blocks:
            if block["bins"] and self._used(block) < self.atlas.collapse * block["peak"]:
                gone = list(block["bins"])
                for number in gone:
                    self._detach(number)
                orphans += gone
        while self.blocks and not self.blocks[-1]["bins"]:
            self.blocks.pop()
        return orphans


def _width_class(width: int) -> int:
    whole = width.bit_length() - 1
    return 8 * whole + ((width << 3 >> whole) & 7)
