"""Cases of SnakeBinning: triangles before the camera, and those of all sizes around it."""

from __future__ import annotations

from dataclasses import astuple, dataclass, fields, replace
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.kernels.case import Bound, Cost, Result, Trial, case, seeded
from shading_atlas_bench.kernels.inputs.soups import look_at, mixed_soup, perspective
from shading_atlas_bench.kernels.samples import Samples
from shading_atlas_bench.kernels.triangles import Triangles
from shading_atlas_bench.packers.snakebinning.kernels.bins import BINS, HeightBins
from shading_atlas_bench.packers.snakebinning.kernels.clear import clear_strips, clear_strips_twin
from shading_atlas_bench.packers.snakebinning.kernels.corners import locate_corners, locate_corners_twin
from shading_atlas_bench.packers.snakebinning.kernels.count import MAP_WORDS, BinCounts, UsedBins, count_bins_twin
from shading_atlas_bench.packers.snakebinning.kernels.emit import Blowup, PlacedTriangle, emit_samples, emit_twin
from shading_atlas_bench.packers.snakebinning.kernels.footprint import (
    Fit,
    Footprints,
    measure_triangles,
    measure_triangles_twin,
    pack_views,
    rounded_twin,
)
from shading_atlas_bench.packers.snakebinning.kernels.inputs import crowd, table_of, upload_bins
from shading_atlas_bench.packers.snakebinning.kernels.mapping import Mapping, map_bins_twin
from shading_atlas_bench.packers.snakebinning.kernels.pieces import SlicedScene, TriangleList
from shading_atlas_bench.packers.snakebinning.kernels.place import (
    Placement,
    Places,
    find_new,
    list_records,
    parts_twin,
    place_triangles,
    place_twin,
)
from shading_atlas_bench.packers.snakebinning.kernels.slices import Slices
from shading_atlas_bench.packers.snakebinning.kernels.split import piece_maps, split_samples, split_samples_twin
from shading_atlas_bench.packers.snakebinning.kernels.strip import SlotShape
from shading_atlas_bench.packers.snakebinning.kernels.superblocks import Atlas, Superblocks, SuperblocksTwin

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic import arrays
    from shading_atlas_bench.arithmetic.arrays import Floats, Words
    from shading_atlas_bench.kernels.device import Device

FITS = {"typical": Fit(HeightBins(511.0), 1022.0)}
FITS["adversarial"] = replace(FITS["typical"], point=2.0)
WIDTH = 2048
SLOT_FIELDS = [field.name for field in fields(SlotShape)]


@dataclass
class Scene:
    """Triangles before two views, measured. Adversarial: of all sizes, those below 2 texels as points.

    corners: float32 (n, 3, 3). views: float32 (2, 16), see pack_views.
    """

    device: Device
    corners: Floats
    sliced: SlicedScene
    listed: TriangleList
    views: Floats
    footprints: Footprints
    fit: Fit

    @classmethod
    def make(cls, device: Device, kind: str, count: int) -> Scene:
        """`count` random triangles, measured from two eyes."""
        rng = seeded(kind)
        corners = mixed_soup(rng, count)
        if kind == "typical":
            middle = rng.uniform(-1, 1, (count, 1, 3)) * [4, 2.5, 3] - [0, 0, 6]
            corners = (middle + rng.normal(0, 2 / np.sqrt(count), (count, 3, 3))).astype(np.float32)
        indices = np.arange(3 * count).reshape(-1, 3)
        triangles = Triangles.upload(device, corners.reshape(-1, 3), indices, np.zeros(count))
        eyes = [look_at((x, 0.02, 0), (x, 0, -5)) for x in (0.0, 0.1)]
        views = pack_views([(view, perspective(60, 16 / 9), 960) for view in eyes], 0.7)
        sliced = SlicedScene(triangles, Slices().upload(device, count))
        listed = TriangleList.upload(device, np.arange(count, dtype=np.int32))
        scene = cls(device, corners, sliced, listed, views, Footprints.allocate(device, count), FITS[kind])
        scene.measure()
        return scene

    def measure(self) -> None:
        """Measure the triangles into new footprints."""
        fresh = Footprints.allocate(self.device, len(self.corners))
        measure_triangles(self.device, self.listed, self.sliced, self.views, self.fit, fresh)
        self.footprints = fresh


@dataclass
class Packed:
    """A scene's triangles in places."""

    scene: Scene
    mapping: Mapping
    placement: Placement

    @classmethod
    def make(cls, scene: Scene) -> Packed:
        """The scene's triangles, mapped exactly and placed in an atlas of WIDTH x WIDTH texels."""
        device, count, footprints = scene.device, len(scene.corners), scene.footprints
        bins = BinCounts(device).count(scene.listed, footprints.bins, footprints.lengths)
        mapping = Mapping(device, "exact", 16)
        mapping.update(bins)
        blocks, places = Superblocks(device, Atlas(WIDTH, WIDTH, 512)), Places.allocate(device, count)
        blocks.update(1, bins, mapping.targets, device.upload(scene.fit.heights.tops()), False)
        packed = cls(scene, mapping, Placement(footprints, blocks, places))
        packed.place()
        return packed

    def place(self) -> None:
        """Place the triangles as if all were new."""
        scene, device = self.scene, self.scene.device
        self.placement = replace(self.placement, places=Places.allocate(device, len(scene.corners)))
        is_new = find_new(device, scene.listed, 1, self.placement)
        place_triangles(device, 1, scene.listed, is_new, self.mapping.targets, self.placement)

    def samples(self) -> Samples:
        """The samples of all placed triangles."""
        scene = self.scene
        return emit_samples(scene.device, scene.listed, scene.sliced, self.placement, Blowup(), WIDTH)


@case(
    {"footprint.measure_triangles": Cost("n", "(4 + 12 + 36 + 16 + 8)*n", "500*n")},
    1 << 16,
    1 << 12,
    adversarial=Bound(wrong=5e-4),
)
def footprints(device: Device, kind: str, size: int) -> Trial:
    """Compares lengths in eighths of a texel where the same corners are meant."""
    scene = Scene.make(device, kind, size)

    def results() -> list[Result]:
        scene.measure()
        found, expected = scene.footprints, measure_triangles_twin(scene.corners, scene.views, scene.fit)
        same = found.words.get()[:size] >> 24 == expected.roles
        lengths = found.lengths.get()[:size, :3].astype(int)
        return [Result(lengths[same], rounded_twin(expected.shape)[same])]

    return Trial({"n": size}, scene.measure, results)


COUNTING = {
    "count.forget_bins": Cost("u", "20*u"),
    "count.count_bins": Cost("n", "(4 + 4 + 8 + 12)*n"),
    "count.count_bits": Cost("w", "8*w"),
    "count.list_bits": Cost("w", "8*w + 4*u"),
}


@case(COUNTING, 1 << 18)
def counting(device: Device, kind: str, size: int) -> Trial:
    """Adversarial: all triangles in one bin."""
    rng, counts = seeded(kind), BinCounts(device)
    bins = np.full(size, BINS // 2) if kind == "adversarial" else (rng.beta(2, 5, size) * BINS).astype(int)
    lengths = rng.integers(0, 4000, (size, 4)).astype(np.uint16)
    listed = TriangleList.upload(device, np.arange(size, dtype=np.int32))
    uploaded = device.upload(bins.astype(np.int32)), device.upload(lengths)

    def run() -> UsedBins:
        return counts.count(listed, *uploaded)

    def results() -> list[Result]:
        ours, (used, totals, widest) = run(), count_bins_twin(bins, lengths)
        found = (ours.numbers.get()[: ours.count], ours.triangles.get()[used], ours.widest.get()[used])
        return [Result(*pair) for pair in zip(found, (used, totals, widest), strict=True)]

    return Trial({"n": size, "w": MAP_WORDS, "u": len(np.unique(bins))}, run, results)


def _mapping(device: Device, kind: str, size: int, search: str) -> Trial:
    """Bins of a crowd of triangles. Adversarial: only one is a sink."""
    used, counts = crowd(seeded(kind), size)
    if kind == "adversarial":
        counts[:] = 1
        counts[len(used) // 2] = 100
    bins, mapping = upload_bins(device, used, counts, np.zeros((len(used), 2))), Mapping(device, search, 16)

    def run() -> None:
        mapping.reset()
        mapping.update(bins)

    def results() -> list[Result]:
        run()
        return [Result(mapping.targets.get()[used], map_bins_twin(used, counts, 16, search))]

    return Trial({"u": len(used), "sources": int((counts <= 16).sum())}, run, results)


# A search reads the bits of 11 x 11 runs of 201 heights.
EXACT = {
    "mapping.find_sinks": Cost("u", "16*u"),
    "mapping.search_exactly": Cost("sources", "11*11*28*sources"),
    "mapping.apply_mapping": Cost("u", "16*u"),
}


@case(EXACT, 3000, 600)
def exact_mapping(device: Device, kind: str, size: int) -> Trial:
    """Compares the target of each used bin, found by the exact search."""
    return _mapping(device, kind, size, "exact")


@case({"mapping.add_sinks": Cost("u", "40*u"), "mapping.search_hierarchy": Cost("sources", "24*sources")}, 3000, 600)
def hierarchical_mapping(device: Device, kind: str, size: int) -> Trial:
    """Compares the target of each used bin, found in the hierarchy."""
    return _mapping(device, kind, size, "hierarchical")


@case({"superblocks.manage": Cost("u", "(16 + 168)*u")}, 1500, 300)
def superblocks(device: Device, kind: str, size: int) -> Trial:
    """A frame with everything new. Adversarial: as algorithm 2 is printed, in an atlas too small for it, so that
    strips lie in parts."""
    rng, (used, counts) = seeded(kind), crowd(seeded(kind), size)
    widest = rng.integers(8, 400, (len(used), 2))
    atlas = Atlas(512, 512, 512, fit="next", orphans="found") if kind == "adversarial" else Atlas(8192, 8192, 512)
    bins, tops = upload_bins(device, used, counts, widest), HeightBins(511.0).tops()
    targets, uploaded_tops = device.upload(table_of(used, used)), device.upload(tops)

    def run() -> Superblocks:
        ours = Superblocks(device, atlas)
        ours.update(1, bins, targets, uploaded_tops, False)
        return ours

    def results() -> list[Result]:
        live, twin = run().live_strips(), SuperblocksTwin(atlas)
        twin.update_twin(used, used, counts, widest, tops, False)
        strips = {int(strip["bin"]): strip for strip in live[live["count"] > 0]}
        found = [[strips[number][name] for name in ("count", "base", *SLOT_FIELDS)] for number in twin.strips]
        expected = [[strip.count, strip.base, *astuple(strip.shape)] for strip in twin.strips.values()]
        placed = live[live["superblock"] >= 0]
        parts = np.array([placed[name] for name in ("bin", "superblock", "y", "rows", "per_row")]).T
        twins = np.array(
            [
                [number, part.block, part.y, part.rows, part.per_row]
                for number, strip in twin.strips.items()
                for part in strip.parts
            ]
        )
        ordered = (some[np.lexsort(some.T)] for some in (parts, twins))
        return [Result(np.array(found), np.array(expected)), Result(*ordered)]

    return Trial({"u": len(used)}, run, results)


PLACING = {
    "place.find_new": Cost("n", "(4 + 4 + 8 + 4 + 1)*n"),
    "place.find_strips": Cost("n", "(4 + 1 + 4 + 4 + 4 + 4 + 4)*n"),
    "place.place_triangles": Cost("n", "(12 + 84 + 8 + 24)*n"),
    "place.list_records": Cost("n", "(4 + 4 + 8 + 4 + 4 + 8 + 8 + 20)*n"),
}


@case(PLACING, 1 << 13, 1 << 10)
def placing(device: Device, kind: str, size: int) -> Trial:
    """Compares all places, and the drawn lengths of the triangles that have one."""
    scene = Scene.make(device, kind, size)
    packed = Packed.make(scene)
    blocks = packed.placement.superblocks

    def run() -> tuple[Words, Floats]:
        packed.place()
        return list_records(device, scene.listed, packed.placement)

    def results() -> list[Result]:
        records, _ = run()
        bins, lengths = scene.footprints.bins.get()[:size], scene.footprints.lengths.get()[:size, :3].astype(int)
        numbers = blocks.strip_of.get()[packed.mapping.targets.get()[bins]]
        strips, live = blocks.strips.get(), blocks.live_superblocks()
        rank = np.array([np.count_nonzero(numbers[:i] == number) for i, number in enumerate(numbers)])
        parts, rank = parts_twin(strips, numbers, rank)
        strip = strips[parts]
        corner = np.stack([live["x"], live["y"]], axis=1)[strip["superblock"]]
        places, drawn = place_twin(rank, strip, corner, lengths)
        places = np.where(parts < 0, 0, places)
        placed = places > 0
        ours = packed.placement.places.drawn.get()[:size, :3]
        return [Result(records[:, 0], places), Result(ours[placed], drawn[placed])]

    return Trial({"n": size}, run, results)


@case(
    {
        "emit.size_slots": Cost("s", "(88 + 4)*s"),
        "emit.list_slots": Cost("s", "(88 + 16)*s + 4*t"),
        "emit.count_samples": Cost("p", "(4 + 8 + 4 + 16)*p"),
        "emit.emit_samples": Cost("n", "20*n", "60*n"),
    },
    1 << 13,
    1 << 9,
    typical=Bound(14),
)
def emission(device: Device, kind: str, size: int) -> Trial:
    """Compares every field of all samples."""
    scene = Scene.make(device, kind, size)
    packed = Packed.make(scene)

    def results() -> list[Result]:
        samples, expected = packed.samples(), samples_twin(packed)
        return [Result(getattr(samples, name).get()[: samples.count], values) for name, values in expected.items()]

    blocks = packed.placement.superblocks
    texels = int(blocks.live_strips()["texels"].sum())
    sizes = {"p": size, "n": packed.samples().count, "s": len(blocks.strips), "t": texels}
    return Trial(sizes, packed.samples, results)


def samples_twin(packed: Packed) -> dict[str, arrays.Array]:
    """All samples, triangle by triangle, as from `emit_twin`."""
    corners, places = packed.scene.corners, packed.placement.places
    slots = [SlotShape.of(strip) for strip in packed.placement.superblocks.strips.get()]
    placed, drawn, strips = places.places.get(), places.drawn.get(), places.slots.get()[:, 0]
    words = packed.scene.footprints.words.get()
    parts = [
        emit_twin(
            PlacedTriangle(t, int(placed[t]), drawn[t], int(words[t]), corners[t]), slots[strips[t]], Blowup(), WIDTH
        )
        for t in range(len(corners))
        if placed[t]
    ]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


@case({"corners.locate_corners": Cost("n", "(4 + 8 + 4 + 36)*n", "20*n")}, 1 << 13, typical=Bound(2))
def corners(device: Device, kind: str, size: int) -> Trial:
    """Compares the corners of all triangles, homogeneous."""
    packed = Packed.make(Scene.make(device, kind, size))
    places, drawn = packed.placement.places.places, packed.placement.places.drawn
    words = packed.scene.footprints.words

    def run() -> Array:
        return locate_corners(device, places, drawn, words, size, "corners")

    def results() -> list[Result]:
        host = (array.get()[:size] for array in (places, drawn, words))
        return [Result(run().get(), locate_corners_twin(*host))]

    return Trial({"n": size}, run, results)


@case({"clear.clear_strips": Cost("n", "8*n")}, 1 << 11)
def clearing(device: Device, kind: str, size: int) -> Trial:
    """A strip's texels are read twice and written once. Adversarial: hardly any texel is shaded."""
    packed = Packed.make(Scene.make(device, kind, size))
    samples, blocks, rng = packed.samples(), packed.placement.superblocks, seeded(kind)
    atlas = np.zeros((WIDTH, WIDTH, 4), np.uint8)
    texel = samples.texel.get()[: samples.count][:: 50 if kind == "adversarial" else 1]
    atlas.reshape(-1, 4)[texel, :3] = rng.integers(0, 256, (len(texel), 3))
    atlas.reshape(-1, 4)[texel, 3] = 255
    uploaded, live = device.upload(atlas), blocks.live_strips()
    width = blocks.live_superblocks()["width"][live["superblock"]]

    def results() -> list[Result]:
        fresh = device.upload(atlas)
        clear_strips(device, blocks, fresh)
        return [Result(fresh.get(), clear_strips_twin(live, blocks.live_superblocks(), atlas))]

    texels = int((live["rows"] * live["lines"] * width).sum())
    return Trial({"n": texels}, lambda: clear_strips(device, blocks, uploaded), results)


@case({"split.split_samples": Cost("n", "24*n", "12*n*k")}, 1 << 18, 1 << 12, typical=Bound(1))
def splitting(device: Device, kind: str, size: int) -> Trial:
    """Samples of a triangle in four pieces. Adversarial: on the pieces' edges."""
    rng = seeded(kind)
    thirds = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.5, 0.5, 0], [0, 0.5, 0.5], [0.5, 0, 0.5]])
    parts = thirds[[[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]]]
    weights = rng.dirichlet(np.ones(3), size)
    if kind == "adversarial":
        weights = weights[:, :1] * thirds[3] + (1 - weights[:, :1]) * thirds[4]
    bary, triangle = weights[:, 1:].astype(np.float32), rng.integers(0, 2, size).astype(np.int32)
    pieces, maps = np.array([[0, 0], [0, 4]], np.int32), piece_maps(parts[:, :, 1:]).astype(np.float32)
    uploaded = device.upload(pieces), device.upload(maps)

    def run() -> Samples:
        samples = Samples.upload(device, triangle, bary[:, 0], bary[:, 1], bary[:, 0], triangle)
        return split_samples(device, samples, 2, *uploaded, "split")

    def results() -> list[Result]:
        samples, (expected, places) = run(), split_samples_twin(triangle, bary, pieces, maps)
        found = samples.triangle.get()[:size]
        same = found == expected
        own = np.stack([samples.bary1.get()[:size], samples.bary2.get()[:size]], axis=1)
        return [Result(found, expected), Result(own[same], places[same])]

    return Trial({"n": size, "k": 4}, run, results)
