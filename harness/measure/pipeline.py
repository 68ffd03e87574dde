"""One method on its way through the frames of a run: pack, fill, encode, decode, draw, check, measure."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from statistics import median
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from shading_atlas_bench.arithmetic import arrays
from shading_atlas_bench.arithmetic.arrays import Bytes, Doubles, fixed
from shading_atlas_bench.harness.errors import is_stop, plain
from shading_atlas_bench.harness.measure import validity
from shading_atlas_bench.harness.measure.codecs import EncodedFrame, VideoStream, encode_all, pack_lz4, unpack_lz4
from shading_atlas_bench.harness.measure.coherence import AtlasHistory
from shading_atlas_bench.harness.measure.dump import owner_plane
from shading_atlas_bench.harness.measure.machine import peak_memory
from shading_atlas_bench.harness.measure.metrics import Metrics
from shading_atlas_bench.harness.measure.novel_view import NovelView
from shading_atlas_bench.harness.measure.returned import (
    LONGEST_REASON,
    CheckedClient,
    CheckedPacker,
    Received,
    read_launches,
    read_payload,
)
from shading_atlas_bench.harness.measure.verification.frame import Verified, Verifier
from shading_atlas_bench.harness.measure.verification.isolation import check_isolation
from shading_atlas_bench.harness.measure.verification.pictures import Shown, check_picture
from shading_atlas_bench.harness.measure.verification.truth import Truth
from shading_atlas_bench.harness.watch.watchdog import PackTimeoutError
from shading_atlas_bench.harness.workload.frames import FrameWorkload, sample_budget
from shading_atlas_bench.harness.workload.settings import Settings
from shading_atlas_bench.kernels.fill.fill import Filler
from shading_atlas_bench.kernels.metrics.stretch import stretch
from shading_atlas_bench.packers.interface import (
    ALPHA,
    Decoded,
    Frame,
    NotShippedError,
    Owners,
    Packer,
    Payload,
    RareCost,
    ServerScene,
)
from shading_atlas_bench.reports.store.columns import PICTURE_METRICS, RATE_METRICS

if TYPE_CHECKING:
    from pyopencl.array import Array

Key = tuple[str, int | None]  # codec and CRF
T = TypeVar("T")
LOSSLESS: Key = ("none", None)


@dataclass
class Packed:
    """What packing one frame gave; times are device milliseconds by stage, `wall_ms` is the host's.

    repeats: every repetition's stages, where there is more than one; `stages` and `wall_ms` are then medians.
    skipped: what was left out of it.
    """

    payload: Received
    stages: dict[str, float]
    launches: dict[str, int]
    wall_ms: float
    repeats: list[dict[str, float]] = field(default_factory=list)
    skipped: frozenset[str] = frozenset()

    def total(self, group: str = "") -> float:
        """Device milliseconds of all stages of a group ("structs" or "gather"); of all launches without one."""
        return sum(ms for name, ms in self.stages.items() if name.startswith(group and group + "/"))


@dataclass(frozen=True)
class Clocked:
    """Milliseconds of some work on the device, and what the host spends beside waiting for it."""

    device: float
    host: float

    @classmethod
    def of(cls, wall: float, device: float) -> Clocked:
        """From the host's clock around it, which the device's own may exceed by its resolution."""
        return cls(device, max(0.0, wall - device))


@dataclass
class Filled:
    """A frame's planes on the host, by name: as packed, and for a video codec with unowned texels filled.

    planes, filled: uint8 (H, W, 4) each, as in Payload.
    read_ms: host time of reading the first back; fill_ms: of filling the second and reading them back.
    """

    planes: dict[str, Bytes]
    filled: dict[str, Bytes]
    read_ms: float
    fill_ms: float

    def milliseconds(self, key: Key) -> float:
        """What one row's frame needs of it."""
        return self.read_ms if key[0] == "none" else self.fill_ms


@dataclass
class Sent:
    """What went over the wire: each (codec, CRF)'s encoded planes by name, and compressed bytes.

    arrived: what each client gets of it. further: the planes of the rates that no client gets, uint8 (H, W, 3) by name.
    texels: of each plane.
    lists_bytes: of a method without planes, which are then its video; raw_bytes: before compression.
    pack_ms, unpack_ms: of everything but planes.
    """

    texels: dict[str, int]
    encoded: dict[Key, dict[str, EncodedFrame]]
    arrived: dict[Key, Decoded]
    lists_bytes: int
    raw_bytes: int
    metadata_bytes: int
    geometry_bytes: int
    pack_ms: float
    unpack_ms: float
    further: dict[Key, dict[str, Bytes]] = field(default_factory=dict)

    def clocked(self, key: Key) -> float:
        """Processor milliseconds of coding one row's frame, by clocks around the coders."""
        return self.pack_ms + self.unpack_ms + sum(frame.clocked_ms for frame in self.encoded.get(key, {}).values())

    def row(self, key: Key) -> dict[str, Any]:
        """The size and coding columns of one row."""
        texels = self.texels
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
    """What one frame of one method gives to the store, to the report's pictures and to `--dump`.

    pictures: uint8 (h, w, 3), by name. lossless: as in Drawn. plane, alpha: uint8 (H, W, 4), the first plane as
    packed and that of opacities, None where there is none. details: see Packer.details.
    """

    rows: list[dict[str, Any]]
    stages: list[tuple[str, float, int]]
    statistics: dict[str, float]
    repeats: list[tuple[int, str, float]]
    pictures: dict[str, Bytes]
    lossless: Bytes
    plane: Bytes | None
    alpha: Bytes | None
    owners: Owners | None
    details: dict[str, arrays.Array]


@dataclass
class Drawn:
    """The columns that come from drawing, by (codec, CRF), what the clients gave, the pictures, host milliseconds spent
    on metrics and on further rates, and what was left out. clocked: host milliseconds from the payload's arrival to the
    picture.
    lossless: uint8 (h, w, 3), what the client of the planes as packed shows."""

    rows: dict[Key, dict[str, Any]] = field(default_factory=dict)
    shown: dict[Key, Shown] = field(default_factory=dict)
    clocked: dict[Key, float] = field(default_factory=dict)
    pictures: dict[str, Bytes] = field(default_factory=dict)
    metrics_ms: float = 0.0
    rates_ms: float = 0.0
    lossless: Bytes = field(default_factory=lambda: np.empty((0, 0, 3), np.uint8))
    skipped: frozenset[str] = frozenset()

    def row(self, key: Key) -> dict[str, Any]:
        """The columns of one row; none where that rate is not displayed."""
        return self.rows.get(key, {})


class Pipeline:
    """A packer with its clients, encoders and history; `dead` is the status and reason once it has stopped.

    A frame goes through `pack`, `fill`, `advance`, `draw` and `measure`. `pack`, `fill` and `draw` time the device:
    nothing may run beside them. `advance` and `measure` may run beside those of other pipelines.
    All but `measure` carry state from frame to frame; `measure` carries only the history of the atlas, so a resumed run
    replays finished frames without drawing and measuring.
    """

    def __init__(self, packer: Packer, scene: ServerScene, settings: Settings, truth: Truth | None = None) -> None:
        """truth: of the scene and the settings' seed, where several pipelines share one. Nothing of the packer's is run
        before `prepare`."""
        self.packer, self.settings = CheckedPacker(packer), settings
        self.method, self.variant, self.label = packer.name, self.packer.variant, self.packer.label
        self.dead: tuple[str, str] | None = None
        self._whole_scene, self._truth = scene, truth or Truth(scene, settings.seed)
        self.rare_costs: tuple[RareCost, ...] = ()
        self.isolation: list[validity.Violation] = []
        self.history = AtlasHistory()
        self.streams: dict[str, list[VideoStream]] = {}
        self.fillers: dict[str, Filler] = {}
        self.last: Frame | None = None
        self.kept: Received | None = None  # of the last frame, where packing its work again would give it again

    @cached_property
    def scene(self) -> ServerScene:
        """The scene as the packer shades it."""
        return self.packer.scene_shaded(self._whole_scene)

    @cached_property
    def repeated(self) -> list[CheckedPacker]:
        """The packers of the repetitions."""
        return [CheckedPacker(self._another()) for _ in range(self.settings.repeat - 1)]

    @cached_property
    def verifier(self) -> Verifier:
        """What checks its frames."""
        return Verifier(self._truth.of(self.packer), self.packer)

    def prepare(self) -> float:
        """Prepare the packer and make its clients; returns host milliseconds of the packer's own part."""
        scene = self.scene
        start = time.perf_counter()
        self.packer.prepare(scene)
        scene.device.finish()
        spent = (time.perf_counter() - start) * 1000
        for packer in self.repeated:
            packer.prepare(self.scene)
        self.lossless = self.packer.client(self.scene.shipped)
        self.displayed = None if len(self.keys()) == 1 else self.packer.client(self.scene.shipped)
        return spent

    def _another(self) -> Packer:
        """A packer of the same parameters and no past."""
        packer = self.packer.own
        return type(packer)(**{name: getattr(packer, name) for name in packer.parameters})

    def warm_up(self, work_of: Callable[[int], FrameWorkload], tried: int) -> None:
        """Build and run every kernel once, so that no timer sees a compiler, with packers and clients of their own, of
        which it is checked meanwhile whether they share anything.

        work_of: the work of a frame by its number. tried: the number of the frame that they are checked in. A method
        that fails in it will do so again when its turn comes: then it is the first frame that they are checked in.
        """
        work = work_of(tried)
        try:
            self.isolation = self._isolation(work)
        except (NotShippedError, PackTimeoutError):
            raise
        except BaseException as error:
            if is_stop(error):
                raise
            work = work_of(0)
            self.isolation = self._isolation(work)
        if self.packer.atlas and len(self.keys()) > 1:
            device, width, height = self.scene.device, work.frame.atlas_width, work.frame.atlas_height
            Filler(device, width, height).fill(device.zeros((height, width, 4), np.uint8)).get()
        self.scene.device.finish()
        self.scene.skips.take()  # so that no frame's row names what only warming up left out

    def _isolation(self, work: FrameWorkload) -> list[validity.Violation]:
        return check_isolation(self.verifier.truth, self._another, self._shaded(work.frame), work.novel)

    @property
    def display_key(self) -> Key:
        """The (codec, CRF) whose decoded planes the client shows beside the lossless row."""
        return (self.settings.codec, self.settings.display_crf if self.settings.codec == "h264" else None)

    def keys(self) -> list[Key]:
        """The (codec, CRF) of every row of a frame."""
        coded: dict[str, list[Key]] = {
            "h264": [("h264", crf) for crf in self.settings.crfs],
            "jpeg": [("jpeg", None)],
            "none": [],
        }
        return [LOSSLESS, *(coded[self.settings.codec] if self.packer.atlas else [])]

    def pack(self, frame: Frame) -> Packed:
        """Pack one frame, `--repeat` times; the repetitions use packers of their own with the same past.

        A frame of the same work as the last two is not packed again if the packer says that nothing would change: the
        second of them still tells the client what changed since the one before.
        """
        start = time.perf_counter()
        alike = self.last is not None and same_work(self.last, frame)
        self.last = frame
        if alike and self.kept is not None and self.scene.skips.leaves_out("packing", True):
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

    def _timed(self, packer: CheckedPacker, frame: Frame) -> Packed:
        shaded = self._shaded(frame)
        self.scene.device.finish()
        start = time.perf_counter()
        with self.scene.device.record() as record:
            returned = packer.own.pack(shaded)
        wall = (time.perf_counter() - start) * 1000
        skipped = self.scene.skips.take()
        read_launches(record.launches, skipped)
        return Packed(read_payload(returned, shaded), record.milliseconds, record.launches, wall, skipped=skipped)

    def _shaded(self, frame: Frame) -> Frame:
        """The frame with the scene as the packer shades it, and a list of visible triangles that is its own."""
        return replace(frame, scene=self.scene, pvs_device=self.scene.device.upload(frame.pvs))

    def fill(self, payload: Received) -> Filled:
        """Read the planes back; for a video codec, fill them first."""
        start = time.perf_counter()
        planes = {name: fixed(plane.get()) for name, plane in payload.planes.items()}
        middle = time.perf_counter()
        filled = {name: self._filler(name, plane).fill(plane).get() for name, plane in self._coded(payload).items()}
        end = time.perf_counter()
        return Filled(planes, filled, (middle - start) * 1000, (end - middle) * 1000)

    def _coded(self, payload: Received) -> dict[str, Array]:
        """The planes that a video codec takes."""
        return payload.planes if len(self.keys()) > 1 else {}

    def _filler(self, name: str, plane: Array) -> Filler:
        if name not in self.fillers:
            height, width = plane.shape[:2]
            self.fillers[name] = Filler(self.scene.device, width, height)
        return self.fillers[name]

    def advance(self, payload: Received, filled: Filled, *, last: bool = False) -> Sent:
        """Encode the payload, and decode it as the clients would. last: no frame follows."""
        start = time.thread_time()
        blobs, lists = pack_lz4(payload.blobs), pack_lz4(payload.lists)
        geometry = pack_lz4({"geometry": payload.geometry})
        middle = time.thread_time()
        received, shapes = unpack_lz4(blobs), unpack_lz4(geometry)["geometry"]
        fragments = unpack_lz4(lists)
        end = time.thread_time()
        encoded: dict[Key, dict[str, EncodedFrame]] = {}
        for name, plane in filled.filled.items():
            frames = encode_all(self._streams(name, plane), plane, last=last)
            for key, frame in zip(self.keys()[1:], frames, strict=True):
                encoded.setdefault(key, {})[name] = frame
        plain = {name: plane[..., :3] for name, plane in filled.planes.items()}
        shown = {key: {name: fixed(frame.shown) for name, frame in encoded[key].items()} for key in self._shown_keys()}
        arriving = {LOSSLESS: plain} | {key: shown.pop(key) for key in (self.display_key,) if self.displayed}
        return Sent(
            {name: plane.shape[0] * plane.shape[1] for name, plane in plain.items()},
            encoded,
            {key: Decoded(planes, dict(received), shapes, dict(fragments)) for key, planes in arriving.items()},
            sum(map(len, lists.values())),
            payload.raw_bytes,
            sum(map(len, blobs.values())),
            sum(map(len, geometry.values())),
            (middle - start) * 1000,
            (end - middle) * 1000,
            further=shown,
        )

    def _streams(self, name: str, plane: Bytes) -> list[VideoStream]:
        """The encoders of one plane, one for each rate."""
        if name not in self.streams:
            height, width = plane.shape[:2]
            self.streams[name] = [
                VideoStream(codec, crf, width, height, decode=(codec, crf) in self._shown_keys(), grey=name == ALPHA)
                for codec, crf in self.keys()[1:]
            ]
        return self.streams[name]

    def _shown_keys(self) -> list[Key]:
        """The codings of planes whose pictures are measured."""
        if self.displayed is None:
            return []
        judged = self.displayed.shows_other_rates and set(RATE_METRICS) & set(self.settings.metrics)
        return self.keys()[1:] if judged else [self.display_key]

    @property
    def clients(self) -> dict[Key, CheckedClient]:
        """The client of the planes as packed, and that of the displayed rate, if there is one."""
        return {LOSSLESS: self.lossless} | ({self.display_key: self.displayed} if self.displayed else {})

    def remember(self, owners: Owners | None, planes: dict[str, Bytes]) -> dict[str, float | None]:
        """Fill and coherence of the frame's atlas, the first of planes uint8 (H, W, 4); it is remembered for the next
        frame."""
        if owners is None or not planes:
            return {}
        plane = next(iter(planes.values()))
        owner = owner_plane(owners, plane.shape[1], plane.shape[0])
        use = self.history.update(owner, plane)
        return {
            "atlas_width": plane.shape[1],
            "atlas_height": plane.shape[0],
            "sample_budget": sample_budget(self.settings),
            "fill": use.fill,
            "coherence": use.coherence,
            "coherence_bytes": use.coherence_bytes,
        }

    def replay(self, work: FrameWorkload) -> dict[str, Any]:
        """Bring all state to where it was after this frame, without measuring; columns of its row without a codec that
        tell whether it is the same frame again."""
        payload = self.pack(work.frame).payload
        filled = self.fill(payload)
        sent = self.advance(payload, filled)
        for key, client in self.clients.items():
            client.receive(sent.arrived[key])
        owners = payload.owners()
        found = sent.row(LOSSLESS) | self.remember(owners, filled.planes)
        found["samples"] = self.verifier.pass_over(payload, owners, self.lossless)
        return {name: value for name, value in found.items() if not name.endswith("_ms")}

    def draw(self, sent: Sent, novel: NovelView, metrics: Metrics, pictured: bool) -> Drawn:
        """Hand the frame to both clients, draw the novel view and compare with the reference; pictured: keep the
        pictures."""
        drawn = Drawn(skipped=metrics.skipped)
        for key, client in self.clients.items():
            begin = time.perf_counter()
            receiving, _ = self._clocked(partial(client.own.receive, sent.arrived[key]))
            drawing, returned = self._clocked(partial(client.own.draw, novel.view))
            drawn.clocked[key] = (time.perf_counter() - begin) * 1000
            image = client.read_image(returned, novel.view)
            start = time.perf_counter()
            values = metrics.compare(image.rgb)
            drawn.metrics_ms += (time.perf_counter() - start) * 1000
            drawn.shown[key] = Shown.of(image)
            drawn.rows[key] = {
                **{name: values[name] for name in PICTURE_METRICS},
                "receive_ms": receiving.host,
                "draw_host_ms": drawing.host,
                "client_ms": receiving.device + drawing.device,
            }
            rgb = image.rgb.get()[..., :3]
            if key == LOSSLESS:
                drawn.lossless = rgb
            if pictured:  # the report shows the displayed client, which is drawn last
                flip = metrics.flip_map()
                drawn.pictures = {"client": rgb} | ({} if flip is None else {"flip": flip})
        start = time.perf_counter()
        for key, planes in sent.further.items():
            drawn.rows[key] = self._judge(planes, novel, metrics)
        drawn.rates_ms = (time.perf_counter() - start) * 1000
        return drawn

    def _judge(self, planes: dict[str, Bytes], novel: NovelView, metrics: Metrics) -> dict[str, float | None]:
        """The quality of what the client of the displayed rate would show at another one."""
        assert self.displayed is not None, "planes of further rates come with a client of one"
        self.displayed.own.replace_planes(planes)
        return metrics.compare(self.displayed.draw(novel.view).rgb, RATE_METRICS)

    def _clocked(self, work: Callable[[], T]) -> tuple[Clocked, T]:
        """What some work of the client gives, and how long host and device take."""
        start = time.perf_counter()
        with self.scene.device.record() as record:
            result = work()
        wall = (time.perf_counter() - start) * 1000
        return Clocked.of(wall, sum(record.milliseconds.values())), result

    def measure(
        self,
        work: FrameWorkload,
        novel: NovelView,
        packed: Packed,
        filled: Filled,
        sent: Sent,
        drawn: Drawn,
        pictured: bool,
    ) -> Measured:
        """Check and measure one packed, sent and drawn frame; pictured: with the pictures that the report shows."""
        payload, frame = packed.payload, work.frame
        gaps = validity.Gaps() if self.packer.leaves_unwritten else None
        owners = payload.owners()
        stages = None if "packing" in packed.skipped else packed.stages
        verified = self.verifier.verify(frame, payload, filled.planes, owners, self.lossless, stages)
        self._check_pictures(frame, payload, novel, drawn, verified)
        located = self.lossless.locate(novel.triangle, novel.bary)
        visible = None if located is None else (novel.triangle, novel.bary, located)
        found = validity.check(frame, payload, owners, self.lossless, visible, gaps=gaps)
        found += verified.found + self.isolation
        status, reason = _verdict(frame, payload, found)
        packing = Clocked.of(packed.wall_ms, packed.total())
        common = {
            "status": status,
            "reason": reason,
            "pvs_triangles": len(frame.pvs),
            "placed_triangles": len(frame.pvs) - len(payload.unplaced),
            "samples": verified.samples,
            "structs_ms": packed.total("structs"),
            "gather_ms": packed.total("gather"),
            "server_ms": packing.device,
            "serialise_ms": packing.host,
            "pvs_ms": work.pvs_ms,
            "wall_ms": packed.wall_ms,
            "missing_px": novel.missing,
            "view_dependence": novel.view_dependence,
            "skipped": "; ".join(sorted(self.scene.skips.always | drawn.skipped | work.skipped | packed.skipped)),
            **self.remember(owners, filled.planes),
            **self._stretch(novel, located),
        }
        common["peak_mb"] = peak_memory() / 1e6
        return Measured(
            [{**common, **self._row(key, packed, filled, sent, drawn)} for key in self.keys()],
            [(name, ms, packed.launches[name]) for name, ms in packed.stages.items()],
            payload.statistics
            | _speed(packed, verified.samples, novel)
            | self._cost_of_metrics(packed, novel, drawn)
            | {"checks_ms": verified.milliseconds}
            | ({"rates_ms": drawn.rates_ms} if sent.further else {})
            | ({} if gaps is None or gaps.share is None else {"unwritten_lookups": gaps.share}),
            [(index, name, ms) for index, run in enumerate(packed.repeats) for name, ms in run.items()],
            self._pictures(payload, filled.planes, drawn) if pictured else {},
            drawn.lossless,
            next(iter(filled.planes.values()), None),
            filled.planes.get(ALPHA),
            owners,
            self.packer.details(payload) if self.settings.dump else {},
        )

    def _row(self, key: Key, packed: Packed, filled: Filled, sent: Sent, drawn: Drawn) -> dict[str, Any]:
        """The columns of one row that depend on its codec and rate."""
        row = {"codec": key[0], "crf": key[1], "fill_ms": filled.milliseconds(key), **sent.row(key), **drawn.row(key)}
        row["network_ms"] = row["bytes_total"] * 8 / (self.settings.bandwidth * 1000)
        if key in drawn.clocked:
            steps = (packed.wall_ms, filled.milliseconds(key), sent.clocked(key), drawn.clocked[key])
            row["frame_ms"] = sum(steps) + row["network_ms"]
        return row

    def _check_pictures(
        self, frame: Frame, payload: Received, novel: NovelView, drawn: Drawn, verified: Verified
    ) -> None:
        """Holes, and what clients say that they show; of both clients, which may have received different planes."""
        start = time.perf_counter()
        for key, shown in drawn.shown.items():
            drawn.rows[key]["holes_px"], found = check_picture(
                self.verifier.truth, frame, verified.draw, payload, novel, shown
            )
            verified.found += found
        verified.milliseconds += (time.perf_counter() - start) * 1000

    def _pictures(self, payload: Received, planes: dict[str, Bytes], drawn: Drawn) -> dict[str, Bytes]:
        """Everything the report shows of a frame, by name."""
        shown = {"alpha" if name == ALPHA else "atlas": plane[..., :3] for name, plane in reversed(planes.items())}
        return drawn.pictures | shown | self.packer.pictures(payload)

    def _cost_of_metrics(self, packed: Packed, novel: NovelView, drawn: Drawn) -> dict[str, float]:
        """Host time of all picture metrics of the frame, and its ratio to rendering and packing it."""
        drawing = novel.milliseconds + sum(drawn.rows[key]["client_ms"] for key in drawn.clocked)
        spent = novel.metrics_ms + drawn.metrics_ms
        return {
            "metrics_ms": spent,
            "reference_ms": novel.milliseconds,
            "metrics_over_work": spent / (packed.wall_ms + drawing),
        }

    def _stretch(self, novel: NovelView, texels: Doubles | None) -> dict[str, float | None]:
        """Stretch of the atlas on the novel view's pixels; texels: float64 (n, 2), where its points lie."""
        wanted = "stretch" in self.settings.metrics
        if texels is None or not (wanted or "metrics" in self.scene.skips.off):
            return {}
        height, width = novel.visibility.shape
        positions = np.full((height * width, 2), np.nan, np.float32)
        with np.errstate(over="ignore"):  # what lies so far outside breaks a rule
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
        and a.sample_budget == b.sample_budget
        and all(
            np.array_equal(one.matrix, other.matrix) and (one.width, one.height) == (other.width, other.height)
            for one, other in views
        )
        and np.array_equal(a.pvs, b.pvs)
    )


def _verdict(frame: Frame, payload: Payload, found: list[validity.Violation]) -> tuple[str, str | None]:
    """The status of a frame and its reason."""
    if found:
        return "invalid", plain(" ".join(dict.fromkeys(violation.sentence for violation in found)), LONGEST_REASON)
    if payload.unplaced:
        reasons = sorted(set(payload.unplaced.values()))
        return "overflow", f"{len(payload.unplaced)} of {len(frame.pvs)} triangles unplaced: {'; '.join(reasons)}"
    return "ok", None


def stopped_rows(keys: list[Key], status: str, reason: str) -> Iterator[dict[str, Any]]:
    """One row per (codec, CRF) of a frame that gave no results."""
    for codec, crf in keys:
        yield {"codec": codec, "crf": crf, "status": status, "reason": reason}
