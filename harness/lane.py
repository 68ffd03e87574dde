"""One method on its way through the frames of a run: pack, encode, decode, draw, check, measure."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from statistics import median
from typing import Any

import numpy as np

from harness import validity
from harness.codecs import EncodedFrame, VideoStream, encode_all, pack_lz4, unpack_lz4
from harness.coherence import AtlasHistory
from harness.dump import owner_plane
from harness.frames import Work
from harness.machine import peak_memory
from harness.metrics import Metrics
from harness.novel_view import NovelView
from harness.plugins import variant_string
from harness.settings import Settings
from harness.verification.frame import Verified, Verifier
from harness.verification.isolation import check_isolation
from harness.verification.payload import statistics_of
from harness.verification.pictures import check_picture
from harness.verification.truth import Truth
from kernels.fill.fill import Filler
from kernels.metrics.stretch import stretch
from packers.interface import ALPHA, Client, Decoded, Frame, Image, Owners, Packer, Payload, ServerScene

Key = tuple[str, int | None]  # codec and CRF
QUALITIES = ("flip", "dssim", "iwssim", "psnr", "delta_e")


@dataclass
class Packed:
    """What packing one frame gave; times are device milliseconds by stage, `wall_ms` is the host's.

    repeats: every repetition's stages, where there is more than one; `stages` and `wall_ms` are then medians.
    skipped: what was left out of it.
    """

    payload: Payload
    stages: dict[str, float]
    launches: dict[str, int]
    wall_ms: float
    repeats: list[dict[str, float]] = field(default_factory=list)
    skipped: frozenset[str] = frozenset()

    def total(self, group: str = "") -> float:
        """Device milliseconds of all stages of a group ("structs" or "gather"); of all launches without one."""
        return sum(ms for name, ms in self.stages.items() if name.startswith(group and group + "/"))


@dataclass
class Sent:
    """What went over the wire: planes as packed, each (codec, CRF)'s encoded planes by name, and compressed bytes.

    lists_bytes: of a method without planes, which are then its video; raw_bytes: before compression.
    """

    planes: dict[str, np.ndarray]
    encoded: dict[Key, dict[str, EncodedFrame]]
    lists_bytes: int
    raw_bytes: int
    metadata_bytes: int
    geometry_bytes: int
    pack_ms: float
    unpack_ms: float

    def row(self, key: Key) -> dict[str, Any]:
        """The size and coding columns of one row."""
        texels = {name: plane.shape[0] * plane.shape[1] for name, plane in self.planes.items()}
        planes = 3 * sum(count for name, count in texels.items() if name != ALPHA)
        coded = self.encoded.get(key, {})
        frames = list(coded.values())
        video = self.lists_bytes + (sum(coded[n].bytes for n in coded if n != ALPHA) if frames else planes)
        alpha = coded[ALPHA].bytes if ALPHA in coded else texels.get(ALPHA)
        raw = self.raw_bytes + planes
        decoded = [frame for frame in frames if frame.decoded is not None]
        return {
            "encode_ms": self.pack_ms + sum(frame.encode_ms for frame in frames),
            "decode_ms": self.unpack_ms + sum(f.decode_ms for f in decoded) if decoded or not frames else None,
            "bytes_video": video,
            "bytes_alpha": alpha,
            "bytes_metadata": self.metadata_bytes,
            "bytes_geometry": self.geometry_bytes,
            "bytes_total": video + (alpha or 0) + self.metadata_bytes + self.geometry_bytes,
            "compression_ratio": video / raw if raw else None,
        }


@dataclass
class Measured:
    """What one frame of one method gives to the store, to the report's pictures and to `--dump`."""

    rows: list[dict[str, Any]]
    stages: list[tuple[str, float, int]]
    statistics: dict[str, float]
    repeats: list[tuple[int, str, float]]
    pictures: dict[str, np.ndarray]
    lossless: np.ndarray
    plane: np.ndarray | None
    alpha: np.ndarray | None
    owners: Owners | None
    details: dict[str, np.ndarray]


@dataclass
class Drawn:
    """The columns that come from drawing, by (codec, CRF), what the clients gave, the pictures, host milliseconds spent
    on metrics, and what was left out of these."""

    rows: dict[Key, dict[str, Any]] = field(default_factory=dict)
    images: dict[Key, Image] = field(default_factory=dict)
    pictures: dict[str, np.ndarray] = field(default_factory=dict)
    metrics_ms: float = 0.0
    lossless: np.ndarray | None = None
    skipped: frozenset[str] = frozenset()

    def row(self, key: Key) -> dict[str, Any]:
        """The columns of one row; none where that rate is not displayed."""
        return self.rows.get(key, {})


class Lane:
    """A packer with its clients, encoders and history; `dead` is the status and reason once it has stopped.

    A frame goes through `pack`, `advance`, `draw` and `measure`. `pack` and `draw` time the device: nothing may run
    beside them. `advance` and `measure` may run beside those of other lanes.
    `pack` and `advance` carry all state from frame to frame; `measure` carries only the history of the atlas, so a
    resumed run replays finished frames through `pack` and `advance` alone.
    """

    def __init__(self, packer: Packer, scene: ServerScene, settings: Settings, truth: Truth | None = None) -> None:
        """truth: of the scene and the settings' seed, where several lanes share one."""
        self.packer, self.scene, self.settings = packer, scene, settings
        self.method, self.variant = packer.name, variant_string(packer)
        self.dead: tuple[str, str] | None = None
        self.repeated = [self._another() for _ in range(settings.repeat - 1)]
        self.verifier = Verifier(truth or Truth(scene, settings.seed), packer)
        self.isolation: list[validity.Violation] = []
        self.history = AtlasHistory()
        self.streams: dict[str, list[VideoStream]] = {}
        self.fillers: dict[str, Filler] = {}
        self.last: Frame | None = None
        self.kept: Payload | None = None  # of the last frame, where packing its work again would give it again

    def prepare(self) -> float:
        """Prepare the packer and make its clients; returns host milliseconds of the packer's own part."""
        start = time.perf_counter()
        self.packer.prepare(self.scene)
        self.scene.device.finish()
        spent = (time.perf_counter() - start) * 1000
        for packer in self.repeated:
            packer.prepare(self.scene)
        self.lossless = self.packer.client(self.scene.shipped)
        self.displayed = None if len(self.keys()) == 1 else self.packer.client(self.scene.shipped)
        return spent

    def _another(self) -> Packer:
        """A packer of the same parameters and no past."""
        packer = self.packer
        return type(packer)(**{name: getattr(packer, name) for name in packer.parameters})

    def warm_up(self, work: Work) -> None:
        """Build and run every kernel once, so that no timer sees a compiler, with packers and clients of their own, of
        which it is checked meanwhile whether they share anything."""
        self.isolation = check_isolation(self.verifier.truth, self._another, work.frame, work.novel)
        self.scene.device.finish()
        self.scene.skips.take()  # so that no frame's row names what only warming up left out

    @property
    def display_key(self) -> Key:
        """The (codec, CRF) whose decoded planes the client shows beside the lossless row."""
        return (self.settings.codec, self.settings.display_crf if self.settings.codec == "h264" else None)

    def keys(self) -> list[Key]:
        """The (codec, CRF) of every row of a frame."""
        coded = {"h264": [("h264", crf) for crf in self.settings.crfs], "jpeg": [("jpeg", None)], "none": []}
        return [("none", None), *(coded[self.settings.codec] if self.packer.atlas else [])]

    def pack(self, frame: Frame) -> Packed:
        """Pack one frame, `--repeat` times; the repetitions use packers of their own with the same past.

        A frame of the same work as the last two is not packed again if the packer says that nothing would change: the
        second of them still tells the client what changed since the one before.
        """
        start = time.perf_counter()
        alike = self.last is not None and same_work(self.last, frame)
        self.last = frame
        if self.scene.skips.leaves_out("packing", alike and self.kept is not None):
            wall = (time.perf_counter() - start) * 1000
            return Packed(self.kept, {}, {}, wall, skipped=self.scene.skips.take())
        packed = self._pack(frame)
        self.kept = packed.payload if alike and self.packer.settled() else None
        return packed

    def _pack(self, frame: Frame) -> Packed:
        packed = self._timed(self.packer, frame)
        again = [self._timed(packer, frame) for packer in self.repeated]
        if again:
            runs = [packed, *again]
            packed.repeats = [run.stages for run in runs]
            packed.stages = {name: median(run.stages.get(name, 0.0) for run in runs) for name in packed.stages}
            packed.wall_ms = median(run.wall_ms for run in runs)
        return packed

    def _timed(self, packer: Packer, frame: Frame) -> Packed:
        self.scene.device.finish()
        start = time.perf_counter()
        with self.scene.device.record() as record:
            payload = packer.pack(frame)
        wall = (time.perf_counter() - start) * 1000
        return Packed(payload, record.milliseconds, record.launches, wall, skipped=self.scene.skips.take())

    def advance(self, payload: Payload) -> Sent:
        """Encode the payload, decode it as the clients would, and hand it to them."""
        planes = {name: plane.get() for name, plane in payload.planes.items()}
        start = time.thread_time()
        blobs, lists = pack_lz4(payload.blobs), pack_lz4(payload.lists)
        geometry = pack_lz4({"geometry": payload.geometry})
        middle = time.thread_time()
        received, shapes = unpack_lz4(blobs), unpack_lz4(geometry)["geometry"]
        fragments = unpack_lz4(lists)
        end = time.thread_time()
        sent = Sent(
            planes,
            {},
            sum(map(len, lists.values())),
            payload.raw_bytes,
            sum(map(len, blobs.values())),
            sum(map(len, geometry.values())),
            (middle - start) * 1000,
            (end - middle) * 1000,
        )
        self.lossless.receive(Decoded({name: p[..., :3] for name, p in planes.items()}, received, shapes, fragments))
        if self.displayed is not None:
            decoded = {name: self._encode(name, plane, sent) for name, plane in payload.planes.items()}
            self.displayed.receive(Decoded(decoded, received, shapes, fragments))
        return sent

    def _encode(self, name: str, plane: Any, sent: Sent) -> np.ndarray:
        """Encode one plane at every rate; returns what the display's rate decodes to."""
        height, width = plane.shape[:2]
        coded = self.keys()[1:]
        if name not in self.streams:
            self.streams[name] = [
                VideoStream(codec, crf, width, height, decode=(codec, crf) == self.display_key, grey=name == ALPHA)
                for codec, crf in coded
            ]
            self.fillers[name] = Filler(self.scene.device, width, height)
        frames = encode_all(self.streams[name], self.fillers[name].fill(plane).get())
        for key, frame in zip(coded, frames, strict=True):
            sent.encoded.setdefault(key, {})[name] = frame
        return frames[coded.index(self.display_key)].decoded

    def remember(self, payload: Payload, owners: Owners | None, sent: Sent) -> dict[str, float | None]:
        """Fill and coherence of the frame's atlas; it is remembered for the next frame."""
        if owners is None or not sent.planes:
            return {}
        plane = next(iter(sent.planes.values()))
        owner = owner_plane(owners, plane.shape[1], plane.shape[0])
        use = self.history.update(owner, plane)
        return {
            "atlas_width": plane.shape[1],
            "atlas_height": plane.shape[0],
            "fill": use.fill,
            "coherence": use.coherence,
            "coherence_bytes": use.coherence_bytes,
        }

    def replay(self, work: Work) -> None:
        """Bring all state to where it was after this frame, without measuring."""
        payload = self.pack(work.frame).payload
        self.remember(payload, payload.owners(), self.advance(payload))
        self.verifier.pass_over(self.lossless)

    def draw(self, novel: NovelView, metrics: Metrics, pictured: bool) -> Drawn:
        """Draw the novel view with both clients and compare with the reference; pictured: keep the pictures."""
        drawn = Drawn(skipped=metrics.skipped)
        for key, client in (("none", None), self.lossless), (self.display_key, self.displayed):
            if client is None:
                continue
            image, milliseconds = self._draw_once(client, novel)
            start = time.perf_counter()
            values = metrics.compare(image.rgb)
            drawn.metrics_ms += (time.perf_counter() - start) * 1000
            drawn.images[key] = image
            drawn.rows[key] = {**{name: values[name] for name in QUALITIES}, "client_ms": milliseconds}
            rgb = image.rgb.get()[..., :3]
            if client is self.lossless:
                drawn.lossless = rgb
            if pictured:  # the report shows the displayed client, which is drawn last
                flip = metrics.flip_map()
                drawn.pictures = {"client": rgb} | ({} if flip is None else {"flip": flip})
        return drawn

    def _draw_once(self, client: Client, novel: NovelView) -> tuple[Image, float]:
        with self.scene.device.record() as record:
            image = client.draw(novel.view)
        return image, sum(record.milliseconds.values())

    def measure(
        self, work: Work, novel: NovelView, packed: Packed, sent: Sent, drawn: Drawn, pictured: bool
    ) -> Measured:
        """Check and measure one packed, sent and drawn frame; pictured: with the pictures that the report shows."""
        payload, frame = packed.payload, work.frame
        gaps = validity.Gaps() if self.packer.leaves_unwritten else None
        owners = payload.owners()
        stages = None if "packing" in packed.skipped else packed.stages
        verified = self.verifier.verify(frame, payload, sent.planes, owners, self.lossless, stages)
        self._check_pictures(frame, payload, novel, drawn, verified)
        located = self.lossless.locate(novel.triangle, novel.bary)
        visible = None if located is None else (novel.triangle, novel.bary, located)
        found = validity.check(frame, payload, owners, self.lossless, visible, gaps=gaps)
        found += verified.found + self.isolation
        status, reason = _verdict(frame, payload, found)
        common = {
            "status": status,
            "reason": reason,
            "pvs_triangles": len(frame.pvs),
            "placed_triangles": len(frame.pvs) - len(payload.unplaced),
            "samples": verified.samples,
            "structs_ms": packed.total("structs"),
            "gather_ms": packed.total("gather"),
            "server_ms": packed.total(),
            "pvs_ms": work.pvs_ms,
            "wall_ms": packed.wall_ms,
            "missing_px": novel.missing,
            "skipped": "; ".join(sorted(self.scene.skips.always | drawn.skipped | work.skipped | packed.skipped)),
            **self.remember(payload, owners, sent),
            **self._stretch(novel, located),
        }
        plane = next(iter(sent.planes.values()), None)
        rows = [{**common, "peak_mb": peak_memory() / 1e6, **sent.row(key), **drawn.row(key)} for key in self.keys()]
        for row, (codec, crf) in zip(rows, self.keys(), strict=True):
            row.update(codec=codec, crf=crf)
        return Measured(
            rows,
            [(name, ms, packed.launches[name]) for name, ms in packed.stages.items()],
            statistics_of(payload)
            | _speed(packed, verified.samples, novel)
            | self._cost_of_metrics(packed, novel, drawn)
            | {"checks_ms": verified.milliseconds}
            | ({"unwritten_lookups": gaps.share} if gaps and gaps.touched else {}),
            [(index, name, ms) for index, run in enumerate(packed.repeats) for name, ms in run.items()],
            self._pictures(payload, sent.planes, drawn) if pictured else {},
            drawn.lossless,
            plane,
            sent.planes.get(ALPHA),
            owners,
            payload.details,
        )

    def _check_pictures(
        self, frame: Frame, payload: Payload, novel: NovelView, drawn: Drawn, verified: Verified
    ) -> None:
        """Holes, and what clients say that they show; of both clients, which may have received different planes."""
        start = time.perf_counter()
        for key, image in drawn.images.items():
            known = (self.verifier.truth, frame, self.method, payload, novel, image)
            drawn.rows[key]["holes_px"], found = check_picture(*known)
            verified.found += found
        verified.milliseconds += (time.perf_counter() - start) * 1000

    def _pictures(self, payload: Payload, planes: dict[str, np.ndarray], drawn: Drawn) -> dict[str, np.ndarray]:
        """Everything the report shows of a frame, by name."""
        shown = {"alpha" if name == ALPHA else "atlas": plane[..., :3] for name, plane in reversed(planes.items())}
        return drawn.pictures | shown | self.packer.pictures(payload)

    def _cost_of_metrics(self, packed: Packed, novel: NovelView, drawn: Drawn) -> dict[str, float]:
        """Host time of all picture metrics of the frame, and its ratio to rendering and packing it."""
        drawing = novel.milliseconds + sum(row["client_ms"] for row in drawn.rows.values())
        spent = novel.metrics_ms + drawn.metrics_ms
        return {
            "metrics_ms": spent,
            "reference_ms": novel.milliseconds,
            "metrics_over_work": spent / (packed.wall_ms + drawing),
        }

    def _stretch(self, novel: NovelView, texels: np.ndarray | None) -> dict[str, float | None]:
        """Stretch of the atlas on the novel view's pixels; texels: float64 (n, 2), where its points lie."""
        wanted = "stretch" in self.settings.metrics
        if texels is None or not (wanted or "metrics" in self.scene.skips.off):
            return {}
        height, width = novel.visibility.shape
        positions = np.full((height * width, 2), np.nan, np.float32)
        positions[novel.pixel] = texels
        device = self.scene.device
        located = device.upload(positions.reshape(height, width, 2))
        l2, linf, _ = stretch(device, device.upload(novel.visibility), located)
        return {"stretch_l2": l2, "stretch_linf": linf} if wanted else {}


def _speed(packed: Packed, samples: int, novel: NovelView) -> dict[str, float]:
    """What compares across machines: structures over server time, and the cost of a gathered sample over that of a
    covered pixel in the reference's shading kernel; what was not measured is left out."""
    structs, gather = packed.total("structs"), packed.total("gather")
    found = {"structs_share": structs / (structs + gather)} if structs + gather else {}
    if novel.shading_ns and samples:
        found |= {
            "reference_shading_ns": novel.shading_ns,
            "gather_over_shading": gather * 1e6 / samples / novel.shading_ns,
        }
    return found


def same_work(a: Frame, b: Frame) -> bool:
    """Whether two frames ask the same of a packer, but for their numbers."""
    views = zip((a.server, *a.predicted), (b.server, *b.predicted), strict=True)
    return (
        a.scene is b.scene
        and len(a.predicted) == len(b.predicted)
        and (a.cell_radius, a.cell_fov, a.seed) == (b.cell_radius, b.cell_fov, b.seed)
        and (a.atlas_width, a.atlas_height) == (b.atlas_width, b.atlas_height)
        and all(
            np.array_equal(one.matrix, other.matrix) and (one.width, one.height) == (other.width, other.height)
            for one, other in views
        )
        and np.array_equal(a.pvs, b.pvs)
    )


def _verdict(frame: Frame, payload: Payload, found: list[validity.Violation]) -> tuple[str, str | None]:
    """The status of a frame and its reason."""
    if found:
        return "invalid", " ".join(dict.fromkeys(violation.sentence for violation in found))
    if payload.unplaced:
        reasons = sorted(set(payload.unplaced.values()))
        return "overflow", f"{len(payload.unplaced)} of {len(frame.pvs)} triangles unplaced: {'; '.join(reasons)}"
    return "ok", None


def stopped_rows(keys: list[Key], status: str, reason: str) -> Iterator[dict[str, Any]]:
    """One row per (codec, CRF) of a frame that gave no results."""
    for codec, crf in keys:
        yield {"codec": codec, "crf": crf, "status": status, "reason": reason}
