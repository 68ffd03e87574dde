"""`bench tables`: the commands behind the documents' tables, run anew; the data is kept, or compared with the print."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from datetime import date, datetime
from pathlib import Path

from shading_atlas_bench.harness.console import make_console, make_table, styled
from shading_atlas_bench.harness.errors import InputError
from shading_atlas_bench.harness.experiments.claims import scene_file
from shading_atlas_bench.harness.measure.machine import commit
from shading_atlas_bench.harness.plugins import nearest
from shading_atlas_bench.harness.run.plan import duration
from shading_atlas_bench.harness.watch.processes import python
from shading_atlas_bench.kernels.device import Device
from shading_atlas_bench.reports.analysis.sweep import FILE as SWEEP_FILE
from shading_atlas_bench.reports.documents.catalogue import SOURCES
from shading_atlas_bench.reports.documents.kept import (
    ROOT,
    About,
    DocumentError,
    Kept,
    Source,
    checked,
    read_kept,
    write_kept,
)
from shading_atlas_bench.reports.documents.markdown import (
    Book,
    check_documents,
    printed_in,
    write_documents,
    wrong_places,
)
from shading_atlas_bench.reports.store.data import read_json
from shading_atlas_bench.reports.store.records import RunFile, Values
from shading_atlas_bench.reports.store.results import FILE as RESULTS
from shading_atlas_bench.reports.store.results import Store
from shading_atlas_bench.scenes.model import SceneError

RUNS = Path("runs")
RUN_FILE = "run.json"
ALL = "all"


def chosen(sources: Mapping[str, Source], names: Sequence[str], quick: bool) -> list[Source]:
    """The tables of these names, every one for `all`; with `quick` only the quick ones. Raises InputError."""
    if ALL in names:
        return [source for source in sources.values() if source.quick or not quick]
    for name in names:
        if name not in sources:
            raise InputError(f"There is no table {name!r}.{nearest(name, list(sources))}")
    return [sources[name] for name in names if sources[name].quick or not quick]


def show_tables(names: Sequence[str] = ()) -> None:
    """Print tables, all without names: when and how long each was measured, from how many runs, where it is printed;
    of named ones also the commands. Raises InputError."""
    console, places = make_console(), printed_in()
    table = make_table("tables", "table", "measured", "took", "runs", "printed in")
    for source in chosen(SOURCES, names or [ALL], quick=False):
        kept = read_kept(source.name)
        measured = kept.about["date"] if kept else "not yet"
        took = duration(kept.about["seconds"]) if kept and kept.about["seconds"] else ""
        name = f"{source.name} (quick)" if source.quick else source.name
        table.add_row(name, measured, took, str(len(source.commands)), "\n".join(places.get(source.name, [])))
    if not names:
        table.caption = "quick: also measured by --check --quick. bench tables NAME --list shows its commands."
    console.print(table)
    for source in chosen(SOURCES, names, quick=False):
        for command in source.commands:
            console.print(command, soft_wrap=True)


def write_tables(
    names: Sequence[str],
    folder: Path | None = None,
    run: bool = True,
    *,
    sources: Mapping[str, Source] = SOURCES,
    root: Path = ROOT,
) -> bool:
    """Measure tables anew and write their data and all documents; those whose scenes are missing are named and stay.

    Returns whether every command ran; one that does not is said, and the tables after it are measured all the same.

    folder: results that are there already, in place of running the commands of the one table named.
    run: False only writes the documents from the data that is kept. root: of the repository.

    Raises InputError, DocumentError or what the results are refused with.
    """
    check_documents(root)  # else hours later
    picked = chosen(sources, names, False) if run else []
    if folder and len(picked) != 1:
        raise InputError("--from takes the results of one table: name it.")
    console, well = make_console(), True
    try:
        for source in picked:
            if not folder and (lacking := missing_scene(source)):
                console.print(styled("[yellow]not measured[/] {}: {}", source.name, lacking), soft_wrap=True)
                continue
            kept = _taken(source, folder) if folder else _tried(source)
            well = well and kept is not None
            if kept is not None:
                write_kept(source.name, kept, root)
                console.print(styled("[bold]{}[/]  {}", source.name, duration(kept.about["seconds"] or 0)))
    except BaseException:  # also of those that were measured before somebody stops it
        with suppress(DocumentError):  # what stopped it is what to tell
            _write(sources, root)
        raise
    _write(sources, root)
    return well


def _write(sources: Mapping[str, Source], root: Path) -> None:
    """Write all documents from the kept data."""
    for name in write_documents(Book(sources, root)):
        make_console().print(f"written  {name}", soft_wrap=True)


def _tried(source: Source) -> Kept | None:
    """A table measured anew; None, with a sentence, where a command of it could not run."""
    try:
        return _measured(source)
    except InputError as error:
        make_console().print(styled("[red]not measured[/] {}: {}", source.name, error), soft_wrap=True)
        return None


def check_tables(
    names: Sequence[str], quick: bool, *, sources: Mapping[str, Source] = SOURCES, root: Path = ROOT
) -> bool:
    """Measure tables anew, and say where a printed digit that no machine may change is another now; whether none is.

    Tables whose scenes are missing, or that were never measured, are named, and are not said to hold.
    """
    console, sound, unchecked = make_console(), True, 0
    for sentence in wrong_places(Book(sources, root)):
        console.print(styled("[red]not from the data[/] {}", sentence), soft_wrap=True)
        sound = False
    found = chosen(sources, names, quick)
    for source in found:
        kept = read_kept(source.name, root)
        why = missing_scene(source) if kept else "no data of it is kept: bench tables measures it."
        if kept is None or why:
            console.print(styled("[yellow]not checked[/] {}: {}", source.name, why), soft_wrap=True)
            unchecked += 1
            continue
        measured = _tried(source)
        if measured is None:
            sound, unchecked = False, unchecked + 1
            continue
        fresh = checked(kept, measured.parts, source.parts)
        try:
            wrong = wrong_places(Book(sources, root, {source.name: fresh}), source.name)
        except DocumentError as error:  # a row that a sentence names is not there any more
            wrong = [str(error)]
        for sentence in wrong:
            console.print(styled("[red]{}[/] {}", source.name, sentence), soft_wrap=True)
        console.print(styled("{}: {}", source.name, styled("[red]differs[/]" if wrong else "[green]holds[/]")))
        sound = sound and not wrong
    console.print(f"{len(found) - unchecked} of {len(found)} tables checked.")
    return sound


def missing_scene(source: Source) -> str:
    """A sentence about the first scene that a table needs and that is not there; empty if all are."""
    named = [match[1] for command in source.commands for match in re.finditer(r"--scene (\S+)", command)]
    for scene in [*named, *source.scenes]:
        try:
            scene_file(scene)
        except SceneError as error:
            return str(error)
    return ""


def _measured(source: Source) -> Kept:
    """Run the commands of a table into a new folder below runs/, and digest what they wrote."""
    top, start = RUNS / f"{datetime.now():%Y%m%d-%H%M%S}-tables-{source.name}", time.monotonic()
    folders = [top / f"{number:02d}" for number in range(len(source.commands))]
    for command, folder in zip(source.commands, folders, strict=True):
        _run(command, folder)
    return _digested(source, folders, round(time.monotonic() - start, 1))


def _run(command: str, folder: Path) -> None:
    """Run a command line of `bench` in a process of its own, which watches itself.

    Raises InputError if it cannot start. Rows that are not ok have no numbers, so their cells will be empty; that is
    said, and is no error here.
    """
    make_console(stderr=True).print(styled("[dim]{}[/]", command), soft_wrap=True)
    words = shlex.split(command)[1:]
    for place, word in enumerate(words[:-1]):
        if word == "--scene":
            words[place + 1] = scene_file(words[place + 1])
        if word == "--path" and (ROOT / words[place + 1]).is_file():
            words[place + 1] = str(ROOT / words[place + 1])
    done = subprocess.run(
        [*python("-m", "shading_atlas_bench"), *words, "--out", str(folder)],
        check=False, stdout=subprocess.DEVNULL, env=os.environ | {"COLUMNS": "80"},
    )  # fmt: skip
    if done.returncode not in (0, 1) or not folder.is_dir():
        raise InputError(f"`{command}` ended with exit code {done.returncode}: its table stays as it was.")
    if done.returncode:
        make_console(stderr=True).print(styled("[yellow]warning[/] Not all is ok in {}.", folder), soft_wrap=True)


def _taken(source: Source, folder: Path) -> Kept:
    """Results that are there: of one command in `folder` itself, of several in its sub-folders, by name.

    The commands go on in these folders: they have nothing left to do, or refuse what is of other settings or kernels.

    Raises InputError for folders of anything else, or that do not say where their results come from.
    """
    several = len(source.commands) > 1
    folders = sorted(path for path in folder.glob("*") if path.is_dir()) if several else [folder]
    if len(folders) != len(source.commands):
        raise InputError(f"{folder} has {len(folders)} folders, and {source.name} takes {len(source.commands)} runs.")
    if not all(map(_stores, folders)):
        raise InputError(f"{folder} does not say which device its results are of: run bench tables {source.name}.")
    for command, place in zip(source.commands, folders, strict=True):
        _run(command, place)
    return _digested(source, folders, None)


def _digested(source: Source, folders: Sequence[Path], seconds: float | None) -> Kept:
    """The rows of results, and where they come from: commands, commits, dates, device, driver, settings of each run."""
    device: dict[str, str] = {}
    commits, dates = set(), set()
    for store in (store for folder in folders for store in _stores(folder)):
        with Store(store) as results:
            notes = results.notes.under("environment")
            device = device or results.notes.under("device")
            commits.add(notes.get("commit", ""))
            dates.update([notes["date"][:10]] if "date" in notes else [])
    settings = [_settings(*pair) for pair in zip(source.commands, folders, strict=True)]
    # Experiments without a store have just used the default device.
    device = device or Device.open(None).description
    about: About = {
        "commands": list(source.commands),
        "commit": ", ".join(sorted(filter(None, commits))) or commit(),
        "date": " to ".join(sorted({min(dates), max(dates)})) if dates else date.today().isoformat(),
        "device": device["name"],
        "driver": f"{device['platform']} {device['driver']}",
        "seconds": seconds,
        "settings": list(filter(None, settings)),
    }
    return Kept(about, source.digest(folders))


def _settings(command: str, folder: Path) -> Values | None:
    """All settings of a run or sweep, the scene as its command names it; None for what has none of its own."""
    for name in (RUN_FILE, SWEEP_FILE):
        if (folder / name).is_file():
            settings = read_json(folder / name, RunFile)["settings"]
            named = re.search(r"--scene (\S+)", command)
            return settings | ({"scene": named[1]} if named else {})
    return None


def _stores(folder: Path) -> list[Path]:
    """The folders with a results store and notes of its own: `folder` itself, or those right below it."""
    if (folder / RESULTS).is_file():
        return [folder]
    return [file.parent for file in sorted(folder.glob(f"*/{RESULTS}"))]
