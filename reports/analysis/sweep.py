"""The cells of a sweep, read from the runs that measured them: times with intervals, errors, fronts; sweep.csv."""

from __future__ import annotations

import hashlib
import json
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, NotRequired, TypedDict

from msgspec import Meta

from shading_atlas_bench.reports.analysis.fronts import Candidate, pareto_front
from shading_atlas_bench.reports.store.columns import (
    BY_NAME,
    MEASURED_STATUSES,
    MEASURES_OF_SWEEPS,
    PICTURE_METRICS,
    SWEEP_COLUMNS,
    SWEEP_MEASURES,
    SWEEP_SETTINGS,
)
from shading_atlas_bench.reports.store.csv_files import measure_statistics, spread, write_csv
from shading_atlas_bench.reports.store.data import DataError, read_json
from shading_atlas_bench.reports.store.database import StoreError
from shading_atlas_bench.reports.store.labels import NOTES
from shading_atlas_bench.reports.store.middle import median
from shading_atlas_bench.reports.store.records import Plain, Plan, row_type
from shading_atlas_bench.reports.store.results import FILE as RESULTS
from shading_atlas_bench.reports.store.results import Store

FILE = "sweep.json"
AGAIN = "The same `bench sweep` with this folder for --out writes it again."
GROUPS = ("structs/", "gather/")  # the stages that make up server_ms
WORST_FIRST = ("failed", "timeout", "invalid", "overflow", "skipped", "ok")
COSTS = {"server_ms": "time", "samples": "samples", "bytes_total": "bytes", "atlas_mb": "memory"}
# The statistic that a cost is compared by; bytes are what a network carries, so all of them count.
STATISTICS = {"bytes_total": "mean"}
ERRORS = (*PICTURE_METRICS, "stretch_l2")

CELL_SETTINGS = row_type(
    "CellSettings",
    [column for column in SWEEP_COLUMNS if column.name in SWEEP_SETTINGS],
    [name for name in SWEEP_SETTINGS if name not in ("atlas_width", "atlas_height", "samples_per_pixel")],
)

Row = dict[str, Any]
Numbers = dict[str, dict[int, float]]


class Cell(TypedDict):
    """A cell of the grid in sweep.json. codings: codec and rate of each picture that is judged, by its name."""

    folder: Annotated[str, Meta(pattern=r"\Acells/\w[\w.-]*\Z")]
    method: str
    variant: str
    contender: NotRequired[str]
    varied: dict[str, str]
    condition: str
    codings: dict[Literal["displayed", "lossless"], tuple[str | None, int | None]]
    settings: CELL_SETTINGS  # type: ignore[valid-type]  # a type of the time it runs


class Shared(TypedDict):
    """Settings that all cells of a sweep share."""

    path: str
    seed: int


class Sweep(TypedDict):
    """The content of sweep.json: the settings that all cells share, the grid, and how its cells are timed."""

    settings: Shared
    vary: list[str]
    rule: dict[str, Plain]
    timed: bool
    frames: Annotated[int, Meta(ge=1)]
    left_out: list[tuple[str, str]]
    cells: list[Cell]


@dataclass(frozen=True)
class Point:
    """One cell in one coding: its row of sweep.csv, and its measures by name and frame.

    condition: the work that was set, in words; only points of one condition can be compared.
    label: what was varied.
    """

    row: Row
    numbers: Numbers
    condition: str
    label: str

    def shown(self) -> bool:
        """Whether it is a point of a plot: all its frames are ok."""
        return bool(self.row["status"] == "ok")


def read_sweep(folder: Path) -> Sweep:
    """The content of sweep.json. Raises StoreError if there is none, or if it is not as the sweep wrote it."""
    try:
        sweep = read_json(folder / FILE, Sweep)
    except DataError as error:
        raise StoreError(f"{folder} has no readable {FILE}: give a folder that `bench sweep` wrote. {error}") from error
    for cell in sweep["cells"]:
        cell.setdefault("contender", cell["method"])  # earlier versions told methods apart, not fixed parameters
    keys = Counter((cell["method"], cell["variant"], cell["folder"]) for cell in sweep["cells"])
    for (method, variant, place), count in keys.items():
        if count > 1:
            raise StoreError(f"{folder / FILE} has {method}[{variant}] in {place} {count} times. {AGAIN}")
    if _has_results(folder):
        with Store(folder, must_exist=True) as store:
            plan = store.plan() or {}
        if "grid" in plan and plan["grid"] != grid_digest(sweep):
            raise StoreError(f"{folder / FILE} was changed after the sweep had written it. {AGAIN}")
    return sweep


def grid_digest(sweep: Sweep) -> str:
    """16 hex digits over all that sweep.json says but for the rule, which may change when a sweep goes on."""
    grid = {name: said for name, said in sweep.items() if name != "rule"}
    return hashlib.sha256(json.dumps(grid, sort_keys=True).encode()).hexdigest()[:16]


def _has_results(folder: Path) -> bool:
    """Whether there is a store; an empty file is what is left of a sweep that was killed while it made one."""
    file = folder / RESULTS
    return file.is_file() and file.stat().st_size > 0


def is_sweep(folder: Path) -> bool:
    """Whether the folder was written by `bench sweep`."""
    return (folder / FILE).is_file()


def read_points(folder: Path) -> list[Point]:
    """All cells of the sweep in `folder`, in the codings that were judged, with fronts marked."""
    sweep = read_sweep(folder)
    stores: dict[str, _Run] = {}
    points = []
    for cell in sweep["cells"]:
        if cell["folder"] not in stores:
            stores[cell["folder"]] = _Run.read(folder / cell["folder"])
        _check(sweep, cell, stores[cell["folder"]], folder)
        points += _points(sweep, cell, stores[cell["folder"]])
    for cost in COSTS:
        _mark_fronts(points, cost)
    return points


def _check(sweep: Sweep, cell: Cell, run: _Run, folder: Path) -> None:
    """Raise StoreError where sweep.json says of a cell what its run is not."""
    name, methods, settings = f"{cell['method']}[{cell['variant']}]", run.plan.get("methods"), run.plan.get("settings")
    if isinstance(methods, dict) and name not in methods:
        raise StoreError(f"{folder / FILE} has {name} in {cell['folder']}, which has no such method. {AGAIN}")
    said = cell["settings"] | {"frames": sweep["frames"]}
    known = settings if isinstance(settings, dict) else {}
    for setting, value in said.items():
        if value not in (None, known.get(setting, value)):  # None: the method has no such setting
            raise StoreError(
                f"{folder / FILE} says that {name} has the {setting} {value} in {cell['folder']}, whose run has "
                f"{known[setting]}. {AGAIN}"
            )


TOLD = ("warning/budget", "warning/full")  # notes of runs that a sweep sums up, as warnings


def read_told(folder: Path, prefix: str) -> list[str]:
    """What runs of cells tell of methods in their notes of this prefix, and of how many cells: `rare`, what they do in
    a few frames only and did in none; of TOLD, budgets of samples that they did not meet, and full atlases."""
    cells = read_sweep(folder)["cells"]
    of_contender = Counter(cell["contender"] for cell in cells)
    counts: Counter[tuple[str, str]] = Counter()
    for cell in cells:
        place, name = folder / cell["folder"], f"{cell['method']}[{cell['variant']}]"
        if _has_results(place):
            with Store(place, must_exist=True) as store:
                label = store.notes.under(NOTES).get(name, cell["method"])  # which the sentences begin with
                told = [text for key, text in store.notes.under(prefix).items() if f"{key}/".startswith(f"{name}/")]
            counts.update((cell["contender"], text.removeprefix(label)) for text in told)
    return [f"{name}{text} ({count} of {of_contender[name]} cells)" for (name, text), count in counts.items()]


def write_sweep_csv(folder: Path, points: list[Point]) -> None:
    """Write `folder`/sweep.csv."""
    write_csv(folder / "sweep.csv", SWEEP_COLUMNS, (point.row for point in points))


def cost_column(cost: str) -> str:
    """The column of sweep.csv that cells are compared by in a cost of COSTS."""
    return f"{cost}_{STATISTICS.get(cost, 'median')}"


def passes(times: dict[int, float], repeats: Iterable[Row]) -> list[float]:
    """Server time of each pass through the frames, in ms: the median over the frames, the first pass first.

    times: of the first pass, by frame. repeats: rows of the store's repeats of the same method and variant.
    """
    return [median(frames.values()) for frames in _by_pass(times, repeats) if frames]


def _by_pass(times: dict[int, float], repeats: Iterable[Row]) -> list[dict[int, float]]:
    """Server time by frame, in ms, of each pass, the first one first."""
    later: dict[int, dict[int, float]] = defaultdict(lambda: defaultdict(float))
    for row in repeats:
        if row["stage"].startswith(GROUPS) and row["ms"] is not None:
            later[row["repetition"]][row["frame"]] += row["ms"]
    return [times, *(frames for _, frames in sorted(later.items()))]


def _times(times: dict[int, float], repeats: Iterable[Row]) -> Row:
    """The columns of the server time: median and interval over the passes, mean and largest over the frames, each the
    median of its passes."""
    every = _by_pass(times, repeats)
    of_passes = spread([median(frames.values()) for frames in every if frames])
    of_frames = spread([median(frames[frame] for frames in every if frame in frames) for frame in times])
    found = of_passes | {part: of_frames[part] for part in ("mean", "max")}
    return {f"server_ms_{part}": value for part, value in found.items()}


@dataclass(frozen=True)
class _Run:
    """The plan of one run, and what its store holds, by method and variant."""

    plan: Plan
    rows: dict[tuple[str, str], list[Row]]
    repeats: dict[tuple[str, str], list[Row]]
    stops: dict[str, str]

    @classmethod
    def read(cls, folder: Path) -> _Run:
        rows: dict[tuple[str, str], list[Row]] = defaultdict(list)
        repeats: dict[tuple[str, str], list[Row]] = defaultdict(list)
        if not _has_results(folder):
            return cls({}, rows, repeats, {})
        with Store(folder, must_exist=True) as store:
            for row in store.rows():
                rows[row["method"], row["variant"]].append(row)
            for row in store.repeats():
                repeats[row["method"], row["variant"]].append(row)
            return cls(store.plan() or {}, rows, repeats, store.notes.under("stop"))


def _points(sweep: Sweep, cell: Cell, run: _Run) -> list[Point]:
    """The point of each coding whose picture is judged."""
    key = cell["method"], cell["variant"]
    by_coding: dict[tuple[str | None, int | None], list[Row]] = defaultdict(list)
    for row in run.rows.get(key, []):
        by_coding[row["codec"], row["crf"]].append(row)
    stop = run.stops.get(f"{cell['method']}[{cell['variant']}]", "")
    points = []
    for kind, coding in cell["codings"].items():
        codec, crf = coding
        row, numbers = _row(sweep, cell, codec, crf, by_coding[codec, crf])
        repeats = run.repeats.get(key, [])
        timed = row["status"] in MEASURED_STATUSES
        row |= (_times(numbers["server_ms"], repeats) if timed else {}) | {
            "coding": kind,
            "repetitions": len(passes(numbers["server_ms"], repeats)) if timed else 0,
            "stop": stop or ("" if row["status"] in ("failed", "timeout", "invalid", "skipped") else "unfinished"),
            "comparable": "yes" if sweep["timed"] else "no",
        }
        points.append(Point(row, numbers, cell["condition"], _label(cell)))
    return points


def _label(cell: Cell) -> str:
    return ", ".join(f"{name}={value}" for name, value in cell["varied"].items()) or "as it is"


def _row(sweep: Sweep, cell: Cell, codec: str | None, crf: int | None, rows: list[Row]) -> tuple[Row, Numbers]:
    """The columns of sweep.csv but those of time, and the measures by frame."""
    status, reason = _status(rows, sweep["frames"])
    fixed = {"method": cell["method"], "variant": cell["variant"], "contender": cell["contender"]}
    row: Row = {column.name: None for column in SWEEP_COLUMNS}
    row |= cell["settings"] | fixed | {"codec": codec, "crf": crf}
    row["scene"] = rows[0]["scene"] if rows else row["scene"]
    row |= {
        "varied": " ".join(f"{name}={value}" for name, value in cell["varied"].items()),
        "status": status,
        "reason": reason,
        "frames": sweep["frames"],
        "frames_ok": sum(row["status"] == "ok" for row in rows),
    }
    measured = [one for one in rows if one["status"] in MEASURED_STATUSES] if status in MEASURED_STATUSES else []
    numbers = {name: _by_frame(measured, name) for name in SWEEP_MEASURES}
    for name in SWEEP_MEASURES:
        if name != "server_ms":
            valued = [one | {name: numbers[name].get(one["frame"])} for one in measured]
            row |= measure_statistics(MEASURES_OF_SWEEPS[name], valued)
    return row, numbers


def _by_frame(rows: list[Row], name: str) -> dict[int, float]:
    values = ((row["frame"], _memory(row) if name == "atlas_mb" else row[name]) for row in rows)
    return {frame: value for frame, value in values if value is not None}


def _memory(row: Row) -> float | None:
    """Megabytes of the atlas at four bytes per texel, or of the lists before compression."""
    if row["atlas_width"]:
        return float(row["atlas_width"] * row["atlas_height"] * 4e-6)
    return row["bytes_video"] / row["compression_ratio"] * 1e-6 if row["compression_ratio"] else None


def _status(rows: list[Row], frames: int) -> tuple[str, str | None]:
    """The worst status of the frames and the first reason for it; `unfinished` where frames are missing."""
    statuses = {row["status"] for row in rows}
    for status in WORST_FIRST[:4]:
        if status in statuses:
            return status, next(row["reason"] for row in rows if row["status"] == status)
    if len(rows) < frames:
        return "unfinished", f"{len(rows)} of {frames} frames are done."
    return next((row["status"], row["reason"]) for row in rows)


def candidates(points: Sequence[Point], cost: str, error: str) -> tuple[list[Point], list[Candidate]]:
    """The points that have both measures, and each as a candidate, its errors turned so that lower is better."""
    sign = -1 if BY_NAME[error].better == "higher" else 1
    usable = [
        point
        for point in points
        if point.shown()
        and point.row[cost_column(cost)] is not None
        and point.row[f"{error}_median"] is not None
        and (cost != "server_ms" or point.row["comparable"] == "yes")
    ]
    found = []
    for point in usable:
        middle = point.row[cost_column(cost)]
        low, high = (point.row[f"{cost}_{end}"] if cost == "server_ms" else middle for end in ("low", "high"))
        errors = {frame: sign * value for frame, value in point.numbers[error].items()}
        found.append(Candidate(point.row["contender"], low, middle, high, sign * point.row[f"{error}_median"], errors))
    return usable, found


def groups(points: Sequence[Point]) -> dict[tuple[str, str], list[Point]]:
    """The points that can be compared with each other, by condition and coding, in their order."""
    found: dict[tuple[str, str], list[Point]] = defaultdict(list)
    for point in points:
        found[point.condition, point.row["coding"]].append(point)
    return found


def _mark_fronts(points: list[Point], cost: str) -> None:
    """Fill the pareto columns: `all` on the front of all contenders, `method` only on its own, `no` on neither."""
    column = f"pareto_{COSTS[cost]}"
    for of_group in groups(points).values():
        usable, found = candidates(of_group, cost, "flip")
        places = [(candidate.cost, candidate.error) for candidate in found]
        marks = dict.fromkeys(range(len(found)), "no")
        for contender in {candidate.method for candidate in found}:
            own = [index for index, candidate in enumerate(found) if candidate.method == contender]
            marks |= {own[index]: "method" for index in pareto_front([places[index] for index in own])}
        marks |= dict.fromkeys(pareto_front(places), "all")
        for index, point in enumerate(usable):
            point.row[column] = marks[index]
