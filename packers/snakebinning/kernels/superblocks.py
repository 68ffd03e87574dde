"""Superblock management (section 3.5, algorithm 2): strips of bins in columns of the atlas, from frame to frame."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from shading_atlas_bench.kernels.constants import constants_of
from shading_atlas_bench.packers.snakebinning.kernels.bins import BINS, COLUMN, LARGEST_ATLAS
from shading_atlas_bench.packers.snakebinning.kernels.strip import ENLARGE, SlotShape, row_width, slot_shape, slots_in

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic import arrays
    from shading_atlas_bench.arithmetic.arrays import Ints
    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.packers.snakebinning.kernels.count import UsedBins

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
MOST_BLOCKS = 1 << 14  # superblocks, at least: those that are empty may lie between others
PARTS = 1024  # further parts of strips that a frame may make
DEFINED = constants_of(HERE / "superblocks.cl")
FITS = {name: DEFINED.whole(name.upper()) for name in ("first", "best", "tight", "next")}
ORDERS = {name: DEFINED.whole(name.upper()) for name in ("widest", "found")}


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


def superblock_height(width: int, height: int, asked: int) -> int:
    """The height of superblocks in an atlas; 0 asks for a choice. ValueError for sizes that cannot be used."""
    if max(width, height) > LARGEST_ATLAS or min(width, height) < 2:
        raise ValueError(
            f"The atlas of {width}x{height} has a side outside 2 to {LARGEST_ATLAS} texels: give another size."
        )
    chosen = asked or height // max(1, height // max(512, height // 4))
    if not 2 <= chosen <= height:
        raise ValueError(f"The superblock height {chosen} is outside 2 to the atlas height {height}; 0 chooses one.")
    return chosen


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

    def update(self, frame: int, bins: UsedBins, targets: Array, tops: Array, frozen: bool) -> bool:
        """Give every strip of this frame its place; False if the atlas has no room for some triangles.

        A strip that has room nowhere as a whole lies in several parts. numbers["left"] is how many triangles have none.

        frame: a number that grows. targets: int32 (BINS). tops: int32 (COLUMN), see HeightBins.tops.
        frozen: the triangles counted join those that strips have, and nothing moves: a strip that they outgrow gets a
        further part.
        """
        self._grow(self.numbers["strips"] + bins.count + PARTS)
        a = self.atlas
        counted = (bins.count, bins.numbers, targets, bins.triangles, bins.widest, tops)
        room = (a.width, a.lines, a.height, a.capacity, a.shrink, a.collapse)
        rules = (ENLARGE[a.enlarge], FITS[a.fit], ORDERS[a.orphans])
        kept = (len(self.strips), len(self.blocks), self.strips, self.blocks, self.state, self.orphans, self.strip_of)
        self.device.launch(STAGE, self.kernels.manage, 1, frame, int(frozen), *counted, *room, *rules, *kept, local=1)
        self.numbers = dict(zip(STATE, map(int, self.state.get()), strict=True))
        return not self.numbers["left"]

    def _grow(self, count: int) -> None:
        """Room for `count` strips, and at least as many superblocks: each may hold one strip only."""
        if count <= len(self.strips):
            return
        most = int(1.5 * count)
        self.strips, self.orphans = self._larger(self.strips, most), self.device.empty(most, np.int32)
        self.blocks = self._larger(self.blocks, max(most, len(self.blocks)))

    def _larger(self, known: Array, most: int) -> Array:
        """A copy of records on the device with room for `most`."""
        larger = np.zeros(most, known.dtype)
        larger[: len(known)] = known.get()
        return self.device.upload(larger)

    def live_strips(self) -> NDArray[np.void]:
        """The strips that have triangles, and their further parts: (n) of STRIP records."""
        strips = self.strips.get()[: self.numbers["strips"]]
        return strips[strips["bin"] >= 0]

    def live_superblocks(self) -> NDArray[np.void]:
        """The superblocks: (n) of SUPERBLOCK records."""
        return self.blocks.get()[: self.numbers["superblocks"]]


@dataclass(eq=False)
class PartTwin:
    """Whole rows of a strip in a superblock, given by its place in the list; entry: of a further part, else None."""

    block: int
    y: int
    rows: int
    per_row: int
    lines: int
    entry: int | None

    @property
    def slots(self) -> int:
        """Slots in the part's rows."""
        return self.rows * self.per_row


@dataclass(eq=False)
class StripTwin:
    """As the fields of a strip in strip.cl; need: the lengths that this frame's triangles need, before and after."""

    count: int = 0
    base: int = 0
    need: tuple[int, int] = (0, 0)
    native: bool = False
    shape: SlotShape = field(default_factory=SlotShape)
    parts: list[PartTwin] = field(default_factory=list)


@dataclass(eq=False)
class BlockTwin:
    """A superblock with its parts from top to bottom; peak: most lines of texels in them since it was empty."""

    x: int
    y: int
    width: int
    height: int
    parts: list[PartTwin] = field(default_factory=list)
    peak: int = 0

    @property
    def used(self) -> int:
        """Lines of texels in parts."""
        return sum(part.rows * part.lines for part in self.parts)

    @property
    def gaps(self) -> list[GapTwin]:
        """The gaps above, between and below the parts, those without lines too."""
        ends = [0, *(part.y + part.rows * part.lines for part in self.parts)]
        starts = [*(part.y for part in self.parts), self.height]
        return [GapTwin(end, start - end, i) for i, (end, start) in enumerate(zip(ends, starts, strict=True))]


@dataclass(frozen=True)
class GapTwin:
    """Free lines of a superblock: the first, how many, and between which of its parts."""

    y: int
    lines: int
    index: int


@dataclass
class SuperblocksTwin:
    """The same on the host: strips by bin; entries: bins in the order of the kernel's entries, None for parts."""

    atlas: Atlas
    strips: dict[int, StripTwin] = field(default_factory=dict)
    blocks: list[BlockTwin] = field(default_factory=list)
    entries: list[int | None] = field(default_factory=list)
    free: list[int] = field(default_factory=list)
    cursor: tuple[int, int] = (0, 0)  # where the next superblock goes
    left: int = 0
    frozen: bool = False

    def update_twin(
        self,
        used: arrays.Array,
        targets: arrays.Array,
        counts: arrays.Array,
        widest: arrays.Array,
        tops: Ints,
        frozen: bool = False,
    ) -> bool:
        """Place the strips of k used bins.

        used, targets, counts: int (k), the bins, their targets and triangles. widest: int (k, 2), their longest
        lengths, as in UsedBins. tops: int32 (COLUMN), see HeightBins.tops.
        """
        self.left, self.frozen = 0, frozen
        self._collect(used, targets, counts, widest)
        orphans = self._place_kept(tops)
        if not frozen:
            orphans += self._collapse()
        for number in orphans:
            if not self.strips[number].parts:
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

    def _collect(self, used: arrays.Array, targets: arrays.Array, counts: arrays.Array, widest: arrays.Array) -> None:
        for strip in self.strips.values():
            strip.count = strip.base = strip.count if self.frozen else 0
            strip.need, strip.native = (0, 0), False
        for number, target, count, wide in zip(used, targets, counts, widest.tolist(), strict=True):
            if target not in self.strips:
                self.strips[target] = StripTwin()
                self.entries[self._entry()] = target
            strip = self.strips[target]
            strip.count += int(count)
            if number == target:
                strip.native, strip.need = True, (wide[0], wide[1])
            elif not strip.native:
                strip.need = (max(strip.need[0], wide[0]), max(strip.need[1], wide[1]))

    def _place_kept(self, tops: Ints) -> list[int]:
        """Take out strips without triangles, keep or place the others; those that have no place, or not enough."""
        orphans = []
        for entry, number in enumerate(self.entries):
            if number is None:
                continue
            strip = self.strips[number]
            if strip.count == 0:
                self._take_out(number)
                del self.strips[number]
                self._release(entry)
            elif strip.parts:
                orphans += [number] if self._is_orphan(number) else []
            else:
                self._shape(number, tops)
                orphans += [] if self._attach_anywhere(number) else [number]
        return orphans

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
        for part in self.strips[number].parts:
            block = self.blocks[part.block]
            block.parts = [other for other in block.parts if other is not part]
            block.peak = block.peak if block.parts else 0
            if part.entry is not None:
                self._release(part.entry)
        self.strips[number].parts = []

    def _rest(self, number: int) -> StripTwin:
        """A strip with those of its triangles that have no slot; its parts are the strip's own list."""
        strip = self.strips[number]
        return replace(strip, count=strip.count - sum(part.slots for part in strip.parts))

    def _is_orphan(self, number: int) -> bool:
        """Shrink a placed strip, or take it out; in a frozen frame, whether it needs a further part."""
        strip, frozen = self.strips[number], self.frozen
        room = sum(part.slots for part in strip.parts)
        has = (strip.shape.before8, strip.shape.after8)
        too_wide = any(8 * need > 9 * own + 32 for need, own in zip(strip.need, has, strict=True))
        wide = strip.native and not frozen and too_wide
        sparse = not frozen and strip.count < self.atlas.shrink * room
        if strip.count > room or wide or (sparse and len(strip.parts) > 1):
            if not frozen:
                self._take_out(number)
            return True
        if sparse:
            part = strip.parts[0]
            part.rows = min(part.rows, self._rows(strip, part.per_row))
        return False

    def _shape(self, number: int, tops: Ints) -> None:
        strip = self.strips[number]
        before, after = strip.need
        if self.frozen:
            before, after = max(before, strip.shape.before8), max(after, strip.shape.after8)
        strip.shape = slot_shape(before, after, int(tops[number % COLUMN]), self.atlas.enlarge)

    def _room(self, strip: StripTwin) -> int:
        return max(strip.count, int(np.float32(self.atlas.capacity) * np.float32(strip.count)))

    def _rows(self, strip: StripTwin, per_row: int) -> int:
        return -(-self._room(strip) // per_row)

    def _wanted(self, strip: StripTwin) -> float:
        return 0.5 * self.atlas.capacity * strip.count * strip.shape.period * strip.shape.lines

    def _attach_anywhere(self, number: int, snug: bool = True) -> bool:
        strip = self._rest(number)
        most = 1.3 * self._wanted(strip) if snug and self.atlas.fit == "tight" else np.inf
        choices = []
        for index, block in enumerate(self.blocks):
            if not self._has_room(strip, block):
                continue
            area = self._rows(strip, slots_in(strip.shape, block.width)) * strip.shape.lines * block.width
            if area <= most:
                choices.append((index, area))
        if not choices:
            return False
        good = [c for c in choices if self.atlas.fit == "best" and c[1] <= 1.2 * self._wanted(strip)]
        best = max(good, key=lambda c: self.blocks[c[0]].width) if good else min(choices, key=lambda c: c[1])
        best = choices[0] if self.atlas.fit in ("first", "next") else best
        self._attach(number, best[0])
        return True

    def _attach_orphan(self, number: int, made: int | None) -> bool:
        if self.atlas.fit != "next":
            return self._attach_anywhere(number)
        if made is None or not self._has_room(self._rest(number), self.blocks[made]):
            return False
        self._attach(number, made)
        return True

    def _has_room(self, strip: StripTwin, block: BlockTwin) -> bool:
        """Whether a gap of a superblock holds the strip as a whole."""
        per_row = slots_in(strip.shape, block.width)
        lines = self._rows(strip, per_row) * strip.shape.lines if per_row else 0
        return per_row > 0 and any(gap.lines >= lines for gap in block.gaps)

    def _attach(self, number: int, index: int) -> None:
        strip, block = self._rest(number), self.blocks[index]
        rows = self._rows(strip, slots_in(strip.shape, block.width))
        gap = next(gap for gap in block.gaps if gap.lines >= rows * strip.shape.lines)
        self._insert(strip, index, gap, rows)

    def _insert(self, strip: StripTwin, index: int, gap: GapTwin, rows: int) -> None:
        block, entry = self.blocks[index], self._entry() if strip.parts else None
        part = PartTwin(index, gap.y, rows, slots_in(strip.shape, block.width), strip.shape.lines, entry)
        strip.parts.append(part)
        block.parts.insert(gap.index, part)
        block.peak = max(block.peak, block.used)

    def _create(self, number: int) -> bool:
        index = self._open(self._rest(number), True)
        if index is not None:
            self._attach(number, index)
        return index is not None

    def _open(self, strip: StripTwin, whole: bool) -> int | None:
        """A new superblock for a strip or a part of it."""
        atlas, (x, y) = self.atlas, self.cursor
        height = self.blocks[-1].height if x > 0 else self._band_height(strip, atlas.lines - y)
        width = self._width(strip, atlas.width - x, height, whole)
        if not width and x > 0:
            x, y = 0, y + height
            height = self._band_height(strip, atlas.lines - y)
            width = self._width(strip, atlas.width, height, whole)
        if not width:
            return None
        self.blocks.append(BlockTwin(x, y, width, height))
        self.cursor = (x + width, y)
        return len(self.blocks) - 1

    def _square(self, strip: StripTwin) -> int:
        return max(1, int(np.sqrt(self._wanted(strip)) / strip.shape.period + 0.5))

    def _band_height(self, strip: StripTwin, left: int) -> int:
        if self.atlas.fit != "tight":
            return self.atlas.height if self.atlas.height <= left else 0
        return min(left, self.atlas.height, self._rows(strip, 2 * self._square(strip)) * strip.shape.lines)

    def _width(self, strip: StripTwin, left: int, height: int, whole: bool) -> int:
        blocks, shape = self._square(strip), strip.shape
        while row_width(shape, 2 * blocks) < left and self._rows(strip, 2 * blocks) * shape.lines > height:
            blocks += 1 + blocks // 8
        per_row = min(1 if self._room(strip) == 1 else 2 * blocks, slots_in(shape, left))
        too_high = whole and self._rows(strip, max(per_row, 1)) * shape.lines > height
        return 0 if not per_row or height < shape.lines or too_high else row_width(shape, per_row)

    def _class(self, strip: StripTwin) -> int:
        if self.atlas.fit == "tight":
            return strip.shape.lines
        return _width_class(strip.shape.extent + 1) if self.atlas.orphans == "widest" else 0

    def _place_in_parts(self, number: int) -> int:
        """Give a strip parts; how many triangles have no slot then."""
        rest, atlas = self._rest(number), self.atlas
        rest.count = self._room(rest)
        self.atlas = replace(atlas, capacity=1.0)
        while rest.count > 0 and (found := self._next_gap(rest)) is not None:
            index, gap = found
            per_row = slots_in(rest.shape, self.blocks[index].width)
            rows = min(-(-rest.count // per_row), gap.lines // rest.shape.lines)
            self._insert(rest, index, gap, rows)
            rest.count -= rows * per_row
        self.atlas = atlas
        return max(0, self._rest(number).count)

    def _next_gap(self, rest: StripTwin) -> tuple[int, GapTwin] | None:
        """A superblock, and a gap in it, for a part of what is left of a strip: a new one, else the roomiest gap."""
        index = self._open(rest, False)
        if index is not None:
            return index, GapTwin(0, self.blocks[index].height, 0)
        most, roomiest = 0, None
        for index, block in enumerate(self.blocks):
            for gap in block.gaps:
                slots = min(rest.count, gap.lines // rest.shape.lines * slots_in(rest.shape, block.width))
                if slots > most:
                    most, roomiest = slots, (index, gap)
        return roomiest

    def _collapse(self) -> list[int]:
        orphans = []
        for block in self.blocks:
            if not block.parts or block.used >= self.atlas.collapse * block.peak:
                continue
            for part in list(block.parts):
                owner = [number for number, strip in self.strips.items() if any(p is part for p in strip.parts)]
                for number in owner:  # none where an earlier part of the strip was among these
                    self._take_out(number)
                    orphans.append(number)
        while self.blocks and not self.blocks[-1].parts:
            gone = self.blocks.pop()
            self.cursor = (gone.x, gone.y)
        return orphans


def _width_class(width: int) -> int:
    whole = width.bit_length() - 1
    return 8 * whole + ((width << 3 >> whole) & 7)
