"""Cases of Tessellated Shading Streaming: small triangles before the camera, and those around and through it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.kernels.case import Bound, Cost, Result, Trial, case, seeded
from shading_atlas_bench.kernels.common.rank import rank_by_class_twin
from shading_atlas_bench.kernels.inputs.soups import FAR_EYE, far_soup
from shading_atlas_bench.kernels.samples import Samples
from shading_atlas_bench.kernels.triangles import Triangles
from shading_atlas_bench.packers.tss.kernels.bins import Bins, BinTables
from shading_atlas_bench.packers.tss.kernels.emit import (
    CellTable,
    Placed,
    count_samples,
    emit_primitive_twin,
    emit_samples,
)
from shading_atlas_bench.packers.tss.kernels.footprint import camera_floats, measure_triangles, measure_triangles_twin
from shading_atlas_bench.packers.tss.kernels.forms import choose_strategies, choose_strategies_twin
from shading_atlas_bench.packers.tss.kernels.layout import Items, lay_out, lay_out_twin, place_items, place_items_twin
from shading_atlas_bench.packers.tss.kernels.locate import UNPLACED, Located, locate, locate_twin
from shading_atlas_bench.packers.tss.kernels.perspective import invert_depths, invert_depths_twin
from shading_atlas_bench.packers.tss.kernels.primitives import Primitives, list_primitives, measure_primitives_twin

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic import arrays
    from shading_atlas_bench.arithmetic.arrays import Floats, Longs
    from shading_atlas_bench.kernels.device import Device

SCALE, SLANTED, STAGE = 0.83, 3.0, "tss"


@dataclass
class Scene:
    """Triangles before a camera.

    corners: float32 (n, 3, 3). camera: float32 (21), see camera_floats. ids: int32 (n), on the device.
    """

    device: Device
    corners: Floats
    camera: Floats
    triangles: Triangles
    ids: Array

    @classmethod
    def make(cls, device: Device, kind: str, count: int) -> Scene:
        """`count` random triangles before a camera at FAR_EYE, 960 x 608 pixels."""
        rng = seeded(kind)
        corners = far_soup(rng, count)
        if kind == "typical":
            centres = rng.uniform(-1, 1, (count, 1, 3)) * [4, 2.5, 3] - [0, 0, 6]
            corners = (FAR_EYE + centres + rng.normal(0, 2 / np.sqrt(count), (count, 3, 3))).astype(np.float32)
        view = np.eye(4)
        view[:3, 3] = -FAR_EYE
        projection = np.array([[1.2, 0, 0, 0], [0, 1.9, 0, 0], [0, 0, 0, 0.02], [0, 0, -1, 0]])
        camera = camera_floats(view, projection, 960, 608)
        indices = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
        triangles = Triangles.upload(device, corners.reshape(-1, 3), indices, np.zeros(count, np.uint8))
        return cls(device, corners, camera, triangles, device.upload(np.arange(count, dtype=np.int32)))

    def primitives(self) -> Primitives:
        """The primitives of all triangles."""
        camera = self.device.upload(self.camera)
        return list_primitives(self.device, self.ids, len(self.corners), self.triangles, camera, SCALE, SLANTED)


@dataclass
class Packed:
    """A scene's primitives in places.

    totals: int64 (B), items per bin. ranks: int64 (2 n), of items, as Items has them. regions: int32 (B, 6), see
    lay_out. used: rows of the atlas.
    """

    primitives: Primitives
    bins: Bins
    tables: BinTables
    items: Items
    totals: Longs
    ranks: Longs
    regions: Array
    used: int
    placed: Placed

    @classmethod
    def make(cls, scene: Scene) -> Packed:
        """The scene's primitives in places of an atlas 4096 texels wide."""
        device, primitives, bins = scene.device, scene.primitives(), Bins.make()
        tables, count = bins.upload(device), primitives.count
        turns = device.upload(np.arange(count, dtype=np.int32))
        forms, items = choose_strategies(device, primitives, SCALE, SLANTED, turns, tables)
        ranks, totals = rank_by_class_twin(items.get()[:count].reshape(-1), bins.count)
        regions, used = lay_out(device, tables, device.upload(totals.astype(np.int32)), 4096)
        listed = Items(turns, items, device.upload(ranks.astype(np.int32)))
        places = place_items(device, count, used, listed, tables, regions)
        inverse = invert_depths(device, primitives.depths, primitives.pieces, primitives.rows, SCALE, STAGE)
        placed = Placed(primitives, forms, places, inverse)
        return cls(primitives, bins, tables, listed, totals, ranks, regions, used, placed)


@case(
    {"footprint.measure_triangles": Cost("n", "(4 + 12 + 36 + 20)*n", "160*n")},
    1 << 18,
    1 << 14,
    typical=Bound(130),  # a camera 1000 units from the origin, whose distances are differences of such numbers
    adversarial=Bound(4),
)
def footprints(device: Device, kind: str, size: int) -> Trial:
    """Compares the depths and pieces of all triangles."""
    scene = Scene.make(device, kind, size)
    camera = device.upload(scene.camera)

    def run() -> tuple[Array, Array]:
        return measure_triangles(device, scene.ids, size, scene.triangles, camera, SCALE, SLANTED, STAGE)

    def results() -> list[Result]:
        expected = measure_triangles_twin(scene.corners, scene.camera, SCALE, SLANTED)
        return [Result(array.get()[:size], values) for array, values in zip(run(), expected, strict=True)]

    return Trial({"n": size}, run, results)


PRIMITIVES = {
    "primitives.count_pieces": Cost("t", "8*t"),
    "primitives.list_pieces": Cost("t", "8*t + 4*n"),
    "primitives.measure_primitives": Cost("n", "(4 + 24 + 48 + 20)*n", "150*n"),
}


# Slivers: their height is an area that cancels over a length; longest edges of equal length may differ.
@case(PRIMITIVES, 1 << 15, 1 << 12, typical=Bound(25_000), adversarial=Bound(13_000, wrong=3e-3))
def primitives(device: Device, kind: str, size: int) -> Trial:
    """Compares level, base, height and first corner of all primitives."""
    scene = Scene.make(device, kind, size)

    def results() -> list[Result]:
        found = scene.primitives()
        parents, starts, pieces = (array.get() for array in (found.parents, found.starts, found.pieces))
        parents = parents[: found.count]
        inverse = invert_depths_twin(found.depths.get()[:size], pieces[:size], 1.0)[parents]
        index = np.arange(found.count) - starts[parents]
        expected = measure_primitives_twin(scene.corners[parents], pieces[parents], index, inverse, scene.camera)
        shapes = np.stack([expected[name] for name in ("level", "base", "height")], axis=1)
        return [
            Result(found.shapes.get()[: found.count, :3], shapes),
            Result(found.firsts.get()[: found.count], expected["first"]),
        ]

    return Trial({"t": size, "n": scene.primitives().count}, scene.primitives, results)


@case({"perspective.invert_depths": Cost("n", "36*n", "12*n")}, 1 << 18, adversarial=Bound(2))
def perspective(device: Device, kind: str, size: int) -> Trial:
    """Compares the inverse depths of all triangles' corners."""
    primitives = Scene.make(device, kind, size).primitives()

    def run() -> Array:
        return invert_depths(device, primitives.depths, primitives.pieces, size, SCALE, STAGE)

    def results() -> list[Result]:
        expected = invert_depths_twin(primitives.depths.get()[:size], primitives.pieces.get()[:size], SCALE)
        return [Result(run().get()[:size, :3], expected)]

    return Trial({"n": size}, run, results)


@case({"forms.choose_strategies": Cost("n", "(16 + 4 + 4 + 4 + 16 + 8)*n", "20*n")}, 1 << 14)
def forms(device: Device, kind: str, size: int) -> Trial:
    """Compares the form and the bins of each primitive."""
    primitives, bins = Scene.make(device, kind, size).primitives(), Bins.make()
    count, tables = primitives.count, bins.upload(device)
    turns = device.upload(np.arange(count, dtype=np.int32))

    def run() -> tuple[Array, Array]:
        return choose_strategies(device, primitives, SCALE, SLANTED, turns, tables)

    def results() -> list[Result]:
        cut = primitives.pieces.get()[primitives.parents.get()[:count]] > 1
        expected = choose_strategies_twin(primitives.shapes.get()[:count], cut, SCALE, SLANTED, bins)
        return [Result(array.get()[:count], values) for array, values in zip(run(), expected, strict=True)]

    return Trial({"n": count}, run, results)


@case({"layout.lay_out": Cost("b", "36*b"), "layout.place_items": Cost("2*n", "(8 + 8 + 32 + 4)*2*n")}, 1 << 14, 1 << 9)
def layout(device: Device, kind: str, size: int) -> Trial:
    """Compares the regions of all bins and the places of all items."""
    packed = Packed.make(Scene.make(device, kind, size))
    totals, count = device.upload(packed.totals.astype(np.int32)), packed.primitives.count

    def run() -> tuple[Array, Array]:
        regions, used = lay_out(device, packed.tables, totals, 4096)
        return regions, place_items(device, count, used, packed.items, packed.tables, regions)

    def results() -> list[Result]:
        regions, places = run()
        expected, used = lay_out_twin(packed.bins, packed.totals, 4096)
        items = packed.items.bins.get()[:count].reshape(-1)
        sizes = (packed.bins.width, packed.bins.height)
        at = place_items_twin(items, packed.ranks, *sizes, expected, used).reshape(-1, 2)
        return [Result(regions.get(), expected), Result(places.get()[:count], at)]

    return Trial({"n": count, "b": packed.bins.count}, run, results)


@case(
    {"emit.count_samples": Cost("p", "24*p"), "emit.emit_samples": Cost("n", "20*n", "40*n")},
    1 << 12,
    1 << 7,
    typical=Bound(6),
)
def emission(device: Device, kind: str, size: int) -> Trial:
    """Compares every field of all samples, and their number."""
    scene = Scene.make(device, kind, size)
    packed, table = Packed.make(scene), CellTable.upload(device)
    primitives = packed.primitives

    def run() -> Samples:
        return emit_samples(device, packed.placed, scene.triangles, table, 4096)

    def results() -> list[Result]:
        samples, expected = run(), samples_twin(scene, packed)
        found = [Result(getattr(samples, name).get()[: samples.count], values) for name, values in expected.items()]
        everything = count_samples(device, primitives.count, packed.placed.forms, table)
        return [*found, Result(np.array([everything]), np.array([len(expected["texel"])]))]

    return Trial({"p": primitives.count, "n": run().count}, run, results)


def samples_twin(scene: Scene, packed: Packed) -> dict[str, arrays.Array]:
    """All samples, primitive by primitive, as from `emit_primitive_twin`."""
    known, placed = packed.primitives, packed.placed
    parents, starts, pieces, firsts = (a.get() for a in (known.parents, known.starts, known.pieces, known.firsts))
    forms, places, inverse = placed.forms.get(), placed.places.get(), placed.inverse.get()[:, :3].astype(np.float64)
    parts = []
    for i in range(known.count):
        row = parents[i]
        decided = ((int(pieces[row]), int(i - starts[row])), int(firsts[i]), forms[i], places[i], 4096)
        parts.append(emit_primitive_twin(int(row), scene.corners[row], inverse[row], *decided))
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


@case({"locate.locate": Cost("n", "(12 + 16 + 8 + 16 + 8)*n", "60*n")}, 1 << 18, 1 << 14, typical=Bound(2))
def location(device: Device, kind: str, size: int) -> Trial:
    """At cuts rounding decides between copies far apart; the rest is compared."""
    packed, rng = Packed.make(Scene.make(device, kind, 500)), seeded(kind)
    known, placed = packed.primitives, packed.placed
    forms, places, firsts = (a.get()[: known.count] for a in (placed.forms, placed.places, known.firsts))
    halves = forms[:, 0] < 0
    shape = forms[:, 2] | forms[:, 3] << 10 | forms[:, 1] << 20
    two = np.stack([-1 - firsts, places[:, 0], places[:, 1], shape], axis=1)
    one = np.stack([forms[:, 0], places[:, 0], 0 * shape, 0 * shape], axis=1)
    records = np.where(halves[:, None], two, one).astype(np.int32)
    records[::50] = UNPLACED
    triangle = np.sort(rng.integers(0, known.rows, size)).astype(np.int32)
    bary = rng.dirichlet([1, 1, 1], size)[:, 1:].astype(np.float32)
    samples = Samples.upload(device, triangle, bary[:, 0], bary[:, 1], np.zeros(size), np.arange(size))
    located = Located(placed.inverse, known.pieces, known.starts, device.upload(records))

    def run() -> Array:
        return locate(device, samples, located, STAGE)

    def results() -> list[Result]:
        found = run().get()[:, :size].T
        inverse, pieces, starts = placed.inverse.get()[:, :3], known.pieces.get(), known.starts.get()
        place = locate_twin(bary, inverse[triangle], pieces[triangle], starts[triangle], records)
        same = np.isfinite(place[:, 0]) & ~(np.abs(found - place).max(axis=1) > 1)
        return [Result(found[same], place[same]), Result(np.isnan(found), np.isnan(place))]

    return Trial({"n": size}, run, results)
