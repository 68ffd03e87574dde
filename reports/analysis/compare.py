"""Comparing two runs of the same work, metric by metric, by a rank test on paired frames; times as paces.py says."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from shading_atlas_bench.reports.analysis.paces import Pace, p_value, sure_change
from shading_atlas_bench.reports.store.columns import BY_NAME, MEASURED_STATUSES, MEASURES, Column, statistic_columns
from shading_atlas_bench.reports.store.csv_files import after_keyframe, measure_statistics, median_interval
from shading_atlas_bench.reports.store.database import StoreError
from shading_atlas_bench.reports.store.labels import Labels, read_labels
from shading_atlas_bench.reports.store.middle import mean, median
from shading_atlas_bench.reports.store.results import Store, flat

# A difference counts if the test would find one like it by chance in less than 1 of 100 comparisons of equal runs...
ALPHA = 0.01
# ...and if it is large enough to matter.
THRESHOLD = 0.01
THRESHOLDS = {"peak_mb": 0.10}  # which no two processes have the same
EXACT = ("network_ms",)  # times that follow from bytes

ALL = "all"  # in place of a codec
# Sizes that are one number for a whole run: exact, so that no test is needed to tell two of them apart.
_OF_TOTAL = {column.name: column for column in statistic_columns(BY_NAME["bytes_total"])}
WHOLE = tuple(_OF_TOTAL[f"bytes_total_{suffix}"] for suffix in ("kbit_s", "max", "key", "total"))
OK = Column("ok", "0..1", "share of frames with status ok", "status", float, "higher")

Coding = tuple[str | None, int | None]
Method = tuple[str, str]
Frames = dict[int, dict[str, Any]]
Rows = dict[Method, dict[Coding, Frames]]


class CompareError(StoreError):
    """Two runs that cannot be compared; the message says why."""


@dataclass(frozen=True)
class Named:
    """What is compared: fields of a Comparison."""

    method: str
    variant: str
    label: str


@dataclass(frozen=True)
class Comparison:
    """One metric of one method in two runs.

    variant, label: of run a, and `A -> B` where variants of the runs are matched. codec: `all`, with crf None, for a
        metric that is the same for every coding; None for frames that were not coded. a, b: medians over the paired
        frames (for `ok` the shares), those of sizes without the keyframe, as in summary.csv; of WHOLE the values of the
        runs' common frames. mean_a, mean_b: means over the same frames as the medians, None for `ok` and WHOLE. change:
        median of the paired differences b - a over |a|, None where a is 0. p: of the Wilcoxon signed-rank test,
        two-sided, 1.0 where all pairs are equal, None for WHOLE. frames: pairs compared.
    verdict: `better` or `worse` (of b) where p < ALPHA and the change reaches THRESHOLD, of times where it is sure
        (paces.py); `same` where all pairs are equal or the change is certain but smaller; else `ambiguous`. WHOLE has
        no `ambiguous`: its change is certain.
    low, high: the 95 % interval of `change`, None where there are too few pairs.
    """

    method: str
    variant: str
    label: str
    codec: str | None
    crf: int | None
    metric: str
    unit: str
    better: str
    a: float
    b: float
    mean_a: float | None
    mean_b: float | None
    change: float | None
    p: float | None
    frames: int
    verdict: str
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True)
class _Run:
    """What is read of a run's folder. drawn: the hash of all that is drawn of the scene."""

    rows: list[dict[str, Any]]
    labels: Labels
    drawn: Any
    pace: Pace


def compare(folder_a: Path, folder_b: Path) -> list[Comparison]:
    """All metrics with a better direction of all methods in both runs, sorted by method, variant, then metric.

    Frames are paired by their number; frames without numbers in either run count only for the metric `ok`. Methods
    are matched by their variant; where both runs hold a single, different variant of a method, these two are compared.

    Raises StoreError if a folder has no results, CompareError if the runs differ in scene or path or share no method.
    """
    first, second = _read(folder_a), _read(folder_b)
    for name in ("scene_hash", "path_hash"):
        a, b = ({row[name] for row in run.rows} for run in (first, second))
        if a != b:
            raise CompareError(
                f"{folder_a} and {folder_b} differ in {name} ({_list(a)} and {_list(b)}): "
                "only runs of the same scene and path can be compared frame by frame."
            )
    if None not in (first.drawn, second.drawn) and first.drawn != second.drawn:  # runs of earlier versions have none
        raise CompareError(
            f"{folder_a} and {folder_b} differ in drawn_hash ({first.drawn} and {second.drawn}): the scene's triangles "
            "are the same, but its cameras, its route or whether it is a place differ, and so do shadow and "
            "environment maps."
        )
    grouped_a, grouped_b = _group(first.rows), _group(second.rows)
    matches = _matches(grouped_a, grouped_b)
    if not matches:
        raise CompareError(
            f"{folder_a} and {folder_b} have no method in common: {_names(grouped_a)}; {_names(grouped_b)}."
        )
    return [
        comparison
        for method_a, method_b in matches
        for comparison in _compare_method(
            _named(method_a, method_b, first.labels[method_a], second.labels[method_b]),
            grouped_a[method_a],
            grouped_b[method_b],
            (first.pace, second.pace),
        )
    ]


def differences(folder_a: Path, folder_b: Path) -> list[str]:
    """Sentences about what else differs between two runs: settings, methods' code, frames, methods that only one of
    them has."""
    with Store(folder_a, must_exist=True) as a, Store(folder_b, must_exist=True) as b:
        plans = [flat(store.plan() or {}) for store in (a, b)]
        labels_a, labels_b = read_labels(a), read_labels(b)
        counts = [len({row["frame"] for row in store.rows()}) for store in (a, b)]
    found = []
    for (method, variant), label in labels_a.items():
        codes = {plan.get(f"methods.{method}[{variant}]") for plan in plans}
        if None not in codes and len(codes) == 2:
            found.append(f"the code of {label}")
    if counts[0] != counts[1]:
        found.append(f"{counts[0]} frames in A, {counts[1]} in B: those that both have are compared")
    for key in sorted(set(plans[0]) | set(plans[1])):
        old, new = (plan.get(key) for plan in plans)
        if old != new and not key.startswith("methods") and key != "settings.frames":
            found.append(f"{key.removeprefix('settings.')}: {old} in A, {new} in B")
    for name, here, there in (("A", labels_a, labels_b), ("B", labels_b, labels_a)):
        lone = [label for key, label in here.items() if key not in there]
        if lone and len(here) > 1:
            found.append(f"only {name} has {', '.join(lone)}")
    return found


def noise(folder: Path) -> list[str]:
    """What a run says of its machine's noise."""
    with Store(folder, must_exist=True) as store:
        texts = store.notes.under("warning")
    return [text for key, text in texts.items() if key.isdigit() or key.startswith("disturbed/")]


def _read(folder: Path) -> _Run:
    with Store(folder, must_exist=True) as store:
        drawn = (store.plan() or {}).get("drawn_hash")
        return _Run(store.rows(), read_labels(store), drawn, Pace.of(store.statistics()))


def _group(rows: list[dict[str, Any]]) -> Rows:
    grouped: Rows = defaultdict(lambda: defaultdict(dict))
    for row in rows:
        grouped[row["method"], row["variant"]][row["codec"], row["crf"]][row["frame"]] = row
    return grouped


def _matches(a: Rows, b: Rows) -> list[tuple[Method, Method]]:
    matches = [(key, key) for key in a if key in b]
    for name in sorted({method for method, _ in a}):
        ours, theirs = ([key for key in rows if key[0] == name] for rows in (a, b))
        if len(ours) == len(theirs) == 1 and ours != theirs:
            matches.append((ours[0], theirs[0]))
    return sorted(matches)


def _named(a: Method, b: Method, label_a: str, label_b: str) -> Named:
    """What is compared; of one variant the label in run a, as runs of earlier versions may call it otherwise."""
    pairs = (a[1], b[1]), (label_a, label_b)
    variant, label = (one if a == b or one == other else f"{one} -> {other}" for one, other in pairs)
    return Named(a[0], variant, label)


def _compare_method(
    of: Named, a: dict[Coding, Frames], b: dict[Coding, Frames], paces: tuple[Pace, Pace]
) -> list[Comparison]:
    codings = [coding for coding in a if coding in b]
    found = []
    for metric in (OK, *MEASURES):
        if not metric.better:
            continue
        pairs = {coding: _pairs(metric, a[coding], b[coding]) for coding in codings}
        pairs = {coding: values for coding, values in pairs.items() if values}
        if len(pairs) > 1 and len({tuple(values.values()) for values in pairs.values()}) == 1:
            pairs = {(ALL, None): next(iter(pairs.values()))}
        found += [_judge(of, coding, metric, values, paces) for coding, values in pairs.items()]
        if metric.name == "bytes_total":
            found += [row for coding in codings for row in _judge_whole(of, coding, a[coding], b[coding])]
    return found


def _common(a: Frames, b: Frames) -> list[int]:
    """The frames with numbers in both runs."""
    frames = sorted(a.keys() & b.keys())
    return [f for f in frames if a[f]["status"] in MEASURED_STATUSES and b[f]["status"] in MEASURED_STATUSES]


def _pairs(metric: Column, a: Frames, b: Frames) -> dict[int, tuple[float, float]]:
    """The values of a metric in both runs, by frame."""
    if metric is OK:
        common = sorted(a.keys() & b.keys())
        return {frame: (float(a[frame]["status"] == "ok"), float(b[frame]["status"] == "ok")) for frame in common}
    values = {frame: (a[frame][metric.name], b[frame][metric.name]) for frame in _common(a, b)}
    return {frame: pair for frame, pair in after_keyframe(metric.name, values).items() if None not in pair}


def _judge(
    of: Named, coding: Coding, metric: Column, values: dict[int, tuple[float, float]], paces: tuple[Pace, Pace]
) -> Comparison:
    middle, pairs = mean if metric is OK else median, list(values.values())
    old, new = zip(*pairs, strict=True)
    a, b = float(middle(old)), float(middle(new))
    shift = float(middle([after - before for before, after in pairs]))
    p = p_value([after - before for before, after in pairs])
    if all(before == after for before, after in pairs):
        verdict = "same"
    elif metric.kind == "time" and metric.name not in EXACT:
        sure = sure_change(values, *paces)
        verdict = "ambiguous" if sure is None else _direction(metric, sure - 1)
    elif p >= ALPHA:
        verdict = "ambiguous"
    else:
        verdict = _direction(metric, shift) if _matters(metric, a, shift) else "same"
    low, high = median_interval(sorted((after - before) / abs(before) for before, after in pairs if before))
    return Comparison(
        method=of.method,
        variant=of.variant,
        label=of.label,
        codec=coding[0],
        crf=coding[1],
        metric=metric.name,
        unit=metric.unit,
        better=metric.better,
        a=a,
        b=b,
        mean_a=None if metric is OK else mean(old),
        mean_b=None if metric is OK else mean(new),
        change=shift / abs(a) if a else None,
        p=p,
        frames=len(pairs),
        verdict=verdict,
        low=None if metric is OK else low,
        high=None if metric is OK else high,
    )


def _judge_whole(of: Named, coding: Coding, a: Frames, b: Frames) -> Iterator[Comparison]:
    """What two runs sent as a whole, in the frames that both have."""
    common = _common(a, b)
    old, new = (measure_statistics(BY_NAME["bytes_total"], [run[frame] for frame in common]) for run in (a, b))
    for column in WHOLE:
        before, after = old[column.name], new[column.name]
        if before is None or after is None:
            continue
        shift = after - before
        yield Comparison(
            method=of.method,
            variant=of.variant,
            label=of.label,
            codec=coding[0],
            crf=coding[1],
            metric=column.name,
            unit=column.unit,
            better=column.better,
            a=float(before),
            b=float(after),
            mean_a=None,
            mean_b=None,
            change=shift / abs(before) if before else None,
            p=None,
            frames=len(common),
            verdict=_direction(column, shift) if _matters(column, before, shift) else "same",
        )


def _matters(metric: Column, before: float, shift: float) -> bool:
    """Whether a difference is large enough to be called one."""
    return shift != 0 and abs(shift) >= THRESHOLDS.get(metric.name, THRESHOLD) * abs(before)


def _direction(metric: Column, shift: float) -> str:
    return "better" if (shift > 0) == (metric.better == "higher") else "worse"


def _list(values: set[str]) -> str:
    return ", ".join(sorted(str(value) for value in values)) or "none"


def _names(rows: Rows) -> str:
    return _list({method for method, _ in rows})
