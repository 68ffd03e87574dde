"""Timing the cells of a sweep again and again, until the interval of the median is narrow enough."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import median

from shading_atlas_bench.harness.measure.pipeline import Pipeline
from shading_atlas_bench.harness.measure.returned import verdict_on
from shading_atlas_bench.harness.sweep.grid import SweepCell
from shading_atlas_bench.harness.watch.watchdog import ended_steps, longer_than, time_limit
from shading_atlas_bench.harness.workload.session import Session
from shading_atlas_bench.reports.analysis.sweep import passes
from shading_atlas_bench.reports.store.columns import MEASURED_STATUSES
from shading_atlas_bench.reports.store.csv_files import median_interval
from shading_atlas_bench.reports.store.results import Store

PREPARE = 10  # packings' time that preparing may take, as in a run


@dataclass(frozen=True)
class StopRule:
    """When a cell has been timed enough.

    precision: width of the 95 % interval of the median over the median. repetitions: most passes through the frames.
    budget: seconds of preparing and packing per cell, the first pass not counted.
    """

    precision: float = 0.05
    repetitions: int = 15
    budget: float = 30.0

    def stop(self, times: Sequence[float], spent: float) -> str | None:
        """Why no further pass is needed after passes of these milliseconds and `spent` seconds; None to go on."""
        low, high = median_interval(sorted(times))
        if low is not None and high is not None and high - low <= self.precision * median(times):
            return "precise"
        if len(times) >= self.repetitions:
            return "repetitions"
        return "budget" if spent >= self.budget else None


def note_of(cell: SweepCell) -> str:
    """The note that holds why a cell's timing stopped."""
    method, variant = cell.key
    return f"stop/{method}[{variant}]"


@dataclass
class Timed:
    """What is known of a cell's time: milliseconds of each pass, and seconds spent on those after the first."""

    cell: SweepCell
    folder: Path
    times: list[float]
    spent: float

    @classmethod
    def read(cls, cell: SweepCell, folder: Path) -> Timed | None:
        """As far as an earlier process came; None for a cell without times, or whose timing failed."""
        with Store(folder, must_exist=True) as store:
            rows = [row for row in store.rows() if (row["method"], row["variant"]) == cell.key]
            repeats = [row for row in store.repeats() if (row["method"], row["variant"]) == cell.key]
            noted = store.notes.get(note_of(cell), "")
        first = {row["frame"]: row["server_ms"] for row in rows if row["status"] in MEASURED_STATUSES}
        if len(first) < cell.settings.frames or noted.startswith(("failed", "timeout")):
            return None
        spent = sum(row["ms"] for row in repeats if row["stage"].startswith("wall/")) / 1000
        return cls(cell, folder, passes(first, repeats), spent)

    def goes_on(self, rule: StopRule) -> bool:
        """Whether the rule asks for another pass; otherwise the reason is noted."""
        reason = rule.stop(self.times, self.spent)
        if reason:
            self._note(reason)
        return reason is None

    def again(self, session: Session, warm: bool) -> bool:
        """One more pass; False, with the reason noted, if it fails, or if an earlier process ended in it.

        warm: whether this process ran the cell's kernels already.
        """
        ended = {"folder": str(self.folder), "timing": note_of(self.cell)}
        for step in ended_steps(**ended):
            self._note(f"{step['status']}: {step['reason']}")
            return False
        try:
            entries = _one_pass(self.cell, session, warm, ended)
        except BaseException as error:  # whatever a method does, the other cells go on
            status, reason = verdict_on(error)
            self._note(f"{'timeout' if status == 'timeout' else 'failed'}: {reason}")
            return False
        with Store(self.folder) as store:
            store.add_repetition(*self.cell.key, len(self.times), entries)
        rows = [{"repetition": 1, "frame": frame, "stage": stage, "ms": ms} for frame, stage, ms in entries]
        self.times += passes({}, rows)
        self.spent += sum(ms for _, stage, ms in entries if stage.startswith("wall/")) / 1000
        return True

    def _note(self, reason: str) -> None:
        with Store(self.folder) as store:
            store.notes[note_of(self.cell)] = reason


def _one_pass(cell: SweepCell, session: Session, warm: bool, ended: dict[str, str]) -> list[tuple[int, str, float]]:
    """(frame, stage, milliseconds) of packing all frames with a packer of no past; host times are under `wall/`."""
    timeout = session.settings.timeout
    limited = partial(time_limit, ended=ended, who=cell.packer.name, late=longer_than(timeout))
    with limited(PREPARE * timeout, "preparing"):
        pipeline = Pipeline(cell.fresh(), session.scene, session.settings)
        start = time.perf_counter()
        pipeline.packer.prepare(pipeline.scene)
        session.device.finish()
    entries = [(0, "wall/prepare", (time.perf_counter() - start) * 1000)]
    if not warm:
        with limited(2 * timeout, "warming up"):
            pipeline.warm_up(session.source.work, 0)
    for index in range(session.settings.frames):
        frame = session.source.work(index).frame
        with limited(timeout, f"timing frame {index}"):
            packed = pipeline.pack(frame)
        entries += [(index, stage, ms) for stage, ms in packed.stages.items()]
        entries.append((index, "wall/pack", packed.wall_ms))
    return entries
