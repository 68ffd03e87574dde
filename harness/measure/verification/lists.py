"""Fragment lists against the scene: what every pixel's nearest fragment is, and all that some rays meet.

What lists hold (`Packer.holds`) says which rules can be true of them:

every     At some pixels they hold what a float64 ray meets: nothing is missing, nothing is added, and depth, colour and
          opacity are right. In all pixels the nearest fragment is the rasteriser's nearest surface.
nearest   The same, but a list may end early.
alike     Lists may be old where they blend to the same colour: at some pixels it is that of the true list, within
          ALIKE levels.
moved     Fragments may come from other views: most of those that a ray meets are there, within FAR of their distance
          and DRIFTED levels.
blended   One fragment stands for several: the nearest is the rasteriser's, and at some pixels it has the
          true list's colour.

With lists of several parts, each of which may blend its own, rules on blended colours hold where a ray meets one
surface. With lists of several views, each ray of the cell's frustum is in the picture of the view that it belongs to,
and in other views it has no fragments.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from shading_atlas_bench.arithmetic import arrays
from shading_atlas_bench.arithmetic.arrays import Bools, Bytes, Doubles
from shading_atlas_bench.arithmetic.matrices import product
from shading_atlas_bench.harness.measure.validity import Violation, Whole
from shading_atlas_bench.harness.measure.verification.rays import Hits, cast_rays
from shading_atlas_bench.harness.measure.verification.truth import CHOSEN, LEVELS, Truth, violation
from shading_atlas_bench.kernels.validity.lists import (
    Surfaces,
    WalkedLists,
    compare_nearest,
    compare_nearest_twin,
    walk_lists,
)
from shading_atlas_bench.packers.cell_views import owned_pixels, owners
from shading_atlas_bench.packers.interface import ALIKE, Frame, HeldLists, Payload, View

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device

Number = TypeVar("Number", bound=np.generic)

HEADER, COLOUR, NORMAL = 4, 12, 24  # bytes: of a pixel, of a fragment, of one with a normal and a position
NEAREST = 0.01  # share of pixels whose nearest fragment may be another: sets and rounding explain some
SAME_DEPTH = 1e-4  # relative
SAME_EYE = 1e-12  # relative; float64 views turned in any way differ by about 1e-15
FEW = 3  # of the chosen pixels, where lists may differ: what rounding does to masks and slivers
STRAY = 0.01  # share of moved fragments that may be of other views' rays: the published merge misses some
FAR, DRIFTED = 0.1, 64 + LEVELS  # of moved fragments: share of the distance, levels
LOST = 0.25  # share of surfaces that moved fragments may lack: those that have just come into view
OPACITY = 3  # levels


def walk(device: Device, held: tuple[HeldLists, ...]) -> list[WalkedLists | None]:
    """What a kernel says of each part; None of one whose lists are not all its fragments."""
    return [
        walk_lists(device, part.offsets, part.rgba, part.depth, "check") if _is_whole(part) else None for part in held
    ]


def _is_whole(part: HeldLists) -> bool:
    pixels, count, offsets = part.view.width * part.view.height, len(part.depth), part.offsets
    return bool(len(offsets) == pixels + 1 and offsets[0] == 0 and offsets[-1] == count == len(part.rgba))


def check_structure(held: tuple[HeldLists, ...], walked: list[WalkedLists | None]) -> Iterator[Violation]:
    """That each fragment is in one list, and each pixel's nearest comes first. walked: see `walk`."""
    for number, (part, of) in enumerate(zip(held, walked, strict=True)):
        if of and not of.broken:
            continue
        pixels, offsets = part.view.width * part.view.height, part.offsets
        if not of or (np.diff(offsets) < 0).any():
            yield violation("once", 1, f"Lists of part {number}: they overlap, or gap, or lack fragments.")
            continue
        pixel = np.repeat(np.arange(pixels, dtype=np.int32), np.diff(offsets))
        seen = part.rgba[:, 3] > 0
        depth, pixel = (part.depth, pixel) if seen.all() else (part.depth[seen], pixel[seen])
        if not (np.isfinite(depth) & (depth > 0)).all():
            yield violation("sorted", 1, f"Lists of part {number}: fragments have no depth.")
        wrong = np.flatnonzero((depth[1:] > depth[:-1]) & (pixel[1:] == pixel[:-1]))
        if wrong.size:
            sentence = f"Lists of part {number}: {wrong.size} fragments lie before one that is nearer."
            yield violation("sorted", wrong.size, sentence, texels=pixel[1:][wrong])


def count_fragments(held: tuple[HeldLists, ...]) -> int:
    """Those that are there."""
    return sum(int(np.count_nonzero(part.rgba[:, 3])) for part in held)


def check_bytes(
    payload: Payload, held: tuple[HeldLists, ...], fragments: int, before: int, holds: str
) -> Iterator[Violation]:
    """The uncompressed size, and what it may be.

    fragments: that the client holds, see `count_fragments`; before: that it held before this payload.
    """
    size = sum(len(data) for data in payload.lists.values())
    if payload.raw_bytes != size:
        sentence = f"The payload claims {payload.raw_bytes} uncompressed bytes of lists and has {size}."
        yield violation("raw bytes", abs(payload.raw_bytes - size), sentence)
    each = NORMAL if any(part.normals for part in held) else COLOUR
    pixels = sum(part.view.width * part.view.height for part in held)
    if holds in ("alike", "moved"):
        fragments += before + pixels  # what is removed is sent as a fragment, too
    if size > HEADER * pixels + each * fragments:
        sentence = (
            f"The lists have {size} bytes, more than {pixels} pixels and {fragments} fragments of {each} bytes need."
        )
        yield violation("raw bytes", size - HEADER * pixels - each * fragments, sentence)


@dataclass(frozen=True)
class ListView:
    """A view's lists: its parts, by their numbers too, and which pixels' rays belong to it. owned: bool (pixels)."""

    view: View
    parts: tuple[HeldLists, ...]
    numbers: tuple[int, ...]
    owned: Bools


def list_views(held: tuple[HeldLists, ...]) -> list[ListView]:
    """The parts by the views that they are of, in the order of these."""
    numbers: dict[bytes, list[int]] = {}
    for number, part in enumerate(held):
        size = np.array([part.view.width, part.view.height], np.float64)
        numbers.setdefault(part.view.view.tobytes() + part.view.projection.tobytes() + size.tobytes(), []).append(
            number
        )
    views = [held[some[0]].view for some in numbers.values()]
    owned = [owned_pixels(views, number).ravel() for number in range(len(views))]
    return [
        ListView(view, tuple(held[number] for number in some), tuple(some), own)
        for view, some, own in zip(views, numbers.values(), owned, strict=True)
    ]


def check_fragments(
    truth: Truth, frame: Frame, method: str, holds: str, held: tuple[HeldLists, ...], walked: list[WalkedLists]
) -> Iterator[Violation]:
    """The rules for what such lists hold. walked: see `walk`."""
    views, eye = list_views(held), held[0].view.eye
    if not all(is_at(of.view, frame.server.eye) for of in views):
        yield violation("fragments", 1, "The lists are seen from another eye than the frame's server view.")
        return
    yield from _check_views(truth, frame, method, holds, views)
    if holds in ("every", "nearest", "blended"):
        yield from _check_nearest(truth, frame, views, walked)
    number, pixel = _chosen(truth, frame, method, views)
    hits = _cast(truth, frame, views, number, pixel)
    lists = [_at(views[of].parts, at) for of, at in zip(number, pixel, strict=True)]
    if holds in ("every", "nearest"):
        yield from _check_exactly(truth, hits, lists, pixel, eye, holds == "nearest")
        return
    colours = truth.shade(hits, eye)
    if holds == "moved":
        yield from _check_moved(hits, colours, lists)
    else:
        in_parts = len(held) > len(views)
        yield from _check_blends(hits, colours, lists, pixel, in_parts, ALIKE if holds == "alike" else 0)


def is_at(view: View, eye: Doubles) -> bool:
    """Whether a view is seen from an eye, float64 (3), up to the rounding of its matrix: that is relative to how far
    the eye is from the origin, whichever of its coordinates are near 0."""
    return bool(np.abs(view.eye - eye).max() <= SAME_EYE * np.abs(eye).max())


def _check_views(truth: Truth, frame: Frame, method: str, holds: str, views: list[ListView]) -> Iterator[Violation]:
    """That views cover the cell's frustum, and that each ray has fragments in one of them only."""
    x, y = truth.generator(frame.index, f"rays of {method}").random((2, CHOSEN)) * 2 - 1
    x[:4], y[:4] = (-1, -1, 1, 1), (-1, 1, -1, 1)  # the corners
    (scale_x, scale_y), (shift_x, shift_y) = frame.server.projection[[0, 1], [0, 1]], frame.server.projection[:2, 2]
    rays = np.stack([(x + shift_x) / scale_x, (y + shift_y) / scale_y, -np.ones(CHOSEN)], axis=1)
    rays = product(rays, frame.server.view[:3, :3])
    owner = owners([of.view for of in views], rays)
    inside = np.stack([_is_in_picture(of.view, rays) for of in views])[owner, np.arange(CHOSEN)]
    if outside := int(np.count_nonzero(~inside)):
        sentence = f"{outside} of {CHOSEN} rays of the cell's frustum are in no picture of lists."
        yield violation("fragments", outside, sentence)
    if len(views) == 1:
        return
    stray, count = 0, count_fragments(tuple(part for of in views for part in of.parts))
    for of in views:
        for part in of.parts:
            pixel = np.repeat(np.arange(len(of.owned)), np.diff(part.offsets))
            stray += int(np.count_nonzero((part.rgba[:, 3] > 0) & ~of.owned[pixel]))
    if stray > (STRAY * count if holds == "moved" else 0):
        sentence = f"{stray} of {count} fragments lie on rays that belong to another view than theirs."
        yield violation("once", stray, sentence)


def _is_in_picture(view: View, rays: Doubles) -> Bools:
    """(n), of rays (n, 3) in scene axes."""
    x, y, _, w = product(rays, product(view.projection[:, :3], view.view[:3, :3]).T).T
    inside: Bools = (w > 0) & (np.maximum(np.abs(x), np.abs(y)) <= w * (1 + 1e-9))
    return inside


def _chosen(truth: Truth, frame: Frame, method: str, views: list[ListView]) -> tuple[Whole, Whole]:
    """Some pixels whose rays belong to their views: int (CHOSEN) each, the view's number and the pixel."""
    places = [np.flatnonzero(of.owned) for of in views]
    ends = np.cumsum([len(of) for of in places])
    at = truth.generator(frame.index, method).integers(0, int(ends[-1]), CHOSEN)
    number = np.searchsorted(ends, at, side="right")
    return number, np.array([places[of][place - ends[of]] for of, place in zip(number, at, strict=True)])


def _cast(truth: Truth, frame: Frame, views: list[ListView], number: Whole, pixel: Whole) -> Hits:
    """What the rays through pixels of views meet; a ray's number is that of its pixel among them."""
    found = []
    for at in np.unique(number):
        view, some = views[at].view, np.flatnonzero(number == at)
        hits = cast_rays(truth, view, frame.pvs, pixel[some] % view.width, pixel[some] // view.width)
        found.append(replace(hits, ray=some[hits.ray]))
    return Hits(*(np.concatenate([getattr(hits, field.name) for hits in found]) for field in fields(Hits)))


@dataclass(frozen=True)
class List:
    """One pixel's visible fragments of all parts, nearest first: rgba uint8 (n, 4), depth float64 (n)."""

    rgba: Bytes
    depth: Doubles


def _at(parts: tuple[HeldLists, ...], pixel: int) -> List:
    spans = [slice(part.offsets[pixel], part.offsets[pixel + 1]) for part in parts]
    rgba = np.concatenate([part.rgba[span] for part, span in zip(parts, spans, strict=True)])
    depth = np.concatenate([part.depth[span] for part, span in zip(parts, spans, strict=True)]).astype(np.float64)
    seen = np.flatnonzero(rgba[:, 3] > 0)
    order = seen[np.argsort(-depth[seen], kind="stable")]
    return List(rgba[order], depth[order])


def _check_nearest(truth: Truth, frame: Frame, views: list[ListView], walked: list[WalkedLists]) -> Iterator[Violation]:
    """The nearest fragment of every pixel against the nearest surface that is not wholly transparent."""
    device, known = truth.scene.device, np.zeros(truth.triangles.count, bool)
    known[frame.pvs] = True
    count, found = 0, []
    for of in views:
        with truth.drawing:
            surfaces = _nearest_surfaces(truth, of.view)
        nearest = _nearest_of(device, [walked[number] for number in of.numbers])
        count += compare_nearest(device, surfaces, known, of.owned, nearest, SAME_DEPTH, "check")
        found.append((surfaces, nearest))
    pixels = sum(np.count_nonzero(of.owned) for of in views)
    if count > NEAREST * pixels:
        sentence = f"In {count} of {pixels} pixels the nearest fragment is not the nearest surface of the set."
        wrong = []
        for of, (surfaces, nearest) in zip(views, found, strict=True):
            depth, ids = surfaces.depth.get().ravel(), surfaces.triangle.get().ravel()
            off = compare_nearest_twin(depth, ids, known, of.owned, nearest.get(), SAME_DEPTH)
            wrong.append(np.flatnonzero(off))
        yield violation("fragments", count, sentence, texels=np.concatenate(wrong))


def _nearest_of(device: Device, parts: list[WalkedLists]) -> Array:
    """Of each pixel's nearest fragments in several parts the nearest, float32 (pixels)."""
    if len(parts) == 1:
        return parts[0].nearest
    return device.upload(np.max([part.nearest.get() for part in parts], axis=0))


def _nearest_surfaces(truth: Truth, view: View) -> Surfaces:
    """What a view shows, 0 and -1 where there is nothing."""
    scene = truth.scene
    if scene.layers is None:
        visible = scene.rasteriser.draw(view.view, view.projection, view.width, view.height, stage="check")
        return Surfaces(visible.depth, visible.triangle)
    visible, fragments = scene.layers.rasteriser.draw(
        view.view, view.projection, view.width, view.height, stage="check"
    )
    depth, ids = visible.depth.get().ravel(), visible.triangle.get().ravel()
    n = fragments.count
    opacity = scene.layers.opacity.of(fragments.samples, "check").get()[:n]
    nearer = _first_visible(fragments.offsets.get(), opacity, fragments.depth.get()[:n])
    covered = _first_visible(fragments.offsets.get(), opacity, fragments.samples.triangle.get()[:n] + 1)
    found = np.where(nearer > 0, nearer, depth), np.where(nearer > 0, covered - 1, ids)
    return Surfaces(*(scene.device.upload(values) for values in found))


def _first_visible(offsets: Whole, opacity: arrays.Array, depth: NDArray[Number]) -> NDArray[Number]:
    """Of each pixel's first fragment that has any opacity, its entry in `depth` (n), or 0: (pixels)."""
    if not opacity.all():
        seen = np.flatnonzero(opacity)
        offsets, depth = np.searchsorted(seen, offsets), depth[seen]
    if not len(depth):
        return np.zeros(len(offsets) - 1, depth.dtype)
    first = depth[np.minimum(offsets[:-1], len(depth) - 1)]
    return np.where(offsets[:-1] < offsets[1:], first, first.dtype.type(0))


def _check_exactly(
    truth: Truth, hits: Hits, lists: list[List], pixel: Whole, eye: Doubles, may_end: bool
) -> Iterator[Violation]:
    """Each certain hit is one fragment, and each fragment one hit."""
    missing: list[int] = []
    added: list[int] = []
    pairs: list[tuple[int, int, list[int]]] = []
    for number, fragments in enumerate(lists):
        own = np.flatnonzero(hits.ray == number)
        free: list[int] = own.tolist()
        for at, depth in enumerate(fragments.depth):
            off = np.abs(hits.depth[free] - depth) - hits.reach[free] - SAME_DEPTH * depth
            if not free or not off.min() <= 0:
                added.append(number)
                continue
            fits = [free[k] for k in np.flatnonzero(off <= 0)]
            pairs.append((number, at, fits))
            free.remove(min(fits, key=lambda hit: abs(hits.depth[hit] - depth)))
        end = fragments.depth.min(initial=np.inf) if may_end else 0.0
        lost = [hit for hit in free if hits.certain[hit] and hits.depth[hit] > end * (1 + SAME_DEPTH)]
        empty = may_end and not len(fragments.depth) and hits.certain[own].any()
        missing += [number] * bool(lost or empty)
    coloured = _wrongly_coloured(truth, hits, lists, pairs, eye)
    for bad, what in ((missing, "lack"), (added, "hold, too, what is not"), (coloured, "colour or cover otherwise")):
        if (places := np.unique(bad).astype(int)).size > FEW:
            sentence = f"{places.size} of {CHOSEN} lists {what} among the fragments that a float64 ray meets."
            yield violation("colours" if bad is coloured else "fragments", places.size, sentence, texels=pixel[places])


def _wrongly_coloured(
    truth: Truth, hits: Hits, lists: list[List], pairs: list[tuple[int, int, list[int]]], eye: Doubles
) -> list[int]:
    """Numbers of lists with a fragment whose colour or opacity is that of none of the hits at its depth."""
    if not pairs:
        return []
    tried = [(which, hit) for which, (_, _, fits) in enumerate(pairs) for hit in fits]
    which, hit = np.array(tried).T
    rgba = np.array([lists[number].rgba[at] for number, at, _ in pairs])[which]
    met = hits.at(hit)
    low, high = met.opacity.T
    fine = truth.off(rgba[:, :3], met, eye) <= LEVELS
    fine &= (rgba[:, 3] >= low - OPACITY) & (rgba[:, 3] <= high + OPACITY)
    matched = np.bincount(which[fine], minlength=len(pairs)) > 0
    return [number for (number, _, _), good in zip(pairs, matched, strict=True) if not good]


def _check_moved(hits: Hits, colours: Bytes, lists: list[List]) -> Iterator[Violation]:
    """Most certain hits have a fragment about there that looks about so."""
    certain = np.flatnonzero(hits.certain)
    found = 0
    for hit in certain:
        fragments = lists[hits.ray[hit]]
        near = np.abs(fragments.depth - hits.depth[hit]) <= FAR * hits.depth[hit] + hits.reach[hit]
        alike = np.abs(fragments.rgba[:, :3].astype(int) - colours[hit]).max(axis=1, initial=0) <= DRIFTED
        found += bool((near & alike).any())
    if found < (1 - LOST) * len(certain) - FEW:
        sentence = f"{len(certain) - found} of {len(certain)} surfaces on rays are not among the moved fragments."
        yield violation("fragments", len(certain) - found, sentence)


def _check_blends(
    hits: Hits, colours: Bytes, lists: list[List], pixel: Whole, in_parts: bool, slack: int
) -> Iterator[Violation]:
    """Lists blend to the colour of what rays meet, where rounding decides neither that nor its order."""
    bad = []
    for number, fragments in enumerate(lists):
        own = np.flatnonzero(hits.ray == number)
        tied = -np.diff(hits.depth[own]) <= hits.reach[own][1:] + hits.reach[own][:-1]
        if tied.any() or not hits.certain[own].all() or (in_parts and len(own) > 1):
            continue
        expected = blended(colours[own], hits.opacity[own].mean(axis=1))
        found = blended(fragments.rgba[:, :3], fragments.rgba[:, 3])
        if np.abs(found - expected).max() > LEVELS + OPACITY + slack:
            bad.append(number)
    if len(bad) > FEW:
        sentence = f"{len(bad)} of {CHOSEN} lists blend to another colour than the fragments that a float64 ray meets."
        yield violation("colours", len(bad), sentence, texels=pixel[bad])


def blended(colours: arrays.Array, opacity: arrays.Array) -> Doubles:
    """float64 (4): colours (n, 3) of opacities (n), of 255, nearest first, over nothing; and what they let through."""
    through = np.cumprod(np.concatenate([[1.0], 1 - np.asarray(opacity, np.float64) / 255]))
    weights = through[:-1] * np.asarray(opacity) / 255
    return np.append((weights[:, None] * colours).sum(axis=0), 255 * through[-1])
