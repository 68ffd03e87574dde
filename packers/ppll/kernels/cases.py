"""Cases of per-pixel linked lists: a few layers of small triangles, and hundreds of layers and slivers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.kernels.case import Bound, Cost, Result, Trial, case, seeded
from shading_atlas_bench.kernels.fragments.cases import fragments_of, host, most_layers
from shading_atlas_bench.kernels.inputs.soups import look_at, perspective
from shading_atlas_bench.kernels.raster.cases import camera
from shading_atlas_bench.packers.interface import View
from shading_atlas_bench.packers.ppll.kernels.inputs import normal_lists, random_lists
from shading_atlas_bench.packers.ppll.kernels.limit import Depth, limit_fragments, limit_twin
from shading_atlas_bench.packers.ppll.kernels.lists import (
    Lists,
    ListView,
    changed_colours,
    changed_lists,
    changed_twin,
    count_deleted,
    cut_lists,
    cut_twin,
    deleted_twin,
    splice_lists,
    splice_twin,
)
from shading_atlas_bench.packers.ppll.kernels.match import (
    apply_differences,
    differences_twin,
    find_differences,
    merge_differences,
    merge_twin,
    move_lists,
    move_twin,
    turning,
)
from shading_atlas_bench.packers.ppll.kernels.rows import colour_rows, normal_rows, normals_twin, rows_twin
from shading_atlas_bench.packers.ppll.kernels.splat import draw_lists, draw_lists_twin
from shading_atlas_bench.packers.ppll.kernels.wire import LAYOUTS, write_lists, write_twin

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.kernels.fragments.build import Fragments


LIMITING = {
    "limit.count_kept": Cost("n", "4*n + 8*pixels"),
    "limit.list_kept": Cost("n", "4*n + 8*pixels + 4*kept"),
    "limit.copy_kept": Cost("kept", "52*kept"),
    "limit.pick": Cost("kept", "12*kept"),
}


@case(LIMITING, 480, 96)
def limiting(device: Device, kind: str, size: int) -> Trial:
    """Adversarial: opacities whose sum reaches the threshold within rounding."""
    _, fragments = fragments_of(device, kind, size)
    levels = [0, 51, 102, 127, 128] if kind == "adversarial" else [0, 1, 100, 128, 255]
    opacity = seeded(kind).choice(levels, fragments.count).astype(np.int32)
    uploaded, depth = device.upload(opacity), Depth(4, 0.8)
    spans = np.sort(seeded(kind).integers(0, size + 1, (fragments.height, 2)).astype(np.int32), axis=1)

    def run() -> tuple[Fragments, Array | None]:
        return limit_fragments(device, fragments, uploaded, depth, spans, "limit")

    def results() -> list[Result]:
        kept, left = run()
        expected = limit_twin(fragments.offsets.get(), opacity, depth, spans, fragments.width)
        found, wanted = np.zeros((2, fragments.pixels), np.int64)
        found[:] = np.diff(kept.offsets.get())
        np.add.at(wanted, host(fragments)[3][expected], 1)
        if left is None or kept.count != len(expected):
            return [Result(found, wanted)]
        return [Result(found, wanted), Result(left.get()[: kept.count], opacity[expected])]

    counts = {"n": fragments.count, "kept": run()[0].count, "pixels": fragments.pixels}
    return Trial(counts, run, results)


ROWS = {
    "rows.colour_rows": Cost("n", "16*n"),
    "rows.normal_rows": Cost("n", "(8 + 12 + 12 + 96 + 20)*n", "60*n"),
}


# Normals are two half floats: angles of up to pi, to 2^-10.
@case(ROWS, 480, 96, typical=Bound(33_000))
def rows(device: Device, kind: str, size: int) -> Trial:
    """Adversarial: normals at the poles, where the azimuth is free."""
    triangles, fragments = fragments_of(device, kind, size)
    n, rng, view = fragments.count, seeded(kind), camera(size)
    normals = rng.normal(size=triangles.host_positions.shape) * ([1e-4, 1e-4, 1] if kind == "adversarial" else 1)
    vertices = np.zeros((len(normals), 8), np.float32)
    vertices[:, 3:6] = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    colours = device.upload(rng.integers(0, 256, (1, n, 4)).astype(np.uint8))
    projection, uploaded = perspective(80, 16 / 9), device.upload(vertices)

    def run() -> tuple[Array, Array]:
        normal = normal_rows(device, fragments, colours, None, triangles, uploaded, projection, "rows")
        return normal, colour_rows(device, fragments, colours, None, "rows")

    def results() -> list[Result]:
        packed, coloured = (array.get()[:n] for array in run())
        depth, rgba = fragments.depth.get()[:n], colours.get().view(np.uint32).ravel()[:n]
        smooth_normals = vertices[:, 3:6]
        surface = (fragments.samples, depth, triangles, smooth_normals, projection, view.width, view.height)
        smooth, positions = rows_twin(*surface)
        return [
            Result(normals_twin(packed[:, 1].copy()), smooth),
            Result(packed[:, 2:].copy().view(np.float32), positions),
            Result(coloured, np.stack([rgba, depth.view(np.uint32)], axis=1)),
        ]

    return Trial({"n": n}, run, results)


SPLICING = {
    "lists.cut_lists": Cost("n", "16*n + 8*pixels"),
    "lists.count_deleted": Cost("n", "4*n"),
    "lists.count_spliced": Cost("pixels", "12*pixels"),
    "lists.splice_lists": Cost("n", "16*n + 12*pixels"),
    "lists.count_changed_colours": Cost("pixels", "16*pixels"),
    "lists.count_changed_lists": Cost("n", "16*n + 12*pixels"),
}


@case(SPLICING, 480, 96)
def splicing(device: Device, kind: str, size: int) -> Trial:
    """Lists of which a tenth changed, found, cut out and spliced in."""
    rng = seeded(kind)
    held = random_lists(device, rng, size, size * 2 // 3, most_layers(kind))
    offsets, rows = held.host()
    some = rng.random(len(rows)) < 0.1
    rows[some, 0] ^= rng.choice([1, 4, 1 << 20], some.sum()).astype(np.uint32)
    fresh = Lists.upload(device, held.width, held.height, offsets, rows)
    shown, now = (device.upload(rng.integers(0, 9, (held.pixels, 4), dtype=np.uint8)) for _ in range(2))

    def run() -> tuple[Lists, Lists]:
        changed_colours(device, fresh, shown, now, 3, "lists")
        changed = changed_lists(device, fresh, held, 3, 1e-4, "lists")
        count_deleted(device, changed, "lists")
        return changed, splice_lists(device, held, changed, "lists")

    def results() -> list[Result]:
        changed, spliced = run()
        differs = changed_twin(fresh.host(), held.host(), 3, 1e-4)
        counts = np.diff(fresh.host()[0]) * differs
        expected = cut_twin(fresh.host(), counts)
        cut = cut_lists(device, fresh, device.upload(np.append(counts, 0).astype(np.int32)), "lists")
        pairs = zip((*cut.host(), *spliced.host()), (*expected, *splice_twin(held.host(), expected)), strict=True)
        deleted = np.array(count_deleted(device, changed, "lists")), np.array(deleted_twin(changed.host()))
        return [Result(np.diff(changed.host()[0]) > 0, differs), Result(*deleted), *(Result(*pair) for pair in pairs)]

    return Trial({"n": held.count, "pixels": held.pixels}, run, results)


WRITING = {
    "wire.write_fragments": Cost("n", "32*n"),
    "wire.write_ends": Cost("pixels", "12*pixels"),
}


@case(WRITING, 480, 96)
def writing(device: Device, kind: str, size: int) -> Trial:
    """Two nodes' lists of colours, and of normals, in both layouts. Adversarial: long lists, and a node without any."""
    rng, shape = seeded(kind), (size, size * 2 // 3)
    nodes = {
        words: [random_lists(device, rng, *shape, most, words) for most in (most_layers(kind), 1 + (kind == "typical"))]
        for words in (2, 5)
    }

    wanted = [(lists, layout) for lists in nodes.values() for layout in LAYOUTS]

    def run() -> list[Array]:
        return [write_lists(device, lists, layout, "wire") for lists, layout in wanted]

    def results() -> list[Result]:
        expected = [b"".join(write_twin(*node.host(), layout) for node in lists) for lists, layout in wanted]
        return [Result(a.get(), np.frombuffer(b, np.uint32)) for a, b in zip(run(), expected, strict=True)]

    written = [node for lists, _ in wanted for node in lists]
    counts = {"n": sum(node.count for node in written), "pixels": sum(node.pixels for node in written)}
    return Trial(counts, run, results)


MATCHING = {
    "match.move_fragments": Cost("n", "32*n", "60*n"),
    "match.list_moved": Cost("n", "16*n"),
    "match.sort_moved": Cost("n", "48*n + 4*pixels", "30*n"),
    "match.find_differences": Cost("n", "44*n + 12*pixels"),
    "match.write_differences": Cost("n", "44*n + 12*pixels"),
    "match.remove_fragments": Cost("n", "41*n + 12*pixels"),
    "match.merge_fragments": Cost("n", "61*n + 12*pixels"),
    "match.apply_differences": Cost("n", "62*n + 12*pixels"),
}


@case(MATCHING, 480, 48, typical=Bound(2.5))
def matching(device: Device, kind: str, size: int) -> Trial:
    """Adversarial: long lists and a move that sends many fragments to pixels' borders."""
    rng, shape = seeded(kind), (size, size * 2 // 3)
    held, fresh = (normal_lists(device, rng, most_layers(kind), size=shape) for _ in range(2))
    turn = turning(np.eye(4), look_at((0.3, 0, 0.1), (0.2, 0.1, -4)))
    projection = perspective(80, 1.5)

    def run() -> tuple[Lists, Lists, Lists, Lists]:
        moved = move_lists(device, held, turn, projection, "match")
        changes = find_differences(device, moved, fresh, 0.03, 60, "match")
        merged = merge_differences(device, moved, changes, None, "match")
        return moved, changes, merged, apply_differences(device, moved, changes, fresh, "match")

    def results() -> list[Result]:
        moved, changes, merged, applied = run()
        _, _, distance = move_twin(held.host(), turn, projection, *shape)
        rows = moved.host()[1]
        expected = differences_twin(moved.host(), fresh.host(), 0.03, 60)
        whole = merge_twin(moved.host(), changes.host(), None)
        return [
            Result(rows[:, 4].copy().view(np.float32), distance[rows[:, 1]]),
            Result(np.diff(changes.host()[0]), np.array([len(entries) for entries in expected])),
            *(Result(*pair) for lists in (merged, applied) for pair in zip(lists.host(), whole, strict=True)),
        ]

    return Trial({"n": held.count, "pixels": held.pixels}, run, results)


SPLATTING = {
    "splat.place_points": Cost("n", "8*n + 28*n + 4*pixels", "40*n"),
    "splat.count_points": Cost("n", "16*n + 4*4*n"),
    "splat.list_points": Cost("n", "16*n + 8*4*n"),
    "splat.blend_points": Cost("4*n", "32*4*n + 12*pixels", "12*4*n"),
}


@case(SPLATTING, 480, 48, typical=Bound(2), adversarial=Bound(4, spared=5e-4, wrong=5e-4))
def splatting(device: Device, kind: str, size: int) -> Trial:
    """A point falls on about 4 pixels. Adversarial: long lists, moved until they spread."""
    rng, shape = seeded(kind), (size, size * 2 // 3)
    lists = [random_lists(device, rng, *shape, most_layers(kind))]
    shift = 0.3 if kind == "adversarial" else 0.05
    taken = [ListView(View(np.eye(4), perspective(80, 1.5), *shape), lists)]
    seen = View(look_at((shift, 0, 0), (shift, 0, -5)), perspective(60, 1.5), *shape)
    background = rng.integers(0, 256, (*shape[::-1], 4)).astype(np.uint8)
    uploaded, picture = device.upload(background), device.upload(background)
    depth = device.empty(shape[::-1], np.float32)

    def run() -> None:
        draw_lists(device, taken, seen, picture, depth, "splat")

    def results() -> list[Result]:
        picture.set(uploaded.get())
        run()
        expected, distances = draw_lists_twin(taken, seen, background)
        return [Result(picture.get()[..., :3], expected), Result(depth.get(), distances)]

    return Trial({"n": lists[0].count, "pixels": lists[0].pixels}, run, results)
