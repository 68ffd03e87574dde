"""`bench run --explain`: which skips apply here or why not, and what each saves, measured in one process."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from statistics import median
from typing import TYPE_CHECKING, Any

from shading_atlas_bench.harness.measure.metrics import Metrics
from shading_atlas_bench.harness.measure.novel_view import draw_novel_view
from shading_atlas_bench.harness.measure.pipeline import Pipeline
from shading_atlas_bench.harness.measure.returned import verdict_on
from shading_atlas_bench.harness.watch.watchdog import ended_steps, longer_than, time_limit
from shading_atlas_bench.harness.workload.frames import FrameSource
from shading_atlas_bench.harness.workload.methods import find_methods
from shading_atlas_bench.harness.workload.reference import ForwardRenderer
from shading_atlas_bench.harness.workload.session import Session
from shading_atlas_bench.harness.workload.skips import METRICS, PACKING, PICTURE, SET, Skip, known_skips
from shading_atlas_bench.harness.workload.upload import upload_scene
from shading_atlas_bench.packers.skips import Skips

if TYPE_CHECKING:
    from collections.abc import Callable

FRAMES, ROUNDS = 3, 3
PREPARE = 10  # packings' time that preparing may take, as in a run


@dataclass(frozen=True)
class Explained:
    """A skip, whether it applied in any of the frames measured, and milliseconds of the parts of a frame's work that
    it shortens: as it is, and with the skip forced off; None where it does not apply."""

    skip: Skip
    applies: bool
    with_ms: float | None = None
    without_ms: float | None = None

    @property
    def saved_ms(self) -> float | None:
        """What the skip saves, where it applies."""
        return None if self.with_ms is None or self.without_ms is None else self.without_ms - self.with_ms


class Probe:
    """Some frames of a session, worked through again and again: milliseconds per frame of each part of the work."""

    def __init__(self, session: Session, off: tuple[str, ...] = ()) -> None:
        settings = replace(session.settings, no_skip=off, repeat=1)
        scene = upload_scene(session.device, session.scene.host, Skips(off))
        source = FrameSource(scene, session.path, session.head, settings, cached=False)
        self.session = replace(session, settings=settings, scene=scene, source=source, forward=ForwardRenderer(scene))
        self.metrics = Metrics.asked_for(session.device, settings.metrics, scene.skips)
        self.applied = scene.skips.always | self.metrics.skipped
        self.pipelines = [Pipeline(packer, scene, settings) for packer in find_methods(settings)]
        for pipeline in self.pipelines:
            for step in ended_steps(**_ended(pipeline)):
                pipeline.dead = (step["status"], step["reason"])
            if pipeline.dead:
                continue
            with self._guarded(pipeline, "preparing", PREPARE):
                reason = pipeline.packer.skip(scene.host)
                pipeline.dead = ("skipped", reason) if reason else None
                if not reason:
                    pipeline.prepare()

    def measure(self) -> dict[str, float]:
        """Device time of drawing the visible set and the reference and of packing, in all and by each method, and host
        time of metrics."""
        spent = dict.fromkeys((PICTURE, SET, PACKING, METRICS), 0.0)
        session, count = self.session, min(FRAMES, self.session.frames)
        for index in range(count):
            work = session.source.work(index)
            novel = draw_novel_view(
                session.scene, session.forward, self.metrics, work.frame, work.novel, session.settings.reference_eye
            )
            picture = session.device.upload(novel.rgb)
            start = time.perf_counter()
            self.metrics.reference(picture)
            self.metrics.compare(picture)
            spent[METRICS] += (time.perf_counter() - start) * 1000
            spent[SET] += work.pvs_ms
            spent[PICTURE] += novel.milliseconds
            self.applied |= work.skipped
            for pipeline in self.pipelines:
                if pipeline.dead:
                    continue
                with self._guarded(pipeline, f"frame {index}"):
                    packed = pipeline.pack(work.frame)
                    own = f"{PACKING} by {pipeline.method}"
                    spent[own] = spent.get(own, 0.0) + sum(packed.stages.values())
                    spent[PACKING] += sum(packed.stages.values())
                    self.applied |= packed.skipped
        return {part: milliseconds / count for part, milliseconds in spent.items()}

    @contextmanager
    def _guarded(self, pipeline: Pipeline, doing: str, packs: int = 1) -> Iterator[None]:
        """A packer that fails or takes longer than so many packings may is left out from here on."""
        timeout = self.session.settings.timeout
        limit = time_limit(
            packs * timeout, f"skips, {doing}", _ended(pipeline), who=pipeline.method, late=longer_than(timeout)
        )
        try:
            with limit:
                yield
        except BaseException as error:
            pipeline.dead = verdict_on(error)


def _ended(pipeline: Pipeline) -> dict[str, str]:
    """What is noted of a pipeline in whose step the process ends."""
    return {"skips_of": pipeline.method, "variant": pipeline.variant}


def explain(session: Session, progress: Callable[[str], None] = lambda text: None) -> list[Explained]:
    """Every skip that this session's methods know; those that apply are measured with and without, in turn."""
    base = Probe(session)
    progress("measuring everything as it is")
    base.measure()  # builds kernels, and says what applies
    found = []
    for skip in known_skips(find_methods(session.settings)):
        if skip.name not in base.applied:
            found.append(Explained(skip, False))
            continue
        progress(f"measuring without the skip {skip.name}")
        forced = Probe(session, (skip.name,))
        forced.measure()
        rounds = [(base.measure(), forced.measure()) for _ in range(ROUNDS)]
        if any(part not in run for runs in rounds for run in runs for part in skip.parts):
            found.append(Explained(skip, True))  # its method failed
            continue
        with_ms, without_ms = (
            median(sum(run[part] for part in skip.parts) for run in runs) for runs in zip(*rounds, strict=True)
        )
        found.append(Explained(skip, True, with_ms, without_ms))
    return found


def rows_of(explained: list[Explained]) -> list[dict[str, Any]]:
    """The rows of skips.csv."""
    return [
        {
            "skip": one.skip.name,
            "what": one.skip.what,
            "applies": int(one.applies),
            "reason": one.skip.unneeded if one.applies else one.skip.needed,
            "parts": ", ".join(one.skip.parts),
            "with_ms": one.with_ms,
            "without_ms": one.without_ms,
            "saved_ms": one.saved_ms,
        }
        for one in explained
    ]
