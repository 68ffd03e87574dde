"""One trial: a method on a few frames of one scene, and everything that can be wrong with what it made of them.

The conformance kit, the stress test and the fuzzing all consist of trials. Sets are given, not searched for, so that
what a trial finds is the method's own.
"""

from __future__ import annotations

import hashlib
import time
import traceback
from collections.abc import Callable, Iterable
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Bools, Bytes, Floats, Ints
from shading_atlas_bench.arithmetic.matrices import matvec
from shading_atlas_bench.harness.errors import plain, text_of
from shading_atlas_bench.harness.measure import validity
from shading_atlas_bench.harness.measure.exact import ExactPicture, draw_exact
from shading_atlas_bench.harness.measure.novel_view import Seen
from shading_atlas_bench.harness.measure.returned import (
    LONGEST_REASON,
    CheckedPacker,
    Received,
    read_launches,
    verdict_on,
)
from shading_atlas_bench.harness.measure.verification.frame import Verifier
from shading_atlas_bench.harness.measure.verification.isolation import check_isolation, decode_losslessly
from shading_atlas_bench.harness.measure.verification.pictures import Shown, check_picture
from shading_atlas_bench.harness.measure.verification.truth import LEVELS, Truth
from shading_atlas_bench.harness.workload.reference import ForwardRenderer
from shading_atlas_bench.harness.workload.upload import upload_scene
from shading_atlas_bench.harness.workload.views import (
    CellFrustum,
    Pose,
    ViewCell,
    client_view,
    from_rotation_vector,
    rotation,
)
from shading_atlas_bench.kernels.metrics.flip import Flip
from shading_atlas_bench.kernels.raster.resolve import resolve
from shading_atlas_bench.packers.interface import (
    Client,
    Frame,
    Image,
    Owners,
    Packer,
    Payload,
    ServerScene,
    View,
)
from shading_atlas_bench.scenes.model import Scene
from shading_atlas_bench.scenes.quaternions import multiply

if TYPE_CHECKING:
    from collections.abc import Iterator

    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.kernels.samples import Samples

WRONG = 0.002  # share of pixels that may show another surface than float64 does, where rounding does not explain it
HOLES = 0.002  # share of pixels that may be empty well inside what float64 shows, with every triangle placed
FIRST = 6  # triangles and texels named in a sentence
# What a trial can end as, best first. Only the first two are results.
GOOD = ("ok", "overflow")


@dataclass(frozen=True)
class TrialCase:
    """A scene and the frames to pack of it; lengths in scene units, angles in degrees.

    poses: the server's, a frame each. ahead: the client's, each inside its frame's cell; beside the server's if empty.
    near: distance of the near plane. sets: int32 (n), triangle ids of each frame, ascending; all if empty.
    exact: whether there is a float64 picture to compare with (not for masked or blended surfaces).
    """

    scene: Scene
    poses: tuple[Pose, ...]
    ahead: tuple[Pose, ...] = ()
    near: float = 0.02
    fov: float = 60.0
    cell: ViewCell = field(default_factory=ViewCell)
    size: tuple[int, int] = (160, 90)
    atlas: tuple[int, int] = (256, 256)
    sets: tuple[Ints, ...] = ()
    exact: bool = True


@dataclass(frozen=True)
class TrialResult:
    """What came out of a trial.

    status: one of STRESS_STATUSES. sentence: what is wrong, or what was left out; empty if nothing.
    error: mean FLIP of the last frame's client picture against float64 (or, without one, against the reference).
    wrong, holes: shares of pixels; None where they are not known. unplaced: triangles, of the last frame's set.
    pictures: name to uint8 (h, w, 3), of the frame that went wrong or the last.
    """

    status: str
    sentence: str = ""
    error: float | None = None
    wrong: float | None = None
    holes: float | None = None
    samples: int | None = None
    unplaced: int | None = None
    seconds: float = 0.0
    pictures: dict[str, Bytes] = field(default_factory=dict)

    @property
    def good(self) -> bool:
        """Whether it is a result: its status is one of GOOD."""
        return self.status in GOOD


class Stage:
    """Frames made ready to be packed, and for each the client's view and what it should show.

    exact: whether there is a float64 picture to compare with.
    """

    def __init__(self, server: ServerScene, frames: list[Frame], views: list[View], exact: bool) -> None:
        self.device, self.server, self.frames, self.views, self.exact = server.device, server, frames, views, exact
        self.forward = ForwardRenderer(server)

    @classmethod
    def of(cls, device: Device, case: TrialCase) -> Stage:
        """A case, with its scene uploaded. Raises what uploading raises."""
        server = upload_scene(device, case.scene)
        frustum = CellFrustum.around(case.cell, case.fov, *case.size)
        ahead = case.ahead or tuple(beside(pose, case.cell, case.fov) for pose in case.poses)
        everything = np.arange(case.scene.triangle_count, dtype=np.int32)
        views = [client_view(pose, case.fov, *case.size, case.near) for pose in ahead]
        frames = [
            Frame(
                index=index,
                scene=server,
                server=frustum.server_view(pose, case.near),
                cell_radius=case.cell.radius,
                cell_fov=case.cell.fov,
                pvs=(pvs := case.sets[index] if case.sets else everything),
                pvs_device=device.upload(pvs),
                predicted=(client_view(pose, case.fov, *case.size, case.near), views[index]),
                atlas_width=case.atlas[0],
                atlas_height=case.atlas[1],
                frusta=frustum.split(pose, case.near),
            )
            for index, pose in enumerate(case.poses)
        ]
        return cls(server, frames, views, case.exact)

    def shaded_by(self, packer: CheckedPacker) -> Stage:
        """The same frames of the scene as a method shades it."""
        server = packer.scene_shaded(self.server)
        if server is self.server:
            return self
        return Stage(server, [replace(frame, scene=server) for frame in self.frames], self.views, self.exact)

    @cached_property
    def last(self) -> ExactPicture | None:
        """The last frame's client view in float64, of the triangles in its set."""
        if not self.exact:
            return None
        return draw_exact(self.server, self.views[-1], self.frames[-1].server.eye)

    @cached_property
    def reference(self) -> Bytes:
        """uint8 (h, w, 3): what the last frame's client view should show; float64 where there is such a picture."""
        if self.last is not None:
            return self.last.rgb
        shown: Bytes = self.forward.draw(self.views[-1], self.frames[-1].server.eye)[0].rgb.get()[..., :3]
        return shown

    @cached_property
    def complete(self) -> bool:
        """Whether the last frame's set holds all triangles, so that its picture must have no holes."""
        return len(self.frames[-1].pvs) == self.server.triangles.count

    @cached_property
    def _flip(self) -> Flip:
        height, width = self.reference.shape[:2]
        flip = Flip(self.device, width, height)
        opaque = np.full((height, width, 1), 255, np.uint8)
        flip.reference(self.device.upload(np.concatenate([self.reference, opaque], axis=2)))
        return flip

    def error(self, rgb: Array) -> float:
        """Mean FLIP of a picture, uint8 (h, w, 4), on the device, against what the last frame should show."""
        self._flip.compare(rgb)
        return self._flip.mean()

    def seen(self, index: int) -> Seen:
        """What frame `index`'s client view sees."""
        view = self.views[index]
        _, visible = self.forward.draw(view, self.frames[index].server.eye)
        samples = resolve(self.device, self.server.triangles, visible, view.view, view.projection)
        return Seen.of(view, visible, samples)

    @cached_property
    def truth(self) -> Truth:
        """The scene in float64."""
        return Truth(self.server)


def beside(pose: Pose, cell: ViewCell, fov: float) -> Pose:
    """A client's pose that a cell allows: a third of its radius to the right, and turned by up to 2 degrees."""
    turn = np.radians(min(2.0, (cell.fov - fov) / 4))
    position = pose.position + matvec(rotation(pose.orientation), [cell.radius / 3, 0, 0])
    return Pose(position, multiply(pose.orientation, from_rotation_vector(np.array([0, turn, 0]))))


class TrialError(Exception):
    """A check did not hold: the status, a sentence, and the pictures that show it, as in TrialResult."""

    def __init__(self, status: str, sentence: str, pictures: dict[str, Bytes] | None = None) -> None:
        super().__init__(sentence)
        self.status, self.sentence, self.pictures = status, sentence, pictures or {}


def try_method(stage: Stage, make: Callable[[], Packer], *, again: int = 2) -> TrialResult:
    """Everything that can be checked of the packer that `make` makes, on all frames of a stage.

    again: how often to pack all frames again: 2 for once the same and once with other work-groups, 1 for the latter,
        0 for not at all.
    """
    return _caught(lambda: _tried(stage, make, again))


def try_isolation(stage: Stage, make: Callable[[], Packer]) -> TrialResult:
    """Whether clients know and show what they receive, and nothing else."""

    def isolated() -> TrialResult:
        packer = CheckedPacker(make())
        if reason := packer.skip(stage.server.host):
            return TrialResult("ok", f"skipped: {reason}")
        shaded = stage.shaded_by(packer)
        found = check_isolation(shaded.truth, make, shaded.frames[-1], shaded.views[-1])
        sentence = plain(" ".join(one.sentence for one in found), LONGEST_REASON)
        return TrialResult("invalid" if found else "ok", sentence)

    return _caught(isolated)


def _caught(work: Callable[[], TrialResult]) -> TrialResult:
    """What comes of it, with the time that it took; whatever is raised becomes a result."""
    start = time.perf_counter()
    try:
        found = work()
    except TrialError as wrong:
        found = TrialResult(wrong.status, plain(wrong.sentence, LONGEST_REASON), pictures=wrong.pictures)
    except BaseException as error:  # whatever a method does becomes a sentence
        found = result_of(error)
    return replace(found, seconds=time.perf_counter() - start)


def result_of(error: BaseException) -> TrialResult:
    """What a trial is in which this was raised. Raises it again if it is a stop."""
    status, sentence = verdict_on(error)
    return TrialResult("refused", text_of(error)) if refuses(error) else TrialResult(status, sentence)


def refuses(error: BaseException) -> bool:
    """Whether this is a ValueError that a `raise` of ours or of a packer's states, and no failed computation."""
    if not isinstance(error, ValueError):
        return False
    return (traceback.extract_tb(error.__traceback__)[-1].line or "").startswith("raise ")


def _tried(stage: Stage, make: Callable[[], Packer], again: int) -> TrialResult:
    packer = CheckedPacker(make())
    if reason := packer.skip(stage.server.host):
        return TrialResult("ok", f"skipped: {reason}")
    stage = stage.shaded_by(packer)
    packer.rare_costs()
    packer.prepare(stage.server)
    client, verifier = packer.client(stage.server.shipped), Verifier(stage.truth, packer)
    prints = []
    for index, frame in enumerate(stage.frames):
        with stage.device.record() as record:
            payload = packer.pack(frame)
        read_launches(record.launches, stage.server.skips.take())
        client.receive(decode_losslessly(payload))
        _check_frame(stage, index, verifier, payload, client, record.launches)
        prints.append(fingerprint(payload))
    # What only some runs ask for.
    packer.settled()
    packer.pictures(payload)
    packer.details(payload)
    usual = stage.device.local_size
    _check_steady(stage, make, prints, [usual, 16 if usual != 16 else 32][2 - again :] if again else [])
    return _judged(stage, payload, client)


def fingerprint(payload: Received) -> dict[str, str]:
    """A digest of each part that is sent, by its name."""
    parts: dict[str, bytes] = {f"the plane {name}": plane.get().tobytes() for name, plane in payload.planes.items()}
    parts |= {f"the blob {name}": blob for name, blob in payload.blobs.items()}
    parts |= {f"the lists {name}": blob for name, blob in payload.lists.items()}
    parts["the geometry"] = payload.geometry
    return {name: hashlib.sha256(part).hexdigest() for name, part in parts.items()}


def _check_frame(
    stage: Stage, index: int, verifier: Verifier, payload: Received, client: Client, stages: Iterable[str]
) -> None:
    """Raise TrialError where a frame breaks a rule; stages: launched by packing it."""
    frame, packer = stage.frames[index], verifier.packer
    owners = payload.owners()
    gaps = validity.Gaps() if packer.leaves_unwritten else None
    seen = stage.seen(index)
    places = client.locate(seen.triangle, seen.bary)
    visible = None if places is None else (seen.triangle, seen.bary, places)
    planes = {name: plane.get() for name, plane in payload.planes.items()}
    verified = verifier.verify(frame, payload, planes, owners, client, stages)
    found = verified.found
    found += validity.check(frame, payload, owners, client, visible, gaps=gaps)
    shown = Shown.of(client.draw(stage.views[index]))
    found += check_picture(stage.truth, frame, verified.draw, payload, seen, shown)[1]
    if found:
        sentence = " ".join(located(violation, payload) for violation in found)
        raise TrialError("invalid", f"Frame {index}: {sentence}", pictures_of(stage, index, payload, client))
    if owners is not None and payload.samples is not None:
        _check_colours(stage, index, payload, payload.samples, owners, client)


def located(violation: validity.Violation, payload: Payload) -> str:
    """A violation's sentence with the first triangles and texels it concerns."""
    places = []
    if violation.triangles:
        places.append("triangles " + ", ".join(str(t) for t in violation.triangles[:FIRST]))
    if violation.texels and payload.planes:
        width = next(iter(payload.planes.values())).shape[1]
        places.append("texels " + ", ".join(f"({t % width}, {t // width})" for t in violation.texels[:FIRST]))
    return violation.sentence + (f" First: {'; '.join(places)}." if places else "")


def _check_colours(
    stage: Stage, index: int, payload: Payload, samples: Samples, owners: Owners, client: Client
) -> None:
    """Every texel of the first plane holds what the shading function gives its sample."""
    plane = next(iter(payload.planes.values()))
    again = stage.device.zeros(plane.shape, np.uint8)
    frame = stage.frames[index]
    stage.server.shader.shade(samples, frame.server.eye, again, stage="trial/shade")
    off = np.abs(plane.get()[..., :3].astype(np.int16) - again.get()[..., :3]).max(axis=2).reshape(-1)
    bad = np.flatnonzero(off[owners.texel] > LEVELS)
    if bad.size:
        texels = ", ".join(
            f"({t % plane.shape[1]}, {t // plane.shape[1]}) of triangle {owner}"
            for t, owner in zip(owners.texel[bad[:FIRST]], owners.triangle[bad[:FIRST]], strict=True)
        )
        raise TrialError(
            "invalid",
            f"Frame {index}: {bad.size} texels differ by up to {off[owners.texel].max()} levels from what the shading "
            f"function gives their samples. First: texels {texels}.",
            pictures_of(stage, index, payload, client),
        )


def _check_steady(
    stage: Stage, make: Callable[[], Packer], prints: list[dict[str, str]], local_sizes: list[int]
) -> None:
    """Raise TrialError unless packing again, with work-groups of each of these sizes, gives the same bytes."""
    usual = stage.device.local_size
    for size in local_sizes:
        with work_groups(stage.device, size):
            packer = CheckedPacker(make())
            packer.prepare(stage.server)
            for index, frame in enumerate(stage.frames):
                found = fingerprint(packer.pack(frame))
                other = [name for name in prints[index] if found.get(name) != prints[index][name]]
                if other:
                    how = "packed a second time" if size == usual else f"packed with work-groups of {size}"
                    raise TrialError("nondeterministic", f"Frame {index}, {how}: other bytes in {', '.join(other)}.")


@contextmanager
def work_groups(device: Device, size: int) -> Iterator[None]:
    """Another work-group size for a while, as BENCH_LOCAL_SIZE sets it."""
    usual, device.local_size = device.local_size, size
    try:
        yield
    finally:
        device.local_size = usual


def _judged(stage: Stage, payload: Payload, client: Client) -> TrialResult:
    """The last frame's client picture against what it should show."""
    image = client.draw(stage.views[-1])
    unplaced = len(payload.unplaced)
    ids, drawn = _ids_and_coverage(image)
    error, wrong, holes = stage.error(image.rgb), None, None
    total = len(stage.frames[-1].pvs)
    if stage.last is not None and stage.complete and not unplaced:
        holes = float(stage.last.holes(drawn).mean())
        wrong = None if ids is None else float(stage.last.wrong(ids).mean())
    status, sentence = "ok", ""
    if unplaced:
        reasons = "; ".join(sorted(set(payload.unplaced.values())))
        status, sentence = "overflow", f"{unplaced} of {total} triangles unplaced: {reasons}."
    elif payload.planes and (wrong or 0) > WRONG:
        status, sentence = "inaccurate", f"{wrong:.2%} of the pixels show another surface than in float64."
    elif payload.planes and (holes or 0) > HOLES:
        status, sentence = "inaccurate", f"{holes:.2%} of the pixels are empty where float64 shows a surface."
    pictures = {} if status in GOOD else pictures_of(stage, len(stage.frames) - 1, payload, client)
    return TrialResult(status, sentence, error, wrong, holes, payload.sample_count, unplaced, pictures=pictures)


def _ids_and_coverage(image: Image) -> tuple[Ints | None, Bools]:
    """The triangle in each pixel, where a client knows ids, and where anything is drawn: (h, w)."""
    if image.triangle is not None:
        ids: Ints = image.triangle.get()
        return ids, ids >= 0
    assert image.depth is not None, "harness/measure/returned.py lets in no image that has neither"
    depth: Floats = image.depth.get()
    return None, depth > 0


def pictures_of(stage: Stage, index: int, payload: Payload, client: Client) -> dict[str, Bytes]:
    """What shows a failure, by name, uint8 (h, w, 3): what the client draws, what it should draw, and the atlas."""
    view, eye = stage.views[index], stage.frames[index].server.eye
    pictures = {"reference": stage.forward.draw(view, eye)[0].rgb.get()[..., :3]}
    try:
        pictures["client"] = client.draw(view).rgb.get()[..., :3]
    except BaseException as error:  # what it received may be what is wrong
        verdict_on(error)
        pictures["client"] = np.zeros_like(pictures["reference"])
    for name, plane in payload.planes.items():
        pictures[name] = np.ascontiguousarray(plane.get()[..., :3][:1024, :1024])
    return pictures


@dataclass(frozen=True)
class _Drawn:
    """A view's picture, uint8 (h, w, 4), on the device, its ids (h, w), and digests of both."""

    rgb: Array
    ids: Ints
    digests: tuple[str, str]

    @classmethod
    def forward(cls, stage: Stage, view: View, frame: Frame) -> _Drawn:
        image, visible = stage.forward.draw(view, frame.server.eye)
        ids = visible.triangle.get()
        of_rgb, of_ids = (hashlib.sha256(array.tobytes()).hexdigest() for array in (image.rgb.get(), ids))
        return cls(image.rgb, ids, (of_rgb, of_ids))


def try_rasteriser(stage: Stage) -> TrialResult:
    """The forward rendering of all frames' client views: the last against float64, all of them twice."""
    start = time.perf_counter()
    try:
        found = _rasterised(stage)
    except Exception as error:
        found = TrialResult(*verdict_on(error))
    return replace(found, seconds=time.perf_counter() - start)


def _rasterised(stage: Stage) -> TrialResult:
    drawn = [_Drawn.forward(stage, view, frame) for view, frame in zip(stage.views, stage.frames, strict=True)]
    usual = stage.device.local_size
    for size in (usual, 16 if usual != 16 else 32):
        with work_groups(stage.device, size):
            for index, (view, frame) in enumerate(zip(stage.views, stage.frames, strict=True)):
                if _Drawn.forward(stage, view, frame).digests != drawn[index].digests:
                    return TrialResult(
                        "nondeterministic", f"Frame {index}: another picture when drawn with work-groups of {size}."
                    )
    rgb, ids = drawn[-1].rgb, drawn[-1].ids
    error = stage.error(rgb)
    if stage.last is None:
        return TrialResult("ok", error=error)
    wrong = stage.last.wrong(ids)
    share = float(wrong.mean())
    holes = float(stage.last.holes(ids >= 0).mean())
    if share <= WRONG:
        return TrialResult("ok", error=error, wrong=share, holes=holes)
    row, column = np.argwhere(wrong)[0]
    sentence = (
        f"{share:.2%} of the pixels show another surface than in float64. First: column {column}, row {row}, with "
        f"triangle {ids[row, column]} for {stage.last.triangle[row, column]}."
    )
    shown = {"drawn": rgb.get()[..., :3], "float64": stage.last.rgb}
    return TrialResult("inaccurate", sentence, error, share, holes, pictures=shown)
