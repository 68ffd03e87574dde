"""The run loop: every method through every frame, one committed transaction per method and frame."""

from __future__ import annotations

import json
import os
import time
import traceback
import zlib
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Bytes
from shading_atlas_bench.harness.errors import InputError
from shading_atlas_bench.harness.measure.dump import dump_frame, dump_scene, write_png
from shading_atlas_bench.harness.measure.metrics import Metrics
from shading_atlas_bench.harness.measure.noise import OthersWatch
from shading_atlas_bench.harness.measure.novel_view import NovelView, draw_novel_view
from shading_atlas_bench.harness.measure.pipeline import (
    LOSSLESS,
    Drawn,
    Filled,
    Measured,
    Packed,
    Pipeline,
    stopped_rows,
)
from shading_atlas_bench.harness.measure.returned import ReturnedError, verdict_on
from shading_atlas_bench.harness.measure.verification.shared_arrays import SharedArrays
from shading_atlas_bench.harness.progress import Progress, Task
from shading_atlas_bench.harness.run.as_published import note_as_published
from shading_atlas_bench.harness.run.disturbed import note_disturbed
from shading_atlas_bench.harness.run.full_atlas import note_full_atlas
from shading_atlas_bench.harness.run.memory import AT_ONCE
from shading_atlas_bench.harness.run.off_budget import note_off_budget
from shading_atlas_bench.harness.run.plan import remember_pace
from shading_atlas_bench.harness.run.rare import note_unseen
from shading_atlas_bench.harness.watch.watchdog import ended_steps, longer_than, time_limit
from shading_atlas_bench.harness.workload.frames import FrameWorkload
from shading_atlas_bench.harness.workload.session import Session
from shading_atlas_bench.kernels.journal import journal
from shading_atlas_bench.reports.store import csv_files
from shading_atlas_bench.reports.store.database import StoreFileError
from shading_atlas_bench.reports.store.disturbance import OTHERS
from shading_atlas_bench.reports.store.labels import NOTES as LABELS
from shading_atlas_bench.reports.store.names import folder_name
from shading_atlas_bench.reports.store.results import Store

T = TypeVar("T")

WORKERS = 2  # threads for what only the host does
SERIAL = "BENCH_SERIAL"  # variable: one thread for that, so that a crash has one cause
LONGEST_TRACEBACK = 100_000  # letters: what a method says in it may have any length
PREPARE = 10  # packings' time that preparing may take: charts of millions of triangles need minutes


class Run:
    """One run on its way: what it works with, and where its results go."""

    def __init__(
        self,
        session: Session,
        pipelines: list[Pipeline],
        store: Store,
        folder: Path,
        *,
        pictures: bool = True,
        at_once: int = AT_ONCE,
    ) -> None:
        self.at_once = at_once  # pipelines that go through a frame together
        self.session, self.pipelines, self.store, self.folder = session, pipelines, store, folder
        self.settings, self.frames = session.settings, session.frames
        self.metrics = Metrics.asked_for(session.device, session.settings.metrics, session.scene.skips)
        self.pictured = {0, self.frames // 2, self.frames - 1} if pictures else set()
        self.common = self._common_columns()
        self.shared = SharedArrays(session.scene)
        self.workers = 1 if os.environ.get(SERIAL) else WORKERS
        # Clients must be alone with their payload in every frame: one that follows from the run is tried beforehand.
        known = f"{session.scene.host.content_hash} {session.path_hash}"
        self.tried = 1 + zlib.crc32(known.encode()) % (self.frames - 1) if self.frames > 1 else 0
        self.others = OthersWatch()
        self.spent: dict[str, dict[Pipeline, float]] = {}  # seconds of each pipeline by step, last frame

    def _common_columns(self) -> dict[str, Any]:
        """The columns that are the same in every row."""
        s, scene, path = self.settings, self.session.scene.host, self.session.path
        return {
            "scene": scene.name,
            "scene_hash": scene.content_hash,
            "path": path.name,
            "path_hash": self.session.path_hash,
            "frame_rate": self.session.frame_rate,
            "width": s.width,
            "height": s.height,
            "fov": s.fov,
            "cell_radius": s.cell_radius,
            "cell_fov": s.cell_fov,
            "latency": s.latency,
            "reference_eye": s.reference_eye,
            "bandwidth": s.bandwidth,
            "device": self.session.device.name,
            "seed": s.seed,
        }

    def all_frames(self, progress: Progress) -> None:
        """Prepare the pipelines, then work through the frames; what is finished is replayed where it must be."""
        done = self.store.finished()
        self.committed = {(row["method"], row["variant"], row["frame"]): row for row in self._rows_without_codec()}
        finished = self._finished_before(done)
        started = time.perf_counter()
        with progress.task("preparing", self.frames * len(self.pipelines)) as task:
            self._prepare_all(finished, task)
            self.others.look()
            for index in range(self.frames):
                self._one_frame(index, done, finished, task)
            self.session.device.announce = lambda stage: None
        costs = {pipeline.packer: pipeline.rare_costs for pipeline in self.pipelines if pipeline.rare_costs}
        note_unseen(self.store, costs)
        note_off_budget(self.store)
        note_full_atlas(self.store)
        note_disturbed(self.store)
        note_as_published(self.store, [pipeline.packer for pipeline in self.pipelines])
        self.session.device.remember_built()
        remember_pace(self.session, (time.perf_counter() - started) / self.frames, len(self.pipelines))

    def _prepare_all(self, finished: dict[tuple[str, str], int], task: Task) -> None:
        """Prepare every pipeline, and have all kernels built that frames need."""
        for pipeline in self.pipelines:
            self.store.notes[f"{LABELS}/{pipeline.method}[{pipeline.variant}]"] = pipeline.label
            self._announce(task, f"preparing {pipeline.label}")
            self._prepare(pipeline, finished[pipeline.method, pipeline.variant])
            self._check_shared([pipeline])
        self._announce(task, "warming up metrics")
        self._warm_up_metrics()
        self.session.device.remember_built()

    def _announce(self, task: Task, doing: str) -> None:
        """Tell what is being done, and which kernels are compiled for it."""
        task.doing(doing)
        self.session.device.announce = lambda stage: task.doing(f"{doing}: building {stage}")

    def _rows_without_codec(self) -> list[dict[str, Any]]:
        return [row for row in self.store.rows() if (row["codec"], row["crf"]) == LOSSLESS]

    def _finished_before(self, done: set[tuple[str, str, int]]) -> dict[tuple[str, str], int]:
        """How many leading frames of each pipeline are committed; those that stopped in an earlier run stay stopped."""
        counts = {}
        stopped = {
            (row["method"], row["variant"]): (row["status"], row["reason"])
            for row in self.store.rows()
            if row["status"] in ("failed", "timeout", "skipped")
        }
        for pipeline in self.pipelines:
            key = (pipeline.method, pipeline.variant)
            counts[key] = sum((*key, index) in done for index in range(self.frames))
            pipeline.dead = pipeline.dead or stopped.get(key)
            for step in ended_steps(folder=str(self.folder), method=pipeline.method, variant=pipeline.variant):
                pipeline.dead = pipeline.dead or (step["status"], step["reason"])
        return counts

    def _prepare(self, pipeline: Pipeline, finished: int) -> None:
        """Prepare a pipeline that has frames left, and warm its kernels up."""
        if pipeline.dead:
            return
        with self._guarded(pipeline, "preparing"), self._limited(pipeline, "preparing", packs=1):
            pipeline.rare_costs = pipeline.packer.rare_costs()
            if finished == self.frames:
                return
            if reason := pipeline.packer.skip(self.session.scene.host):
                pipeline.dead = ("skipped", reason)
        if pipeline.dead:
            return
        with self._guarded(pipeline, "preparing"), self._limited(pipeline, "preparing", PREPARE):
            self.store.notes[f"prepare_ms/{pipeline.method}[{pipeline.variant}]"] = f"{pipeline.prepare():.1f}"
        if not pipeline.dead:
            with self._guarded(pipeline, "warming up"), self._limited(pipeline, "warming up", packs=3):
                pipeline.warm_up(self.session.source.work, self.tried)

    def _warm_up_metrics(self) -> None:
        """Build and run the kernels of all metrics once."""
        picture = self.session.device.zeros((self.settings.height, self.settings.width, 4), np.uint8)
        self.metrics.reference(picture)
        self.metrics.compare(picture)

    def _limited(self, pipeline: Pipeline, doing: str, packs: int) -> AbstractContextManager[None]:
        """The time limit of so many packings; should the process end in it, the next one does without the pipeline."""
        ended = {"folder": str(self.folder), "method": pipeline.method, "variant": pipeline.variant}
        timeout = self.settings.timeout
        return time_limit(packs * timeout, doing, ended, who=pipeline.method, late=longer_than(timeout))

    def _common_step(self, doing: str) -> AbstractContextManager[None]:
        """A step for all pipelines, which may take long, but not for ever."""
        return journal().step(doing, PREPARE * self.settings.timeout)

    def _one_frame(
        self, index: int, done: set[tuple[str, str, int]], finished: dict[tuple[str, str], int], task: Task
    ) -> None:
        """One frame of every pipeline: replayed where it is committed, measured where it is not."""
        fresh = [pipeline for pipeline in self.pipelines if (pipeline.method, pipeline.variant, index) not in done]
        alive = [pipeline for pipeline in self.pipelines if not pipeline.dead]
        for pipeline in fresh:
            if pipeline.dead:
                self._commit_stopped(pipeline, index, *pipeline.dead)
        unfinished = [pipeline for pipeline in alive if finished[pipeline.method, pipeline.variant] < self.frames]
        replayed = [pipeline for pipeline in unfinished if pipeline not in fresh]
        pipelines = [pipeline for pipeline in fresh if not pipeline.dead]
        if not (replayed or pipelines):
            task.advance(len(alive))
            return
        task.doing(f"frame {index + 1}: visible set")
        with self._common_step(f"frame {index}: visible set"):
            work = self.session.source.work(index)
        for pipeline in replayed:
            self._announce(task, f"frame {index + 1}: {pipeline.label}")
            doing = f"replaying frame {index}"
            with self._guarded(pipeline, doing), self._limited(pipeline, doing, PREPARE):
                self._check_replayed(pipeline, index, pipeline.replay(work))
        task.advance(len(alive) - len(pipelines))
        if not pipelines:
            return
        with self._common_step(f"frame {index}: novel view"):
            novel = self._novel_view(work)
        for first in range(0, len(pipelines), self.at_once):
            some = pipelines[first : first + self.at_once]
            self._announce(task, f"frame {index + 1}: {', '.join(pipeline.label for pipeline in some)}")
            self._measure(some, work, novel)
            task.advance(len(some))

    def _check_replayed(self, pipeline: Pipeline, index: int, found: dict[str, Any]) -> None:
        """Raise ReturnedError unless a finished frame is what it was: those after it depend on it."""
        before = self.committed[pipeline.method, pipeline.variant, index]
        differing = [
            f"{name} was {before[name]} and is {value}" for name, value in found.items() if value != before[name]
        ]
        if differing:
            raise ReturnedError(
                f"it is not the frame that it was before the run was interrupted ({', '.join(differing)}): given the "
                "same work, a method must do the same, so that a run can go on."
            )

    def _novel_view(self, work: FrameWorkload) -> NovelView:
        novel = draw_novel_view(
            self.session.scene,
            self.session.forward,
            self.metrics,
            work.frame,
            work.novel,
            self.settings.reference_eye,
        )
        if work.frame.index in self.pictured:
            self._write_picture("reference", work.frame.index, "", novel.rgb[..., :3])
        return novel

    def _measure(self, pipelines: list[Pipeline], work: FrameWorkload, novel: NovelView) -> None:
        """One frame of some pipelines. What the device's time is taken of runs alone; the rest runs in threads."""
        index = work.frame.index
        packed: dict[Pipeline, Packed] = {}
        filled: dict[Pipeline, Filled] = {}
        drawn: dict[Pipeline, Drawn] = {}
        pictured = index in self.pictured
        for pipeline in pipelines:
            doing = f"frame {index}"
            with self._guarded(pipeline, doing), self._limited(pipeline, doing, packs=self.settings.repeat):
                packed[pipeline] = pipeline.pack(work.frame)
                filled[pipeline] = pipeline.fill(packed[pipeline].payload)
        last = index == self.frames - 1
        sent = self._in_threads(
            "sending",
            filled,
            index,
            lambda pipeline: pipeline.advance(packed[pipeline].payload, filled[pipeline], last=last),
        )
        for pipeline in sent:
            filled[pipeline].filled.clear()  # they are encoded: nobody else reads them
            doing = f"drawing frame {index}"
            with self._guarded(pipeline, doing), self._limited(pipeline, doing, PREPARE):
                drawn[pipeline] = pipeline.draw(sent[pipeline], novel, self.metrics, pictured)
        measured = self._in_threads(
            "measuring",
            drawn,
            index,
            lambda pipeline: pipeline.measure(
                work, novel, packed[pipeline], filled[pipeline], sent[pipeline], drawn[pipeline], pictured
            ),
        )
        self._check_shared(pipelines)
        others = self.others.look()
        # Pictures first: a frame that is committed is never worked on again.
        self._write_pictures(measured, work, novel)
        for pipeline in pipelines:
            if pipeline.dead:
                self._commit_stopped(pipeline, index, *pipeline.dead)
            else:
                measured[pipeline].statistics[OTHERS] = others
                self._commit(pipeline, index, measured[pipeline])

    def _check_shared(self, pipelines: list[Pipeline]) -> None:
        """Raise InputError if one of these methods, which came last, wrote to what all methods read: nothing that is
        measured from then on is true."""
        if changed := self.shared.changed():
            methods = " or ".join(dict.fromkeys(pipeline.method for pipeline in pipelines))
            raise InputError(
                f"{methods} wrote to {', '.join(changed)}, which all methods read: run again without it. What was "
                "measured before is kept."
            )

    def _in_threads(
        self, step: str, pipelines: Iterable[Pipeline], index: int, work: Callable[[Pipeline], T]
    ) -> dict[Pipeline, T]:
        """What `work` gives for each pipeline, several at a time; pipelines that fail are stopped and left out."""
        spent = self.spent.setdefault(step, {})

        def timed(pipeline: Pipeline) -> T:
            start = time.perf_counter()
            with self._limited(pipeline, f"{step} frame {index}", PREPARE):
                result = work(pipeline)
            spent[pipeline] = time.perf_counter() - start
            return result

        done = {}
        with ThreadPoolExecutor(self.workers) as pool:
            # What took longest in the last frame comes first, so that all threads end at about the same time.
            tasks = {
                pipeline: pool.submit(timed, pipeline)
                for pipeline in sorted(pipelines, key=lambda pipeline: -spent.get(pipeline, 0.0))
            }
            for pipeline in pipelines:
                with self._guarded(pipeline, f"frame {index}"):
                    done[pipeline] = tasks[pipeline].result()
        return done

    def _commit(self, pipeline: Pipeline, index: int, measured: Measured) -> None:
        self.store.commit_frame(
            pipeline.method,
            pipeline.variant,
            index,
            [{**self.common, "frame": index, **row} for row in measured.rows],
            measured.stages,
            measured.statistics,
            measured.repeats,
        )

    @contextmanager
    def _guarded(self, pipeline: Pipeline, doing: str) -> Iterator[None]:
        """A packer that fails stops its own pipeline, never the run, whatever it raises."""
        try:
            yield
        except StoreFileError:  # of no method: the disk is full, or the folder was deleted
            raise
        except BaseException as error:
            status, reason = verdict_on(error)
            pipeline.dead = (status, f"{doing}: {reason}")
            if status == "failed":
                lines = "".join(traceback.format_exception(error))
                key = f"traceback/{pipeline.method}[{pipeline.variant}]"
                self.store.notes[key] = lines[:LONGEST_TRACEBACK].encode(errors="backslashreplace").decode()

    def _commit_stopped(self, pipeline: Pipeline, index: int, status: str, reason: str) -> None:
        rows = [{**self.common, "frame": index, **row} for row in stopped_rows(pipeline.keys(), status, reason)]
        self.store.commit_frame(pipeline.method, pipeline.variant, index, rows)

    def _write_pictures(self, measured: dict[Pipeline, Measured], work: FrameWorkload, novel: NovelView) -> None:
        """The pictures of a frame, and its dump. What methods gave for them was checked when they gave it: what fails
        here is no method's fault."""
        index = work.frame.index
        groups = {pipeline: folder_name(pipeline.method, pipeline.variant) for pipeline in self.pipelines}
        named = [
            (groups[pipeline], index, name, rgb)
            for pipeline, found in measured.items()
            for name, rgb in found.pictures.items()
        ]
        with ThreadPoolExecutor(WORKERS) as pool:
            for _ in pool.map(lambda picture: self._write_picture(*picture), named):
                pass
        if named:
            known = {
                group: {"method": pipeline.method, "variant": pipeline.variant} for pipeline, group in groups.items()
            }
            csv_files.replace_file(self.folder / "pictures" / "pictures.json", json.dumps(known, indent=2))
        if self.settings.dump:
            with csv_files.written(self.folder / "dump"):
                for pipeline, found in measured.items():
                    self._dump(pipeline, work, novel, found)

    def _dump(self, pipeline: Pipeline, work: FrameWorkload, novel: NovelView, measured: Measured) -> None:
        dump_scene(self.folder / "dump", self.session.scene.host)
        dump_frame(
            self.folder / "dump",
            pipeline.method,
            pipeline.variant,
            work.frame.index,
            atlas=measured.plane,
            alpha=measured.alpha,
            owners=measured.owners,
            client=measured.lossless,
            reference=novel.rgb,
            visibility=novel.visibility,
            novel=novel.view,
            details=measured.details,
        )

    def _write_picture(self, group: str, index: int, name: str, rgb: Bytes) -> None:
        path = self.folder / "pictures" / group / f"frame_{index:04d}{name and '_'}{name}.png"
        with csv_files.written(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            write_png(path, rgb)
