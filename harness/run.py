"""The run loop: every method through every frame, one committed transaction per method and frame."""

from __future__ import annotations

import itertools
import json
import os
import platform
import signal
import threading
import time
import traceback
import zlib
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager, suppress
from datetime import datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
import typer
from filelock import FileLock, Timeout
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from harness.as_published import note_as_published
from harness.console import InputError, make_console, show_summary, tell_passed_over
from harness.dump import dump_frame, dump_scene, folder_name, write_png
from harness.explain import explain, rows_of, show_explained
from harness.frames import Work
from harness.full_atlas import note_full_atlas
from harness.lane import Drawn, Filled, Lane, Measured, Packed, stopped_rows
from harness.machine import commit
from harness.metrics import Metrics
from harness.noise import noise_warnings
from harness.novel_view import NovelView, draw_novel_view
from harness.off_budget import note_off_budget
from harness.plan import check_folder, make_plan, remember_pace
from harness.rare import note_unseen
from harness.session import Session, find_methods, open_session
from harness.settings import Settings
from harness.skips import check_names, known_skips, skipped_stages
from harness.verification.truth import Truth
from harness.watchdog import PackTimeoutError, ended_steps, time_limit
from kernels.journal import journal
from packers.interface import NotShippedError
from reports import csv_files, html
from reports.labels import NOTES as LABELS
from reports.store import Store

RUNS = Path("runs")
WORKERS = 2  # threads for what only the host does
SERIAL = "BENCH_SERIAL"  # variable: one thread for that, so that a crash has one cause
TOGETHER = 4  # lanes that go through a frame together: that many payloads are in memory at a time
PREPARE = 10  # packings' time that preparing may take: charts of millions of triangles need minutes
PACKAGES = ("numpy", "pyopencl", "av", "trimesh", "OpenImageIO", "colour-science", "pymeshlab", "lz4")


def run(settings: Settings, out: Path | None, resume: Path | None = None, explained: bool = False) -> bool:
    """Run everything the settings ask for into `out` (a new folder below runs/ if None, or the unfinished run of the
    same plan there); returns whether every row is ok or skipped. resume: what `--out` of the running command names, if
    that is not `out`. explained: measure what every skip saves, too.

    Raises InputError, SettingsError, SceneError, PathError, DeviceError or StoreError for what cannot be used.
    """
    console = make_console(stderr=True)
    check_folder(out)
    console.print(f"[dim]Opening {settings.scene} ...[/]")
    lanes_of = find_methods(settings)
    check_names(settings.no_skip, lanes_of)
    session = open_session(settings)
    truth = Truth(session.scene, settings.seed)
    lanes = [Lane(packer, session.scene, settings, truth) for packer in lanes_of]
    plan = make_plan(session, lanes)
    folder = out or folder_for(plan, Path(settings.scene).stem)
    with locked(folder), Store(folder) as store:
        store.set_plan(plan)
        (folder / "run.json").write_text(
            json.dumps({"settings": settings.to_json(), "plan": plan, "device": session.device.description}, indent=2)
            + "\n",
            encoding="utf-8",
        )
        again = resume or folder
        journal().note(again=["--out", str(again)])
        tell_passed_over(session.device)
        console.print(f"Results go to [bold]{folder}[/]; the same command with --out {again} resumes.")
        if session.device.is_new:
            console.print(f"[dim]First run on {session.device.name}: its kernels are being built, up to a minute.[/]")
        with stops_kept(again), show_progress() as progress:
            write_notes(store, session)
            Run(session, lanes, store, folder).all_frames(progress)
            if explained:
                rows = _explain(session, store, progress)
        csv_files.write_all(folder)
        html.write_report(folder)
        show_summary(store, folder)
        if explained:
            show_explained(rows)
        return all(row["status"] in ("ok", "skipped") for row in store.rows())


def _explain(session: Session, store: Store, progress: Progress) -> list[dict[str, Any]]:
    """The rows of skips.csv, kept in the store's notes."""
    task = progress.add_task("skips", total=None)
    rows = rows_of(explain(session, lambda text: progress.update(task, description=text)))
    for row in rows:
        store.notes[f"saved/{row['skip']}"] = json.dumps(row)
    return rows


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
        self.spent: defaultdict[str, Counter[Lane]] = defaultdict(Counter)  # seconds of each lane by step, last frame

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
        task = progress.add_task("preparing", total=self.frames * len(self.lanes))
        for lane in self.lanes:
            self.store.notes[f"{LABELS}/{lane.method}[{lane.variant}]"] = lane.label
            self._announce(progress, task, f"preparing {lane.label}")
            self._prepare(lane, finished[lane.method, lane.variant])
        self._announce(progress, task, "warming up metrics")
        self._warm_up_metrics()
        self.session.device.remember_built()
        for index in range(self.frames):
            self._one_frame(index, done, finished, progress, task)
        note_unseen(self.store, (lane.packer for lane in self.lanes))
        note_off_budget(self.store)
        note_full_atlas(self.store)
        note_as_published(self.store, (lane.packer for lane in self.lanes))
        self.session.device.announce = lambda path: None
        progress.remove_task(task)
        self.session.device.remember_programs(repr(self.settings))
        remember_pace(self.session, (time.perf_counter() - started) / self.frames, len(self.lanes))

    def _announce(self, progress: Progress, task: Any, doing: str) -> None:
        """Show what is being done, and which kernels are compiled for it."""
        progress.update(task, description=doing)
        self.session.device.announce = lambda path: progress.update(task, description=f"{doing}: building {path}")

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
        self, index: int, done: set, finished: dict[tuple[str, str], int], progress: Progress, task: Any
    ) -> None:
        """One frame of every lane: replayed where it is committed, measured where it is not."""
        fresh = [lane for lane in self.lanes if (lane.method, lane.variant, index) not in done]
        alive = [lane for lane in self.lanes if not lane.dead]
        for lane in fresh:
            if lane.dead:
                self._commit_stopped(lane, index)
        unfinished = [lane for lane in alive if finished[lane.method, lane.variant] < self.frames]
        replayed = [lane for lane in unfinished if lane not in fresh]
        lanes = [lane for lane in fresh if not lane.dead]
        if not (replayed or lanes):
            progress.advance(task, len(alive))
            return
        progress.update(task, description=f"frame {index + 1}: visible set")
        with self._common_step(f"frame {index}: visible set"):
            work = self.session.source.work(index)
        for lane in replayed:
            self._announce(progress, task, f"frame {index + 1}: {lane.label}")
            doing = f"replaying frame {index}"
            with self._guarded(lane, doing), self._limited(lane, doing, PREPARE):
                lane.replay(work)
        progress.advance(task, len(alive) - len(lanes))
        with self._common_step(f"frame {index}: novel view"):
            novel = self._novel_view(work) if lanes else None
        for first in range(0, len(lanes), TOGETHER):
            some = lanes[first : first + TOGETHER]
            self._announce(progress, task, f"frame {index + 1}: {', '.join(lane.label for lane in some)}")
            self._measure(some, work, novel)
            progress.advance(task, len(some))

    def _novel_view(self, work: Work) -> NovelView:
        known = (self.session.scene, self.session.forward, self.metrics, work.frame, work.novel)
        novel = draw_novel_view(*known, self.settings.reference_eye)
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
                self._commit_stopped(lane, index)
            else:
                self._commit(lane, index, measured[lane])

    def _beside(self, step: str, lanes: Iterable[Lane], index: int, work: Callable[[Lane], Any]) -> dict[Lane, Any]:
        """What `work` gives for each lane, several at a time; lanes that fail are stopped and left out."""
        spent = self.spent[step]

        def timed(lane: Lane) -> Any:
            start = time.perf_counter()
            with self._limited(lane, f"{step} frame {index}", PREPARE):
                result = work(lane)
            spent[lane] = time.perf_counter() - start
            return result

        done = {}
        with ThreadPoolExecutor(self.workers) as pool:
            # What took longest in the last frame comes first, so that all threads end at about the same time.
            tasks = {lane: pool.submit(timed, lane) for lane in sorted(lanes, key=lambda lane: -spent[lane])}
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

    def _commit_stopped(self, lane: Lane, index: int) -> None:
        status, reason = lane.dead
        rows = [{**self.common, "frame": index, **row} for row in stopped_rows(lane.keys(), status, reason)]
        self.store.commit_frame(lane.method, lane.variant, index, rows)

    def _write_pictures(self, measured: dict[Lane, Measured], work: Work, novel: NovelView) -> None:
        """The pictures of a frame, and its dump."""
        index = work.frame.index
        groups = {lane: folder_name(lane.method, lane.variant) for lane in self.lanes}
        named = [(groups[lane], index, *shown) for lane, found in measured.items() for shown in found.pictures.items()]
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

    def _write_picture(self, group: str, index: int, name: str, rgb: Any) -> None:
        path = self.folder / "pictures" / group / f"frame_{index:04d}{name and '_'}{name}.png"
        path.parent.mkdir(parents=True, exist_ok=True)
        write_png(path, rgb)


def show_progress() -> Progress:
    """The progress bars of a run, on stderr."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(bar_width=20),
        MofNCompleteColumn(),
        TextColumn("left:"),
        TimeRemainingColumn(),
    )
    return Progress(*columns, console=make_console(stderr=True), transient=True)


def write_notes(store: Store, session: Session) -> None:
    """What a result must say about where it came from; warnings; what was skipped and why."""
    notes, scene = store.notes, session.scene.host
    notes.setdefault("environment/date", datetime.now().astimezone().isoformat(timespec="seconds"))
    notes.setdefault("environment/commit", commit())
    notes["environment/machine"] = f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores"
    notes["environment/triangles"] = f"{scene.triangle_count:,}"
    notes["environment/system"] = platform.platform()
    notes["environment/python"] = platform.python_version()
    for name in PACKAGES:
        with suppress(PackageNotFoundError):  # those of an extra need not be there
            notes[f"environment/{name}"] = version(name)
    for number, text in enumerate(session.device.passed_over):
        notes[f"warning/device{number:02d}"] = text
    for key, value in session.device.description.items():
        notes[f"device/{key}"] = value
    for number, text in enumerate([*scene.notes, *session.path.notes]):
        notes[f"scene/{number:02d}"] = text
    for number, text in enumerate(noise_warnings()):
        notes[f"warning/{number:02d}"] = text
    for name, reason in skipped_stages(scene.features, session.settings.no_skip).items():
        notes[f"skipped/{name}"] = reason
    for skip in known_skips(find_methods(session.settings)):
        notes[f"skip/{skip.name}"] = f"{skip.what}: {skip.unneeded}"


def folder_for(plan: dict[str, Any], name: str) -> Path:
    """The newest unfinished run of this plan below runs/, else a new folder there whose name ends in `name`."""
    for folder in sorted(RUNS.glob("*/"), reverse=True):
        if (folder / "results.sqlite").is_file() and not (folder / "report.html").is_file() and not in_use(folder):
            with Store(folder) as store:
                if store.plan() == json.loads(json.dumps(plan)):
                    return folder
    stem = datetime.now().strftime("%Y%m%d-%H%M%S") + "-" + name
    for number in itertools.count():
        folder = RUNS / (stem if number == 0 else f"{stem}-{number}")
        try:
            folder.mkdir(parents=True)
            return folder
        except FileExistsError:  # another run began in the same second
            continue
        except OSError as error:
            raise InputError(f"{folder} cannot be made ({error.strerror}): give --out.") from error
    raise AssertionError("the numbers do not end")


@contextmanager
def stops_kept(folder: Path) -> Iterator[None]:
    """Ctrl-C and SIGTERM end the run with a word about what is kept."""

    def stop(_signal: int, _frame: object) -> None:
        raise KeyboardInterrupt

    main = threading.current_thread() is threading.main_thread()
    before = signal.signal(signal.SIGTERM, stop) if main else None
    try:
        yield
    except KeyboardInterrupt:
        console = make_console(stderr=True)
        console.print(f"Stopped. Finished frames are kept: the same command with --out {folder} goes on.")
        raise typer.Exit(130) from None
    finally:
        if main:
            signal.signal(signal.SIGTERM, before)


def in_use(folder: Path) -> bool:
    """Whether another process works in this folder."""
    try:
        with FileLock(folder / ".lock", timeout=0):
            return False
    except (Timeout, OSError):
        return True


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep two processes from writing one run; the lock ends with the process, however that ends.

    Raises InputError if another process has it, or if the folder cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with FileLock(folder / ".lock", timeout=0):
            yield
    except Timeout:
        raise InputError(f"{folder} is in use by another bench run: wait for it, or give another --out.") from None
    except OSError as error:
        raise InputError(f"{folder} cannot be written ({error.strerror}): give another --out.") from error
