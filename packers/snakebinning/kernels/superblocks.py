"""Superblock management (section 3.5, algorithm 2): strips of bins in columns of the atlas, from frame to frame."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.packers.snakebinning.kernels.bins import BINS, COLUMN
from shading_atlas_bench.packers.snakebinning.kernels.strip import ENLARGE, row_width, slot_shape, slots_in

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.packers.snakebinning.kernels.count import BinCounts

HERE = Path(__file__).parent

STAGE = "structs/superblocks"
STRIP = np.dtype([(name, np.int32) for name in (
    "bin", "count", "superblock", "y", "rows", "per_row", "next", "before8", "after8", "height8", "inset", "extent",
    "lines", "odd", "period", "texels", "need_before8", "need_after8", "native", "base", "moved_at", "more",
)])  # fmt: skip
SUPERBLOCK = np.dtype(
    [(name, np.int32) for name in ("x", "y", "width", "height", "first", "used", "peak", "room", "strips")]
)
STATE = ("strips", "superblocks", "cursor_x", "cursor_y", "left", "outgrown", "shrunk", "collapsed", "orphans", "free")
MOST_BLOCKS = 1 << 14  # superblocks, at least
PARTS = 1024  # further parts of strips that a frame may make
FITS = {"first": 0, "best": 1, "tight": 2, "next": 3}
ORDERS = {"widest": 0, "found": 1}


@dataclass(frozen=True)
class Atlas:
    """The atlas and how strips are given room.

    height: of superblocks, the highest in a tight atlas. capacity: room over triangles of a strip that is placed.
    shrink: a strip with less than this share of its room in use gives up the rest. collapse: a superblock with less
    than this share of its highest use becomes empty. enlarge: "exact" or "paper". fit: which superblock a strip gets,
    "first", "best", "tight" or "next". orphans: the order in which they get theirs, "widest" or "found" (for both see
    superblocks.cl).
    """

    width: int
    lines: int
    height: int
    capacity: float = 1.3
    shrink: float = 0.5
    collapse: float = 0.25
    enlarge: str = "exact"
    fit: str = "best"
    orphans: str = "widest"


class Superblocks:
    """Strips, superblocks and the strip of each bin, int32 (BINS), on the device."""

    def __init__(self, device: Device, atlas: Atlas) -> None:
        self.device = device
        self.kernels = device.build(HERE / "superblocks.cl")
        self.strip_of = device.empty(BINS, np.int32)
        self.strips = device.zeros(0, STRIP)
        self.orphans = device.zeros(0, np.int32)
        self.blocks = device.zeros(max(MOST_BLOCKS, atlas.width * -(-atlas.lines // atlas.height)), SUPERBLOCK)
        self.state = device.zeros(len(STATE), np.int32)
        self.numbers = dict.fromkeys(STATE, 0)
        self.reset(atlas)

    def reset(self, atlas: Atlas) -> None:
        """Remove all strips and superblocks, and place others by the rules of `atlas`, of the same size; counters of
        events stay."""
        self.atlas = atlas
        self.device.fill(self.strip_of, -1, STAGE)
        kept = {name: self.numbers[name] for name in ("outgrown", "shrunk", "collapsed")}
        self.numbers = {name: kept.get(name, -1 if name == "free" else 0) for name in STATE}
        self.state.set(np.array(list(self.numbers.values()), np.int32))

    def update(self, frame: int, bins: BinCounts, targets: Array, tops: Array, frozen: bool) -> bool:
        """Give every strip of this frame its place; False if the atlas has no room for some triangles.

        A strip that has room nowhere as a whole lies in several parts. numbers["left"] is how many triangles have none.

        frame: a number that grows. targets: int32 (BINS). tops: int32, height of each bin of heights in 1/8 texel.
        frozen: the triangles counted join those that strips have, and nothing moves: a strip that they outgrow gets a
        further part.
        """
        self._grow(self.numbers["strips"] + bins.used_count + PARTS)
        a = self.atlas
        counted = (bins.used_count, bins.used, targets, bins.counts, bins.widest, tops)
        rules = (a.width, a.lines, a.height, a.capacity, a.shrink, a.collapse, ENLARGE[a.enlarge])
        rules += (FITS[a.fit], ORDERS[a.orphans], len(self.strips), len(self.blocks))
        arrays = (self.strips, self.blocks, self.state, self.orphans, self.strip_of)
        self.device.launch(STAGE, self.kernels.manage, 1, frame, int(frozen), *counted, *rules, *arrays, local=1)
        self.numbers = dict(zip(STATE, map(int, self.state.get()), strict=True))
        return not self.numbers["left"]

    def _grow(self, count: int) -> None:
        """Room for `count` strips."""
        if count <= len(self.strips):
            return
        larger = np.zeros(int(1.5 * count), STRIP)
        larger[: len(self.strips)] = self.strips.get()
        self.strips, self.orphans = self.device.upload(larger), self.device.empty(len(larger), np.int32)

    def live_strips(self) -> np.ndarray:
        """The strips that have triangles, and their further parts, as STRIP records."""
        strips = self.strips.get()[: self.numbers["strips"]]
        return strips[strips["bin"] >= 0]

    def live_superblocks(self) -> np.ndarray:
        """The superblocks, as SUPERBLOCK records."""
        return self.blocks.get()[: self.numbers["superblocks"]]


@dataclass
class SuperblocksTwin:
    """The same on the host: strips by bin, each with its parts; superblocks as lists of parts from top to bottom."""

    atlas: Atlas
    strips: dict[int, dict] = field(default_factory=dict)
    blocks: list[dict] = field(default_factory=list)
    entries: list[int | None] = field(default_factory=list)  # bins in the order of the kernel's entries, None for parts
    free: list[int] = field(default_factory=list)
    cursor: tuple[int, int] = (0, 0)  # where the next superblock goes

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
        self.left, self.frozen = 0, frozen
        self._collect(used, targets, counts, widest, frozen)
        orphans = []
        for entry, number in enumerate(self.entries):
            if number is None:
                continue
            strip = self.strips[number]
            if strip["count"] == 0:
                self._take_out(number)
                del self.strips[number]
                self._release(entry)
            elif strip["parts"]:
                orphans += [number] if self._is_orphan(number, frozen) else []
            else:
                self._shape(number, tops)
                orphans += [] if self._attach_anywhere(number) else [number]
        if not frozen:
            orphans += self._collapse()
        for number in orphans:
            if not self.strips[number]["parts"]:
                self._shape(number, tops)
        made = None  # the superblock that an orphan got new last
        for number in sorted(orphans, key=lambda n: -self._class(self.strips[n])):
            if self._attach_orphan(number, made):
                continue
            if self._create(number):
                made = len(self.blocks) - 1
            elif not self._attach_anywhere(number, False):
                self.left += self._place_in_parts(number)
        return not self.left

    def _collect(self, used: np.ndarray, targets: np.ndarray, counts: np.ndarray, widest: np.ndarray, frozen: bool):
        for strip in self.strips.values():
            kept = strip["count"] if frozen else 0
            strip.update(count=kept, base=kept, need=(0, 0), native=False)
        for number, target, count, wide in zip(used, targets, counts, widest, strict=True):
            if target not in self.strips:
                self.strips[target] = dict.fromkeys(("count", "base", "before8", "after8"), 0)
                self.strips[target] |= {"parts": [], "need": (0, 0), "native": False}
                self.entries[self._entry()] = target
            strip = self.strips[target]
            strip["count"] += int(count)
            if number == target:
                strip.update(native=True, need=(int(wide[0]), int(wide[1])))
            elif not strip["native"]:
                strip["need"] = tuple(max(a, int(b)) for a, b in zip(strip["need"], wide, strict=True))

    def _entry(self) -> int:
        if self.free:
            return self.free.pop()
        self.entries.append(None)
        return len(self.entries) - 1

    def _release(self, entry: int) -> None:
        self.entries[entry] = None
        self.free.append(entry)

    def _take_out(self, number: int) -> None:
        """All parts of a strip out of their superblocks; only the first has the strip's own entry."""
        for part in self.strips[number]["parts"]:
            block = self.blocks[part["block"]]
            block["parts"] = [other for other in block["parts"] if other is not part]
            block["peak"] = block["peak"] if block["parts"] else 0
            if part["entry"] is not None:
                self._release(part["entry"])
        self.strips[number]["parts"] = []

    def _rest(self, number: int) -> dict:
        """A strip with those of its triangles that have no slot."""
        strip = self.strips[number]
        return strip | {"count": strip["count"] - sum(part["rows"] * part["per_row"] for part in strip["parts"])}

    def _is_orphan(self, number: int, frozen: bool) -> bool:
        """Shrink a placed strip, or take it out; in a frozen frame, whether it needs a further part."""
        strip = self.strips[number]
        room = sum(part["rows"] * part["per_row"] for part in strip["parts"])
        wide = (
            strip["native"]
            and not frozen
            and any(
                8 * need > 9 * strip[name] + 32 for need, name in zip(strip["need"], ("before8", "after8"), strict=True)
            )
        )
        sparse = not frozen and strip["count"] < self.atlas.shrink * room
        if strip["count"] > room or wide or (sparse and len(strip["parts"]) > 1):
            if not frozen:
                self._take_out(number)
            return True
        if sparse:
            part = strip["parts"][0]
            part["rows"] = min(part["rows"], self._rows(strip, part["per_row"]))
        return False

    def _shape(self, number: int, tops: np.ndarray) -> None:
        strip = self.strips[number]
        need = np.maximum(strip["need"], [strip["before8"], strip["after8"]]) if self.frozen else strip["need"]
        strip.update(slot_shape(*map(int, need), int(tops[number % COLUMN]), self.atlas.enlarge))

    def _room(self, strip: dict) -> int:
        return max(strip["count"], int(np.float32(self.atlas.capacity) * np.float32(strip["count"])))

    def _rows(self, strip: dict, per_row: int) -> int:
        return -(-self._room(strip) // per_row)

    def _wanted(self, strip: dict) -> float:
        return 0.5 * self.atlas.capacity * strip["count"] * strip["period"] * strip["lines"]

    def _gaps(self, block: dict) -> list[tuple[int, int, int]]:
        """First lines of the gaps of a superblock, their heights, and their places among the parts."""
        ends = [0, *(part["y"] + part["rows"] * part["lines"] for part in block["parts"])]
        starts = [*(part["y"] for part in block["parts"]), block["height"]]
        return [(end, start - end, place) for place, (end, start) in enumerate(zip(ends, starts, strict=True))]

    def _attach_anywhere(self, number: int, snug: bool = True) -> bool:
        strip = self._rest(number)
        most = 1.3 * self._wanted(strip) if snug and self.atlas.fit == "tight" else np.inf
        choices = []
        for index, block in enumerate(self.blocks):
            if not self._has_room(strip, block):
                continue
            area = self._rows(strip, slots_in(strip, block["width"])) * strip["lines"] * block["width"]
            if area <= most:
                choices.append((index, area))
        if not choices:
            return False
        good = [c for c in choices if self.atlas.fit == "best" and c[1] <= 1.2 * self._wanted(strip)]
        best = max(good, key=lambda c: self.blocks[c[0]]["width"]) if good else min(choices, key=lambda c: c[1])
        best = choices[0] if self.atlas.fit in ("first", "next") else best
        self._attach(number, best[0])
        return True

    def _attach_orphan(self, number: int, made: int | None) -> bool:
        if self.atlas.fit != "next":
            return self._attach_anywhere(number)
        fits = made is not None and self._has_room(self._rest(number), self.blocks[made])
        if fits:
            self._attach(number, made)
        return fits

    def _has_room(self, strip: dict, block: dict) -> bool:
        """Whether a gap of a superblock holds the strip as a whole."""
        per_row = slots_in(strip, block["width"])
        lines = self._rows(strip, per_row) * strip["lines"] if per_row else 0
        return per_row > 0 and any(height >= lines for _, height, _ in self._gaps(block))

    def _attach(self, number: int, index: int) -> None:
        strip, block = self._rest(number), self.blocks[index]
        rows = self._rows(strip, slots_in(strip, block["width"]))
        gap = next(gap for gap in self._gaps(block) if gap[1] >= rows * strip["lines"])
        self._insert(strip, index, gap, rows)

    def _insert(self, strip: dict, index: int, gap: tuple[int, int, int], rows: int) -> None:
        block, entry = self.blocks[index], self._entry() if strip["parts"] else None
        part = {"block": index, "y": gap[0], "rows": rows, "per_row": slots_in(strip, block["width"]), "entry": entry}
        part["lines"] = strip["lines"]
        strip["parts"].append(part)
        block["parts"].insert(gap[2], part)
        block["peak"] = max(block["peak"], self._used(block))

    def _used(self, block: dict) -> int:
        return sum(part["rows"] * part["lines"] for part in block["parts"])

    def _create(self, number: int) -> bool:
        index = self._open(self._rest(number), True)
        if index is not None:
            self._attach(number, index)
        return index is not None

    def _open(self, strip: dict, whole: bool) -> int | None:
        """A new superblock for a strip or a part of it."""
        atlas, (x, y) = self.atlas, self.cursor
        height = self.blocks[-1]["height"] if x > 0 else self._band_height(strip, atlas.lines - y)
        width = self._width(strip, atlas.width - x, height, whole)
        if not width and x > 0:
            x, y = 0, y + height
            height = self._band_height(strip, atlas.lines - y)
            width = self._width(strip, atlas.width, height, whole)
        if not width:
            return None
        self.blocks.append({"x": x, "y": y, "width": width, "height": height, "parts": [], "peak": 0})
        self.cursor = (x + width, y)
        return len(self.blocks) - 1

    def _square(self, strip: dict) -> int:
        return max(1, int(np.sqrt(self._wanted(strip)) / strip["period"] + 0.5))

    def _band_height(self, strip: dict, left: int) -> int:
        if self.atlas.fit != "tight":
            return self.atlas.height if self.atlas.height <= left else 0
        return min(left, self.atlas.height, self._rows(strip, 2 * self._square(strip)) * strip["lines"])

    def _width(self, strip: dict, left: int, height: int, whole: bool) -> int:
        blocks = self._square(strip)
        while row_width(strip, 2 * blocks) < left and self._rows(strip, 2 * blocks) * strip["lines"] > height:
            blocks += 1 + blocks // 8
        per_row = min(1 if self._room(strip) == 1 else 2 * blocks, slots_in(strip, left))
        too_high = whole and self._rows(strip, max(per_row, 1)) * strip["lines"] > height
        return 0 if not per_row or height < strip["lines"] or too_high else row_width(strip, per_row)

    def _class(self, strip: dict) -> int:
        if self.atlas.fit == "tight":
            return strip["lines"]
        return _width_class(strip["extent"] + 1) if self.atlas.orphans == "widest" else 0

    def _place_in_parts(self, number: int) -> int:
        """Give a strip parts; how many triangles have no slot then."""
        rest, atlas = self._rest(number), self.atlas
        rest["count"] = self._room(rest)
        self.atlas = replace(atlas, capacity=1.0)
        while rest["count"] > 0 and (found := self._next_gap(rest)) is not None:
            index, gap = found
            per_row = slots_in(rest, self.blocks[index]["width"])
            rows = min(-(-rest["count"] // per_row), gap[1] // rest["lines"])
            self._insert(rest, index, gap, rows)
            rest["count"] -= rows * per_row
        self.atlas = atlas
        return max(0, self._rest(number)["count"])

    def _next_gap(self, rest: dict) -> tuple[int, tuple[int, int, int]] | None:
        """A superblock, and a gap in it, for a part of what is left of a strip: a new one, else the roomiest gap."""
        index = self._open(rest, False)
        if index is not None:
            return index, (0, self.blocks[index]["height"], 0)
        gaps = [
            (min(rest["count"], gap[1] // rest["lines"] * slots_in(rest, block["width"])), index, gap)
            for index, block in enumerate(self.blocks)
            for gap in self._gaps(block)
        ]
        slots, index, gap = max(gaps, key=lambda found: found[0], default=(0, 0, None))
        return (index, gap) if slots > 0 else None

    def _collapse(self) -> list[int]:
        orphans = []
        for block in self.blocks:
            if not block["parts"] or self._used(block) >= self.atlas.collapse * block["peak"]:
                continue
            for part in list(block["parts"]):
                owner = [number for number, strip in self.strips.items() if any(p is part for p in strip["parts"])]
                for number in owner:  # none where an earlier part of the strip was among these
                    self._take_out(number)
                    orphans.append(number)
        while self.blocks and not self.blocks[-1]["parts"]:
            gone = self.blocks.pop()
            self.cursor = (gone["x"], gone["y"])
        return orphans


def _width_class(width: int) -> int:
    whole = width.bit_length() - 1
    return 8 * whole + ((width << 3 >> whole) & 7)
