"""`bench stress`: every method, and the rasteriser, in every test of the catalogue at every magnitude."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from msgspec import Meta

from shading_atlas_bench.harness.conformance.catalogue import CATALOGUE, StressTest
from shading_atlas_bench.harness.conformance.trial import Stage, TrialResult, try_method, try_rasteriser
from shading_atlas_bench.harness.console import make_console, make_table, progress_bars, styled, tell_passed_over
from shading_atlas_bench.harness.errors import InputError, StoppedError
from shading_atlas_bench.harness.plugins import label_of, nearest, variant_string
from shading_atlas_bench.harness.run.digest import method_digest, suite_digest
from shading_atlas_bench.harness.watch.stops import stops_apart
from shading_atlas_bench.harness.watch.watchdog import PackTimeoutError, ended_steps, longer_than, time_limit
from shading_atlas_bench.kernels.cache import VERSION
from shading_atlas_bench.kernels.device import Device
from shading_atlas_bench.kernels.journal import journal
from shading_atlas_bench.reports.pages.stress import magnitude, matrix, picture_stem, write_stress
from shading_atlas_bench.reports.store.columns import STRESS_COLUMNS, STRESS_STATUSES
from shading_atlas_bench.reports.store.data import DataError, Kind, decode_json
from shading_atlas_bench.reports.store.names import folder_name
from shading_atlas_bench.reports.store.records import Plan, WholeNumber, row_type
from shading_atlas_bench.scenes.model import SceneError
from shading_atlas_bench.scenes.paths import PathError

if TYPE_CHECKING:
    from shading_atlas_bench.arithmetic.arrays import Bytes
    from shading_atlas_bench.packers.interface import Packer

RUNS = Path("runs")
RASTER = "raster"
FOLDER_NAME = Annotated[str, Meta(pattern=r"\A\w[\w.-]*\Z")]  # which is part of the names of pictures
TRIAL = row_type(
    "Trial",
    STRESS_COLUMNS,
    ("method", "variant", "label", "folder", "test", "step", "magnitude", "unit", "status", "passed"),
    {
        "label": str,
        "folder": FOLDER_NAME,
        "test": FOLDER_NAME,
        "step": WholeNumber,
        "status": Literal[STRESS_STATUSES],
    },
)
# Where a test must not change the picture: this much more error than at the first magnitude is another picture.
DRIFT = (1.5, 0.005)  # factor, and FLIP on top


@dataclass(frozen=True)
class Contender:
    """A row of the matrix: a packer with its parameters, or the rasteriser."""

    method: str
    variant: str
    label: str
    packer: Packer | None

    def run(self, stage: Stage) -> TrialResult:
        """What comes out of a stage."""
        return try_rasteriser(stage) if self.packer is None else try_method(stage, maker(self.packer))

    @property
    def key(self) -> str:
        """The row's name, `method[variant]`."""
        return f"{self.method}[{self.variant}]"


def contenders(methods: tuple[str, ...], timeout: float) -> list[Contender]:
    """The rasteriser and the methods of `--method`. Raises InputError for what cannot be loaded."""
    from shading_atlas_bench.harness.workload.methods import find_methods
    from shading_atlas_bench.harness.workload.settings import Settings

    found = find_methods(Settings(methods=methods, timeout=timeout))
    own = [Contender(packer.name, variant_string(packer), label_of(packer), packer) for packer in found]
    return [Contender(RASTER, "", RASTER, None), *own]


def maker(packer: Packer) -> Callable[[], Packer]:
    """A function that makes packers of the same class and parameters, without a past."""
    values = {name: getattr(packer, name) for name in packer.parameters}
    return lambda: type(packer)(**values)


def chosen_tests(names: tuple[str, ...]) -> list[StressTest]:
    """Tests by name, all without any. Raises InputError for an unknown one."""
    for name in names:
        if name not in CATALOGUE:
            raise InputError(f"There is no stress test {name!r}.{nearest(name, list(CATALOGUE))}")
    return [CATALOGUE[name] for name in names or CATALOGUE]


def steps_of(test: StressTest, quick: bool) -> list[int]:
    """Places of the magnitudes to try: all, or the first, a middle one and the last."""
    count = len(test.magnitudes)
    return sorted({0, count // 2, count - 1}) if quick else list(range(count))


def run_stress(methods: tuple[str, ...], tests: tuple[str, ...], out: Path | None, quick: bool, device: str | None,
               timeout: float) -> bool:  # fmt: skip
    """Run the catalogue into `out`; whether nothing went wrong. An interrupted run goes on where it was.

    Raises InputError or DeviceError for what cannot be used, and StoppedError when it is interrupted.
    """
    chosen, rows = chosen_tests(tests), contenders(methods or ("all",), timeout)
    opened = Device.open(device)
    tell_passed_over(opened)
    plan = {
        "tests": [test.name for test in chosen],
        "quick": quick,
        "methods": {row.key: method_digest(type(row.packer)) for row in rows if row.packer},
        "device": opened.name,
        "suite": suite_digest(),
        "version": VERSION,
    }
    log = Log.open(out or _folder_for(plan), plan)
    log.check(chosen, rows)
    journal().note(again=["--out", str(log.folder)])
    console = make_console(stderr=True)
    console.print(styled("Results go to [bold]{}[/]; the same command with --out {} resumes.", log.folder, log.folder))
    try:
        with stops_apart():
            StressRun(opened, chosen, rows, log, quick, timeout).everything()
    except KeyboardInterrupt:
        raise StoppedError(f"Finished trials are kept: the same command with --out {log.folder} goes on.") from None
    facts = {"Device": opened.name, "Date": datetime.now().strftime("%Y-%m-%d %H:%M"), "Trials": str(len(log.rows)),
             "Magnitudes": "three of each test" if quick else "all"}  # fmt: skip
    write_stress(log.folder, log.rows, {test.name: test.what for test in chosen}, facts)
    show_matrix(log.rows, log.folder)
    return all(row["passed"] for row in log.rows)


class Log:
    """Finished trials, a JSON line each, in `folder`/stress.jsonl, below a line that says what binds them together."""

    def __init__(self, folder: Path, rows: list[dict[str, Any]]) -> None:
        self.folder, self.rows = folder, rows

    @classmethod
    def open(cls, folder: Path, plan: dict[str, Any]) -> Log:
        """The log of a new or an unfinished run. Raises InputError for a folder of anything else."""
        file = folder / "stress.jsonl"
        if file.is_file():
            first, *lines = file.read_text(encoding="utf-8", errors="replace").splitlines() or [""]
            before = _whole(first, Plan)
            if before is None:
                raise InputError(f"{file} does not begin with what its trials are of: give another --out.")
            other = [name for name in plan if before.get(name) != plan[name]]
            if other == ["device"] and not lines:  # nothing is done yet, and its compiler may have died
                file.write_text(json.dumps(plan) + "\n", encoding="utf-8")
                return cls(folder, [])
            if other:
                raise InputError(f"{folder} holds a stress test with other {' and '.join(other)}: give another --out.")
            rows = [row for line in lines if (row := _whole(line, TRIAL))]  # a kill may have cut the last one off
            if len(rows) < len(lines):
                file.write_text("".join(json.dumps(row) + "\n" for row in [before, *rows]), encoding="utf-8")
            return cls(folder, rows)
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise InputError(f"{folder} holds other things than a stress test: give a new or empty folder for --out.")
        try:
            folder.mkdir(parents=True, exist_ok=True)
            file.write_text(json.dumps(plan) + "\n", encoding="utf-8")
        except OSError as error:
            raise InputError(f"{folder} cannot be written ({error.strerror}): give another --out.") from error
        return cls(folder, [])

    def check(self, tests: list[StressTest], rows: list[Contender]) -> None:
        """Raise InputError where a trial is there twice, or is none of these, or says what no such trial says."""
        contenders = {(row.method, row.variant): row for row in rows}
        named, keys = {test.name: test for test in tests}, set()
        for known in self.rows:
            key = known["method"], known["variant"], known["test"], known["step"]
            row, test = contenders.get(key[:2]), named.get(known["test"])
            if (
                row is None
                or test is None
                or known["step"] >= len(test.magnitudes)
                or key in keys
                or known != known | _told(row, test, known["step"], known["status"])
            ):
                raise InputError(
                    f"{self.folder / 'stress.jsonl'} has a trial that was changed, or is there twice: "
                    f"{known['label']}, {known['test']} {known['step']}. Remove its line, and it is tried again."
                )
            keys.add(key)

    def has(self, row: Contender, test: StressTest, step: int) -> bool:
        """Whether the trial is finished."""
        return self.find(row, test, step) is not None

    def find(self, row: Contender, test: StressTest, step: int) -> dict[str, Any] | None:
        """The finished trial, if there is one."""
        key = (row.method, row.variant, test.name, step)
        for known in self.rows:
            if (known["method"], known["variant"], known["test"], known["step"]) == key:
                return known
        return None

    def add(self, values: dict[str, Any]) -> None:
        """Add a finished trial, here and to the file."""
        self.rows.append(values)
        with open(self.folder / "stress.jsonl", "a", encoding="utf-8") as file:
            file.write(json.dumps(values) + "\n")


def _told(row: Contender, test: StressTest, step: int, status: str) -> dict[str, Any]:
    """What follows from which trial it is and its status."""
    return {
        "method": row.method,
        "variant": row.variant,
        "label": row.label,
        "folder": folder_name(row.method, row.variant),
        "test": test.name,
        "step": step,
        "magnitude": test.magnitudes[step],
        "unit": test.unit,
        "status": status,
        "passed": int(status in ("ok", "overflow") or (status == "refused" and test.refusable)),
    }


def _whole(line: str, kind: type[Kind]) -> Kind | None:
    """What a line of the log holds; None where it was cut off, or is something else."""
    try:
        return decode_json(line, kind, "A line of the log")
    except DataError:
        return None


def _folder_for(plan: dict[str, Any]) -> Path:
    """The newest unfinished stress test of this plan below runs/, else a new folder there."""
    for folder in sorted(RUNS.glob("*-stress*/"), reverse=True):
        file = folder / "stress.jsonl"
        if file.is_file() and not (folder / "stress.html").is_file():
            with open(file, encoding="utf-8", errors="replace") as lines:
                if _whole(lines.readline(), Plan) == json.loads(json.dumps(plan)):
                    return folder
    stem = RUNS / f"{datetime.now():%Y%m%d-%H%M%S}-stress"
    return next(folder for n in range(1000) if not (folder := stem if n == 0 else Path(f"{stem}-{n}")).exists())


class StressRun:
    """A stress test on its way."""

    def __init__(self, device: Device, tests: list[StressTest], rows: list[Contender], log: Log, quick: bool,
                 timeout: float) -> None:  # fmt: skip
        self.device, self.tests, self.rows, self.log = device, tests, rows, log
        self.timeout = timeout
        self.trials = [(test, step, row) for test in tests for step in steps_of(test, quick) for row in rows]

    def everything(self) -> None:
        """All trials that are not finished yet, with progress."""
        with progress_bars(make_console(stderr=True)) as progress:
            task = progress.add_task("starting", total=len(self.trials))
            for test, step, fresh in self._unfinished():
                value = test.magnitudes[step]
                done = sum(self.log.has(row, t, s) for t, s, row in self.trials)
                progress.update(task, completed=done, description=f"{test.name} {magnitude(value)}")
                for row in self._one_step(test, step, fresh):
                    text = f"{test.name} {magnitude(value)}: {row.label}"
                    progress.update(task, advance=1, description=text)

    def _unfinished(self) -> Iterator[tuple[StressTest, int, list[Contender]]]:
        """Tests and steps with the contenders that have not had them."""
        for test, step in dict.fromkeys((test, step) for test, step, _ in self.trials):
            fresh = [row for row in self.rows if not self.log.has(row, test, step)]
            if fresh:
                yield test, step, fresh

    def _one_step(self, test: StressTest, step: int, fresh: list[Contender]) -> Iterator[Contender]:
        """Try the contenders; gives each when it is done."""
        stage = self._staged(test, step)
        for row in fresh:
            ended = self._ended(row, test, step)
            if isinstance(stage, TrialResult):
                found = stage
            elif before := ended_steps(**ended):
                found = TrialResult(before[0]["status"], before[0]["reason"])
            else:
                who = f"{row.label}, {test.name} {magnitude(test.magnitudes[step])}"
                with time_limit(self.timeout, "", ended, who=who, late=longer_than(self.timeout)):
                    found = row.run(stage)
            self._keep(row, test, step, found)
            yield row

    def _ended(self, row: Contender, test: StressTest, step: int) -> dict[str, Any]:
        return {"folder": str(self.log.folder), "contender": row.key, "test": test.name, "step": step}

    def _staged(self, test: StressTest, step: int) -> Stage | TrialResult:
        """The stage, or why there is none: loading refuses what it cannot use in one sentence."""
        ended = {"folder": str(self.log.folder), "stage": test.name, "step": step}
        for before in ended_steps(**ended):
            return TrialResult(before["status"], before["reason"])
        try:
            who = f"{test.name} {magnitude(test.magnitudes[step])}"
            with time_limit(self.timeout, "the scene", ended, who=who, late=longer_than(self.timeout)):
                stage = Stage.of(self.device, test.make(test.magnitudes[step]))
                _ = stage.reference
                return stage
        except (SceneError, PathError) as error:
            return TrialResult("refused", str(error))
        except PackTimeoutError as error:
            return TrialResult("timeout", f"the scene: {error}")

    def _keep(self, row: Contender, test: StressTest, step: int, found: TrialResult) -> None:
        first = self.log.find(row, test, 0)
        baseline: float | None = first["error"] if first else found.error
        growth = found.error / baseline if found.error is not None and baseline else None
        status, reason = found.status, found.sentence
        if (
            test.invariant
            and status == "ok"
            and baseline is not None
            and found.error is not None
            and found.error > DRIFT[0] * baseline + DRIFT[1]
        ):
            status = "inaccurate"
            reason = f"The picture must stay the same, and its error grew from {baseline:.4f} to {found.error:.4f}."
        told = _told(row, test, step, status)
        values = told | {
            "reason": reason or None,
            "error": found.error,
            "growth": growth,
            "wrong_px": found.wrong,
            "holes_px": found.holes,
            "samples": found.samples,
            "unplaced": found.unplaced,
            "seconds": round(found.seconds, 3),
        }
        for name, rgb in found.pictures.items():
            self._write(values, name, rgb)
        self.log.add(values)

    def _write(self, values: dict[str, Any], name: str, rgb: Bytes) -> None:
        from shading_atlas_bench.harness.measure.dump import write_png

        path = self.log.folder / "pictures" / f"{picture_stem(values)}_{name}.png"
        path.parent.mkdir(exist_ok=True)
        write_png(path, rgb)


def show_matrix(rows: list[dict[str, Any]], folder: Path) -> None:
    """Print how far every method came, and in a sentence each what went wrong first."""
    console, found = make_console(), matrix(rows)
    labels = list(dict.fromkeys(row["label"] for row in rows))
    table = make_table("magnitude reached (!: a harder one went wrong)", "test", "hardest", *labels)
    for column in table.columns[1:]:
        column.justify = "right"
    for test, cells in found.items():
        colour = {label: "red" if cells[label].broken else "green" for label in cells}
        texts = [
            styled("[{style}]{}[/]", cells[label].text, style=colour[label]) if label in cells else ""
            for label in labels
        ]
        table.add_row(test, magnitude(next(iter(cells.values())).hardest), *texts)
    console.print(table)
    for test, cells in found.items():
        for label, reach in cells.items():
            if row := reach.broken:
                where = f"{label}, {test} {magnitude(row['magnitude'])}"
                console.print(styled("[red]{}[/] {}: {}", row["status"], where, _shortened(row["reason"])))
    console.print(styled("[bold]{}/stress.html[/]  stress.csv  pictures/", folder), soft_wrap=True)


def _shortened(text: str, length: int = 300) -> str:
    return text if len(text) <= length else text[: length - 1] + "…"


def show_tests() -> None:
    """Print the catalogue."""
    table = make_table("stress tests", "test", "what it does", "magnitudes", "unit")
    for test in CATALOGUE.values():
        span = f"{magnitude(test.magnitudes[0])} .. {magnitude(test.magnitudes[-1])}"
        table.add_row(test.name, test.what, span, test.unit)
    make_console().print(table)
