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
from shading_atlas_bench.harness.measure.dump import dump_frame, dump_scene, write_png
from shading_atlas_bench.harness.measure.lane import Drawn, Filled, Lane, Measured, Packed, stopped_rows
from shading_atlas_bench.harness.measure.metrics import Metrics
from shading_atlas_bench.harness.measure.novel_view import NovelView, draw_novel_view
from shading_atlas_bench.harness.plugins import folder_name
from shading_atlas_bench.harness.progress import Progress, Task
from shading_atlas_bench.harness.run.as_published import note_as_published
from shading_atlas_bench.harness.run.full_atlas import note_full_atlas
from shading_atlas_bench.harness.run.off_budget import note_off_budget
from shading_atlas_bench.harness.run.plan import remember_pace
from shading_atlas_bench.harness.run.rare import note_unseen
from shading_atlas_bench.harness.watch.watchdog import PackTimeoutError, ended_steps, time_limit
from shading_atlas_bench.harness.workload.frames import Work
from shading_atlas_bench.harness.workload.session import Session
from shading_atlas_bench.kernels.journal import journal
from shading_atlas_bench.packers.interface import NotShippedError
from shading_atlas_bench.reports.store import csv_files
from shading_atlas_bench.reports.store.labels import NOTES as LABELS
from shading_atlas_bench.reports.store.results import Store

T = TypeVar("T")

WORKERS = 2  # threads for what only the host does
SERIAL = "BENCH_SERIAL"  # variable: one thread for that, so that a crash has one cause
TOGETHER = 4  # lanes that go through a frame together: that many payloads are in memory at a time
PREPARE = 10  # packings' time that preparing may take: charts of millions of triangles need minutes


class Run:
    """One run on its way: what it works with, and where its results go."""

    def __init__(
        self, session: Session, lanes: list[Lane], store: Store, folder: Path, *, pictures: bool = True
    ) -> None:
        self.session, self.lanes, self.store, self.folder = session, lanes, store, folder
        self.settings, self.frames = session.settings, session.frames
        self.metrics = Metrics.asked_for(session.device, session.settings.metrics, session.scene.skips)
        self.pictured = {0, self.frames // 2, self.frames - 1} if pictures else set()
        self.common = self._common_columns()
        self.workers = 1 if os.environ.get(SERIAL) else WORKERS
        # Clients must be alone with their payload in every frame: one that follows from the run is tried beforehand.
        known = f"{session.scene.host.content_hash} {session.path_hash}"
        self.tried = 1 + zlib.crc32(known.encode()) % (self.frames - 1) if self.frames > 1 else 0
        self.spent: dict[str, dict[Lane, float]] = {}  # seconds of each lane by step, last frame

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
        """Prepare the lanes, then work through the frames; what is finished already is replayed where it must be."""
        done = self.store.finished()
        finished = self._finished_before(done)
        started = time.perf_counter()
        with progress.task("preparing", self.frames * len(self.lanes)) as task:
            self._prepare_all(finished, task)
            for index in range(self.frames):
                self._one_frame(index, done, finished, task)
            self.session.device.announce = lambda stage: None
        note_unseen(self.store, (lane.packer for lane in self.lanes))
        note_off_budget(self.store)
        note_full_atlas(self.store)
        note_as_published(self.store, (lane.packer for lane in self.lanes))
        self.session.device.remember_programs(repr(self.settings))
        remember_pace(self.session, (time.perf_counter() - started) / self.frames, len(self.lanes))

    def _prepare_all(self, finished: dict[tuple[str, str], int], task: Task) -> None:
        """Prepare every lane, and have all kernels built that frames need."""
        for lane in self.lanes:
            self.store.notes[f"{LABELS}/{lane.method}[{lane.variant}]"] = lane.label
            self._announce(task, f"preparing {lane.label}")
            self._prepare(lane, finished[lane.method, lane.variant])
        self._announce(task, "warming up metrics")
        self._warm_up_metrics()
        self.session.device.remember_built()

    def _announce(self, task: Task, doing: str) -> None:
        """Tell what is being done, and which kernels are compiled for it."""
        task.doing(doing)
        self.session.device.announce = lambda stage: task.doing(f"{doing}: building {stage}")

    def _finished_before(self, done: set[tuple[str, str, int]]) -> dict[tuple[str, str], int]:
        """How many leading frames of each lane are committed; lanes that stopped in an earlier run stay stopped."""
        counts = {}
        stopped = {
            (row["method"], row["variant"]): (row["status"], row["reason"])
            for row in self.store.rows()
            if row["status"] in ("failed", "timeout", "skipped")
        }
        for lane in self.lanes:
            key = (lane.method, lane.variant)
            counts[key] = sum((*key, index) in done for index in range(self.frames))
            lane.dead = stopped.get(key)
            for step in ended_steps(folder=str(self.folder), method=lane.method, variant=lane.variant):
                lane.dead = lane.dead or (step["status"], step["reason"])
        return counts

    def _prepare(self, lane: Lane, finished: int) -> None:
        """Prepare a lane that has frames left, and warm its kernels up."""
        if lane.dead or finished == self.frames:
            return
        reason = lane.packer.skip(self.session.scene.host)
        if reason:
            lane.dead = ("skipped", reason)
            return
        with self._guarded(lane, "preparing"), self._limited(lane, "preparing", PREPARE):
            self.store.notes[f"prepare_ms/{lane.method}[{lane.variant}]"] = f"{lane.prepare():.1f}"
        if not lane.dead:
            with self._guarded(lane, "warming up"), self._limited(lane, "warming up", packs=3):
                lane.warm_up(self.session.source.work, self.tried)

    def _warm_up_metrics(self) -> None:
        """Build and run the kernels of all metrics once."""
        picture = self.session.device.zeros((self.settings.height, self.settings.width, 4), np.uint8)
        self.metrics.reference(picture)
        self.metrics.compare(picture)

    def _limited(self, lane: Lane, doing: str, packs: int) -> AbstractContextManager[None]:
        """The time limit of so many packings; should the process end in it, the next one does without the lane."""
        ended = {"folder": str(self.folder), "method": lane.method, "variant": lane.variant}
        return time_limit(packs * self.settings.timeout, f"{doing}: {lane.method}", ended)

    def _common_step(self, doing: str) -> AbstractContextManager[None]:
        """A step for all lanes, which may take long, but not for ever."""
        return journal().step(doing, PREPARE * self.settings.timeout)

    def _one_frame(
        self, index: int, done: set[tuple[str, str, int]], finished: dict[tuple[str, str], int], task: Task
    ) -> None:
        """One frame of every lane: replayed where it is committed, measured where it is not."""
        fresh = [lane for lane in self.lanes if (lane.method, lane.variant, index) not in done]
        alive = [lane for lane in self.lanes if not lane.dead]
        for lane in fresh:
            if lane.dead:
                self._commit_stopped(lane, index, *lane.dead)
        unfinished = [lane for lane in alive if finished[lane.method, lane.variant] < self.frames]
        replayed = [lane for lane in unfinished if lane not in fresh]
        lanes = [lane for lane in fresh if not lane.dead]
        if not (replayed or lanes):
            task.advance(len(alive))
            return
        task.doing(f"frame {index + 1}: visible set")
        with self._common_step(f"frame {index}: visible set"):
            work = self.session.source.work(index)
        for lane in replayed:
            self._announce(task, f"frame {index + 1}: {lane.label}")
            doing = f"replaying frame {index}"
            with self._guarded(lane, doing), self._limited(lane, doing, PREPARE):
                lane.replay(work)
        task.advance(len(alive) - len(lanes))
        if not lanes:
            return
        with self._common_step(f"frame {index}: novel view"):
            novel = self._novel_view(work)
        for first in range(0, len(lanes), TOGETHER):
            some = lanes[first : first + TOGETHER]
            self._announce(task, f"frame {index + 1}: {', '.join(lane.label for lane in some)}")
            self._measure(some, work, novel)
            task.advance(len(some))

    def _novel_view(self, work: Work) -> NovelView:
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

    def _measure(self, lanes: list[Lane], work: Work, novel: NovelView) -> None:
        """One frame of some lanes. What the device's time is taken of runs alone; the rest runs beside each other."""
        index = work.frame.index
        packed: dict[Lane, Packed] = {}
        filled: dict[Lane, Filled] = {}
        drawn: dict[Lane, Drawn] = {}
        pictured = index in self.pictured
        for lane in lanes:
            doing = f"frame {index}"
            with self._guarded(lane, doing), self._limited(lane, doing, packs=1 + len(lane.repeated)):
                packed[lane] = lane.pack(work.frame)
                filled[lane] = lane.fill(packed[lane].payload)
        sent = self._beside("sending", filled, index, lambda lane: lane.advance(packed[lane].payload, filled[lane]))
        for lane in sent:
            doing = f"drawing frame {index}"
            with self._guarded(lane, doing), self._limited(lane, doing, PREPARE):
                drawn[lane] = lane.draw(sent[lane], novel, self.metrics, pictured)
        measured = self._beside(
            "measuring",
            drawn,
            index,
            lambda lane: lane.measure(work, novel, packed[lane], filled[lane], sent[lane], drawn[lane], pictured),
        )
        # Pictures first: a frame that is committed is never worked on again.
        self._write_pictures(measured, work, novel)
        for lane in lanes:
            if lane.dead:
                self._commit_stopped(lane, index, *lane.dead)
            else:
                self._commit(lane, index, measured[lane])

    def _beside(self, step: str, lanes: Iterable[Lane], index: int, work: Callable[[Lane], T]) -> dict[Lane, T]:
        """What `work` gives for each lane, several at a time; lanes that fail are stopped and left out."""
        spent = self.spent.setdefault(step, {})

        def timed(lane: Lane) -> T:
            start = time.perf_counter()
            with self._limited(lane, f"{step} frame {index}", PREPARE):
                result = work(lane)
            spent[lane] = time.perf_counter() - start
            return result

        done = {}
        with ThreadPoolExecutor(self.workers) as pool:
            # What took longest in the last frame comes first, so that all threads end at about the same time.
            tasks = {lane: pool.submit(timed, lane) for lane in sorted(lanes, key=lambda lane: -spent.get(lane, 0.0))}
            for lane in lanes:
                with self._guarded(lane, f"frame {index}"):
                    done[lane] = tasks[lane].result()
        return done

    def _commit(self, lane: Lane, index: int, measured: Measured) -> None:
        self.store.commit_frame(
            lane.method,
            lane.variant,
            index,
            [{**self.common, "frame": index, **row} for row in measured.rows],
            measured.stages,
            measured.statistics,
            measured.repeats,
        )

    @contextmanager
    def _guarded(self, lane: Lane, doing: str) -> Iterator[None]:
        """A packer that fails stops its own lane, never the run."""
        try:
            yield
        except PackTimeoutError:
            lane.dead = ("timeout", f"{doing}: it took longer than --timeout {self.settings.timeout:g} allows.")
        except NotShippedError as error:
            lane.dead = ("invalid", f"{doing}: {error}")
        except (Exception, SystemExit) as error:  # whatever a method does, the others go on, and its rows say what
            place = traceback.extract_tb(error.__traceback__)[-1]
            where = f"{Path(place.filename).name}, line {place.lineno}"
            lane.dead = ("failed", f"{doing}: {type(error).__name__}: {error} ({where})")
            self.store.notes[f"traceback/{lane.method}[{lane.variant}]"] = traceback.format_exc()

    def _commit_stopped(self, lane: Lane, index: int, status: str, reason: str) -> None:
        rows = [{**self.common, "frame": index, **row} for row in stopped_rows(lane.keys(), status, reason)]
        self.store.commit_frame(lane.method, lane.variant, index, rows)

    def _write_pictures(self, measured: dict[Lane, Measured], work: Work, novel: NovelView) -> None:
        """The pictures of a frame, and its dump."""
        index = work.frame.index
        groups = {lane: folder_name(lane.method, lane.variant) for lane in self.lanes}
        named = [
            (groups[lane], index, name, rgb) for lane, found in measured.items() for name, rgb in found.pictures.items()
        ]
        with ThreadPoolExecutor(WORKERS) as pool:
            for _ in pool.map(lambda picture: self._write_picture(*picture), named):
                pass
        if named:
            known = {group: {"method": lane.method, "variant": lane.variant} for lane, group in groups.items()}
            csv_files.replace_file(self.folder / "pictures" / "pictures.json", json.dumps(known, indent=2))
        if self.settings.dump:
            for lane, found in measured.items():
                self._dump(lane, work, novel, found)

    def _dump(self, lane: Lane, work: Work, novel: NovelView, measured: Measured) -> None:
        dump_scene(self.folder / "dump", self.session.scene.host)
        dump_frame(
            self.folder / "dump",
            lane.method,
            lane.variant,
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
        path.parent.mkdir(parents=True, exist_ok=True)
        write_png(path, rgb)
