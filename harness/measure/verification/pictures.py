"""What a client says that it shows, against what can be seen there."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Bools, Floats, Ints
from shading_atlas_bench.harness.measure.exact import DEPTH
from shading_atlas_bench.harness.measure.novel_view import Seen
from shading_atlas_bench.harness.measure.validity import Violation, Whole
from shading_atlas_bench.harness.measure.verification.truth import Truth, violation
from shading_atlas_bench.kernels.raster.camera import SUBPIXELS, Camera
from shading_atlas_bench.packers.interface import Frame, Image, Payload

MARGIN = 1.0  # pixels outside its triangle at which a pixel is not that triangle's
BOGUS = 0.005  # share of pixels that may show what cannot be there: slivers, and clipped triangles
OTHER = 0.05  # share that may show another surface than the reference does: where opacity rounds to nothing
POINTS, FEW = 4096, 512  # pixels whose depth is examined, and of which a picture must have more to be judged
APART, FAR = 0.05, 0.75  # share of the distance; share of the pixels that may be off by more: near things come in view


@dataclass(frozen=True)
class Shown:
    """What a client says that it shows, on the host: triangle int32 (h, w) and depth float32 (h, w), as in Image."""

    triangle: Ints | None
    depth: Floats | None

    @classmethod
    def of(cls, image: Image) -> Shown:
        """Of an image, which the client may draw over later."""
        return cls(*(None if part is None else part.get() for part in (image.triangle, image.depth)))


def check_picture(
    truth: Truth, frame: Frame, draw: str, payload: Payload, novel: Seen, shown: Shown
) -> tuple[float, list[Violation]]:
    """The share of pixels that are holes, and what is wrong with what the client says.

    A hole is a pixel where the reference shows a surface, and the client nothing, or something that is not there.
    draw: names the random numbers that choose pixels.
    """
    known = np.zeros(truth.triangles.count + 1, bool)  # the last entry stands for no triangle
    known[frame.pvs] = True
    known[list(payload.unplaced)] = False
    if shown.triangle is not None:
        return _check_ids(truth, novel, shown.triangle, known)
    assert shown.depth is not None, "harness/measure/returned.py lets in no image that has neither"
    holes = (novel.visibility >= 0) & ~(shown.depth > 0)
    return float(holes.mean()), list(_check_depth(truth, frame, draw, novel, shown.depth, known))


def _check_ids(truth: Truth, novel: Seen, ids: Ints, known: Bools) -> tuple[float, list[Violation]]:
    count, reference = truth.triangles.count, novel.visibility
    strange = (ids < -1) | (ids >= count)
    ids = np.where(strange, -1, ids)
    drawn = ids >= 0
    differs = np.flatnonzero((ids != reference) & drawn)
    bogus = np.zeros(ids.size, bool)
    claimed = ids.ravel()[differs]
    bogus[differs] = ~_can_be_seen(truth, novel, claimed, differs) | ~known[claimed]
    bogus |= strange.ravel()
    found = []
    if (wrong := np.flatnonzero(bogus)).size > BOGUS * ids.size:
        sentence = f"In {wrong.size} of {ids.size} pixels the client claims a triangle that is not there, or not sent."
        found.append(violation("pictures", wrong.size, sentence, ids.ravel()[wrong], wrong))
    other = differs[~bogus[differs] & known[reference.ravel()[differs]]]
    if other.size > OTHER * ids.size:
        sentence = f"In {other.size} of {ids.size} pixels the client shows another triangle than the reference."
        found.append(violation("pictures", other.size, sentence, ids.ravel()[other], other))
    holes = (reference >= 0) & (~drawn | bogus.reshape(ids.shape))
    return float(holes.mean()), found


def _can_be_seen(truth: Truth, novel: Seen, triangle: Ints, pixel: Whole) -> Bools:
    """Whether triangles (n) come within MARGIN of the centres of pixels (n): bool (n)."""
    view, triangles = novel.view, truth.triangles
    camera = Camera.of(view.view, view.projection, view.width, view.height)
    x, y, _, w = np.moveaxis(camera.project(triangles.host_positions[triangles.host_indices[triangle]]), -1, 0)
    corners = np.stack([x / SUBPIXELS + w * view.width / 2, y / SUBPIXELS + w * view.height / 2, w], axis=-1)
    edges = np.cross(np.roll(corners, -1, axis=1), np.roll(corners, -2, axis=1))
    volume = (edges[:, 0] * corners[:, 0]).sum(axis=1)
    edges *= np.sign(volume)[:, None, None]
    at = np.stack([pixel % view.width + 0.5, pixel // view.width + 0.5, np.ones(len(pixel))], axis=1)
    with np.errstate(all="ignore"):
        margins = (edges * at[:, None]).sum(axis=2) / np.sqrt(
            edges[..., 0] * edges[..., 0] + edges[..., 1] * edges[..., 1]
        )
    seen: Bools = np.all(margins >= -MARGIN - DEPTH, axis=1)
    return seen


def _check_depth(
    truth: Truth, frame: Frame, draw: str, novel: Seen, depth: Floats, known: Bools
) -> Iterator[Violation]:
    """Depths that a client claims, at some pixels of surfaces that it was sent."""
    places = np.flatnonzero(known[novel.triangle])
    if not places.size:
        return
    places = places[truth.generator(frame.index, draw).integers(0, places.size, min(POINTS, places.size))]
    triangles = truth.triangles
    corners = triangles.host_positions[triangles.host_indices[novel.triangle[places]]].astype(np.float64)
    b1, b2 = novel.bary[places].T.astype(np.float64)
    points = corners * np.stack([1 - b1 - b2, b1, b2], axis=1)[..., None]
    forward = novel.view.view[2]
    distance = -((points.sum(axis=1) * forward[:3]).sum(axis=1) + forward[3])
    claimed = depth.ravel()[novel.pixel[places]].astype(np.float64)
    drawn = claimed > 0
    with np.errstate(all="ignore"):
        off = np.abs(novel.view.projection[2, 3] / claimed - distance) > APART * distance
    wrong = int(np.count_nonzero(off & drawn))
    if wrong > max(FEW, FAR * np.count_nonzero(drawn)):
        sentence = f"In {wrong} of {len(places)} pixels the client claims another distance than its surface has."
        yield violation("pictures", wrong, sentence)
