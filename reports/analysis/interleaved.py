"""Two sets of runs, made in turn: each process is one sample of the machine, so that small differences are found."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from shading_atlas_bench.reports.analysis.compare import ALL, EXACT, Comparison, compare
from shading_atlas_bench.reports.analysis.paces import p_value
from shading_atlas_bench.reports.store.columns import BY_NAME, MEASURED_STATUSES
from shading_atlas_bench.reports.store.csv_files import median_interval
from shading_atlas_bench.reports.store.disturbance import REFERENCE, of_frames
from shading_atlas_bench.reports.store.middle import median
from shading_atlas_bench.reports.store.results import Store

ALPHA = 0.004  # of each rank test; a comparison has dozens of them, two for every time
LEAST = 0.05  # of a difference that is called one

Key = tuple[str, str, str | None, int | None, str]  # method, variant, codec, rate, column
Medians = dict[Key, tuple[float, float]]  # of a time, and of its ratio to the reference's


def compare_interleaved(first: Sequence[Path], second: Sequence[Path]) -> list[Comparison]:
    """All metrics of `compare`, of the first two runs; times as medians of all runs, the n-th of each set being a pair.

    A time is better or worse where a rank test over the pairs, of the processes' medians or of these over the
    reference's, says so at ALPHA, and where it differs by LEAST or more. p is the smaller one; the interval of the
    change is that of the median over the pairs. Raises what `compare` does, for any pair.
    """
    found = compare(first[0], second[0])
    runs = [[dict(_medians(folder)) for folder in folders] for folders in (first, second)]
    return [judged_by_pairs(row, *runs) if _is_timed(row) else row for row in found]


def _is_timed(row: Comparison) -> bool:
    column = BY_NAME.get(row.metric)
    return column is not None and column.kind == "time" and row.metric not in EXACT


def _medians(folder: Path) -> Iterator[tuple[Key, tuple[float, float]]]:
    """Of each time of each method and coding in a run, the median, and that of its ratio to the reference's."""
    with Store(folder, must_exist=True) as store:
        rows, reference = store.rows(), of_frames(store.statistics(), REFERENCE)
    times = [name for name, column in BY_NAME.items() if column.kind == "time" and name not in EXACT]
    values: dict[Key, list[tuple[float, float]]] = {}
    for row in rows:
        if row["status"] in MEASURED_STATUSES and reference.get(row["frame"]):
            for name in times:
                if row[name]:
                    key = (row["method"], row["variant"], row["codec"], row["crf"], name)
                    values.setdefault(key, []).append((row[name], row[name] / reference[row["frame"]]))
    for key, pairs in values.items():
        yield key, (median([time for time, _ in pairs]), median([ratio for _, ratio in pairs]))


def judged_by_pairs(
    row: Comparison,
    first: list[Medians],
    second: list[Medians],
) -> Comparison:
    """The row of a time as all pairs of runs have it. first, second: the medians of each run."""
    pairs = [
        (a[one], b[other])
        for a, b in zip(first, second, strict=True)
        if (one := _key(a, row, 0)) is not None and (other := _key(b, row, -1)) is not None
    ]
    logs = [[math.log(b[n] / a[n]) for a, b in pairs] for n in range(2)]
    tests = sorted((p_value(each), -abs(median(each)), median(each)) for each in logs if each)
    if not tests:
        return replace(row, verdict="ambiguous", p=None, low=None, high=None)
    p, _, shift = tests[0]
    sure = p < ALPHA and abs(shift) >= math.log1p(LEAST)
    better = (shift < 0) == (row.better == "lower")
    low, high = median_interval(sorted(math.expm1(value) for value in logs[0]))
    old, new = (median([pair[n][0] for pair in pairs]) for n in range(2))
    verdict = ("better" if better else "worse") if sure else "ambiguous"
    return replace(
        row,
        a=old,
        b=new,
        change=math.expm1(median(logs[0])),
        p=p,
        low=low,
        high=high,
        frames=len(pairs),
        verdict=verdict,
    )


def _key(medians: Medians, row: Comparison, end: int) -> Key | None:
    """Which median is of what a row compares, the first where it is the same for every coding; None where none is. end:
    of the first or of the last variant that the row names."""
    wanted = (row.method, row.variant.split(" -> ")[end], row.metric)
    for key in medians:
        method, variant, codec, crf, name = key
        if (method, variant, name) == wanted and (row.codec == ALL or (codec, crf) == (row.codec, row.crf)):
            return key
    return None
