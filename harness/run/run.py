"""A run as a whole: everything that its settings ask for, into one folder."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from shading_atlas_bench.harness.measure.pipeline import Pipeline
from shading_atlas_bench.harness.measure.verification.truth import Truth
from shading_atlas_bench.harness.progress import Progress
from shading_atlas_bench.harness.run.explain import explain, rows_of
from shading_atlas_bench.harness.run.folder import COMPLETE, check_folder, folder_for, locked, stops_kept
from shading_atlas_bench.harness.run.loop import Run
from shading_atlas_bench.harness.run.memory import methods_at_once
from shading_atlas_bench.harness.run.plan import make_plan
from shading_atlas_bench.harness.run.provenance import write_notes
from shading_atlas_bench.harness.workload.methods import find_methods
from shading_atlas_bench.harness.workload.session import Session, open_session
from shading_atlas_bench.harness.workload.settings import Settings
from shading_atlas_bench.harness.workload.skips import check_names
from shading_atlas_bench.kernels.journal import journal
from shading_atlas_bench.reports.pages import html
from shading_atlas_bench.reports.store import csv_files
from shading_atlas_bench.reports.store.results import Store


@dataclass(frozen=True)
class Outcome:
    """What a run made: the folder of its results, whether every row is ok or skipped, and the rows of skips.csv where
    they were asked for."""

    folder: Path
    well: bool
    explained: list[dict[str, Any]] | None = None


def run(
    settings: Settings,
    out: Path | None = None,
    progress: Progress | None = None,
    *,
    resume: Path | None = None,
    explained: bool = False,
) -> Outcome:
    """Run everything the settings ask for into `out` (a new folder below runs/ if None, or the unfinished run of the
    same plan there).

    progress: who is told how far it is. resume: what `--out` of the running command names, if that is not `out`.
    explained: measure what every skip saves, too.

    Raises InputError, SettingsError, SceneError, PathError, DeviceError or StoreError for what cannot be used, and
    StoppedError when it is interrupted; finished frames are kept then.
    """
    progress = progress or Progress()
    check_folder(out)
    progress.say(f"Opening {settings.scene} ...")
    packers = find_methods(settings)
    check_names(settings.no_skip, packers)
    session = open_session(settings)
    at_once = methods_at_once(settings, session.scene.host, packers)
    truth = Truth(session.scene, settings.seed)
    pipelines = [Pipeline(packer, session.scene, settings, truth) for packer in packers]
    plan = make_plan(session, pipelines)
    folder = out or folder_for(plan, Path(settings.scene).stem, progress)
    with locked(folder), Store(folder) as store:
        store.set_plan(plan)
        _write_settings(folder, session, plan)
        again = resume or folder
        journal().note(again=["--out", str(again)])
        tell_device(session, progress)
        if finished := len(store.finished()):
            progress.say(f"{finished} of {session.frames * len(pipelines)} frames of the methods are finished already.")
        progress.say(f"Results go to {folder}; the same command with --out {again} resumes.")
        rows = None
        with stops_kept(again):
            write_notes(store, session)
            Run(session, pipelines, store, folder, at_once=at_once).all_frames(progress)
            if explained:
                rows = _explain(session, store, progress)
        csv_files.write_all(folder)
        html.write_report(folder)
        store.notes[COMPLETE] = "yes"
        return Outcome(folder, all(row["status"] in ("ok", "skipped") for row in store.rows()), rows)


def tell_device(session: Session, progress: Progress) -> None:
    """Which device is used where better ones were passed over, and that a new one takes a while."""
    for sentence in session.device.passed_over:
        progress.warn(f"{sentence} Used instead: {session.device.name}.")
    if session.device.is_new:
        progress.say(f"First run on {session.device.name}: its kernels are being built, up to a minute.")


def _write_settings(folder: Path, session: Session, plan: dict[str, Any]) -> None:
    """run.json: what `--config` replays."""
    told = {"settings": session.settings.to_json(), "plan": plan, "device": session.device.description}
    csv_files.replace_file(folder / "run.json", json.dumps(told, indent=2) + "\n")


def _explain(session: Session, store: Store, progress: Progress) -> list[dict[str, Any]]:
    """The rows of skips.csv, kept in the store's notes."""
    with progress.task("skips") as task:
        rows = rows_of(explain(session, task.doing))
    for row in rows:
        store.notes[f"saved/{row['skip']}"] = json.dumps(row)
    return rows
