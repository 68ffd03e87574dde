"""The CSV files of a run, made from its store: frames.csv, summary.csv, stages.csv and statistics.csv."""

from __future__ import annotations

import csv
import errno
import io
import os
import re
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from glob import escape
from itertools import groupby
from math import comb
from pathlib import Path
from typing import Any, TypeVar

import psutil

from shading_atlas_bench.reports.store.columns import (
    FRAME_COLUMNS,
    FRAME_KEY,
    KEYFRAME,
    KEYFRAME_APART,
    MEASURED_STATUSES,
    MEASURES,
    SENT,
    SKIP_COLUMNS,
    STAGE_COLUMNS,
    STATISTIC_COLUMNS,
    Column,
    summary_columns,
)
from shading_atlas_bench.reports.store.data import DataError, decode_json, read_text
from shading_atlas_bench.reports.store.database import StoreError, StoreFileError
from shading_atlas_bench.reports.store.middle import finite, mean, median
from shading_atlas_bench.reports.store.records import SKIP_ROW, Row
from shading_atlas_bench.reports.store.results import Store

Value = TypeVar("Value")

# A cell that begins so is a formula to a spreadsheet, whoever wrote it. One apostrophe more before it makes it text.
FORMULA = re.compile(r"'*[=+\-@\t\r]")

_OPEN = "is it open in another program?"  # Windows lets nobody write such a file
_OTHERS = "make it and its folder writable, or give another folder."
_REFUSED = _OPEN if sys.platform == "win32" else _OTHERS
_HINTS = {
    errno.EACCES: _REFUSED,
    errno.EPERM: _REFUSED,
    errno.EISDIR: "delete that folder, or give another one.",
    errno.ENOSPC: "make room, and run again.",
    errno.EDQUOT: "make room, and run again.",
    errno.EROFS: "give another folder.",
    errno.EIO: "is the disk full, or failing?",
    errno.ENOENT: "was its folder deleted? Run again.",
}

SUMMARY_KEY = tuple(name for name in FRAME_KEY if name != "frame")


def write_all(folder: Path) -> None:
    """Write the four files, and skips.csv where skips were measured, beside the store in `folder`, each replaced at
    once. Raises StoreError without a store."""
    with Store(folder, must_exist=True) as store:
        rows, stages, statistics = store.rows(), store.stages(), store.statistics()
        saved = list(read_saved(store.notes.under("saved")).values())
    write_csv(folder / "frames.csv", FRAME_COLUMNS, rows)
    write_csv(folder / "summary.csv", summary_columns(), summarise(rows))
    write_csv(folder / "stages.csv", STAGE_COLUMNS, stages)
    write_csv(folder / "statistics.csv", STATISTIC_COLUMNS, statistics)
    if saved:
        write_csv(folder / "skips.csv", SKIP_COLUMNS, saved)


def read_saved(texts: Mapping[str, str]) -> dict[str, Row]:
    """The rows of skips.csv from the notes that hold them. Raises StoreError for others."""
    try:
        return {
            name: decode_json(text, SKIP_ROW, f"The note saved/{name} of the store") for name, text in texts.items()
        }
    except DataError as error:
        raise StoreError(f"{error} Run again into a new folder.") from error


def write_csv(path: Path, columns: Sequence[Column], rows: Iterable[dict[str, Any]]) -> None:
    """Write rows in their order; None becomes an empty cell, a float the shortest text that reads back the same.

    A text is one line, and no formula: see FORMULA.
    """
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([column.name for column in columns])
    writer.writerows([_cell(row[column.name]) for column in columns] for row in rows)
    replace_file(path, text.getvalue())


def read_csv(path: Path) -> list[dict[str, str]]:
    """The rows of a CSV file of the suite, by column name, texts as they were given to `write_csv`.

    Raises DataError where it is none.
    """
    try:
        rows = list(csv.DictReader(io.StringIO(read_text(path), newline=""), strict=True, restkey="", restval=""))
    except csv.Error as error:
        raise DataError(f"{path} is not CSV: {error}.") from error
    if any("" in row for row in rows):
        raise DataError(f"{path} is no table: a row has more cells than its head.")
    return [{name: _plain(text) for name, text in row.items()} for row in rows]


def replace_file(path: Path, text: str) -> None:
    """Write a UTF-8 file so that a reader, or a kill, never meets half of it. Raises StoreFileError where that fails.

    What a process left that was killed here is deleted.
    """
    part = path.with_name(f".{path.name}.{os.getpid()}")
    with written(path):
        for left in path.parent.glob(f".{escape(path.name)}.*"):
            if left.suffix[1:].isdecimal() and not psutil.pid_exists(int(left.suffix[1:])):
                left.unlink(missing_ok=True)
        try:
            part.write_text(text, encoding="utf-8", newline="")
            os.replace(part, path)
        except BaseException:
            with suppress(OSError):
                part.unlink(missing_ok=True)
            raise


@contextmanager
def written(path: Path) -> Iterator[None]:
    """Raise StoreFileError, which says what to do, where a file cannot be written in the block."""
    try:
        yield
    except OSError as error:
        hint = _HINTS.get(error.errno or 0, "give another folder.")
        raise StoreFileError(f"{path} cannot be written ({error.strerror or error}): {hint}") from error


def summarise(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The rows of summary.csv from those of frames.csv, which are sorted by their key.

    Statistics are over the frames with status ok or overflow; one without any value is None.
    """
    return [_summary(list(group)) for _, group in groupby(rows, lambda row: [row[name] for name in SUMMARY_KEY])]


def _summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    carried = [column.name for column in summary_columns() if column.name in rows[0]]
    summary = {name: rows[0][name] for name in carried}
    measured = [row for row in rows if row["status"] in MEASURED_STATUSES]
    counts = Counter(row["status"] for row in rows)
    summary |= {
        "frames": len(rows),
        "frames_ok": counts["ok"],
        "frames_overflow": counts["overflow"],
        "frames_skipped": counts["skipped"],
        "frames_failed": counts["invalid"] + counts["timeout"] + counts["failed"],
    }
    for measure in MEASURES:
        summary |= measure_statistics(measure, measured)
    if len(measured) < len(rows):  # a sum over some of the frames is no total
        summary |= {f"{name}_total": None for name in SENT}
    return summary


def measure_statistics(measure: Column, rows: Sequence[dict[str, Any]]) -> dict[str, float | None]:
    """The values of columns.statistic_columns from the measured rows of one key of frames.csv."""
    name = measure.name
    valued = [row for row in rows if row[name] is not None]
    values = after_keyframe(name, {row["frame"]: row[name] for row in valued}).values()
    found = spread(list(values))
    if name in KEYFRAME_APART:
        found["key"] = next((row[name] for row in valued if row["frame"] == KEYFRAME), None)
    if name in SENT:
        found["total"] = finite(sum(row[name] for row in valued)) if valued else None
        pace = valued[0]["frame_rate"] if valued else None
        found["kbit_s"] = finite(None if pace is None or found["mean"] is None else found["mean"] * 8 * pace / 1000)
    return {f"{name}_{suffix}": value for suffix, value in found.items()}


def measured_statistics(rows: Sequence[dict[str, Any]], statistics: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Those of what methods report that are of frames that were measured."""
    bad = {(r["method"], r["variant"], r["frame"]) for r in rows if r["status"] not in MEASURED_STATUSES}
    return [row for row in statistics if (row["method"], row["variant"], row["frame"]) not in bad]


def after_keyframe(name: str, values: Mapping[int, Value]) -> dict[int, Value]:
    """The values, by frame, that a measure's statistics are over."""
    return {frame: value for frame, value in values.items() if frame != KEYFRAME or name not in KEYFRAME_APART}


def spread(values: Sequence[float]) -> dict[str, float | None]:
    """Median, the ends of its interval, mean and largest of values in any order; None without values."""
    low, high = median_interval(sorted(values))
    return {
        "median": float(median(values)) if values else None,
        "low": low,
        "high": high,
        "mean": mean(values) if values else None,
        "max": max(values, default=None),
    }


def median_interval(values: Sequence[float]) -> tuple[float | None, float | None]:
    """Ends of the 95 % interval of the median of sorted values; None below 6 values, which cannot give one.

    The median lies below the k-th smallest of n values with probability P(B < k), B binomial (n, 1/2). The interval is
    from the k-th smallest to the k-th largest, for the largest k with P(B < k) <= 2.5 % (David and Nagaraja, Order
    Statistics, section 7.1).
    """
    n = len(values)
    k, below = 0, 0  # below counts the outcomes with B < k, out of 2^n
    while 40 * (below + comb(n, k)) <= 2**n:
        below += comb(n, k)
        k += 1
    if k == 0:
        return None, None
    return float(values[k - 1]), float(values[n - k])


def _cell(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, str):
        return text_cell(value)
    return repr(value)


def text_cell(text: str) -> str:
    """A text as a cell: one line per row, for every reader, and no formula."""
    line = " ".join(text.splitlines())
    return f"'{line}" if FORMULA.match(line) else line


def _plain(cell: str) -> str:
    """A cell as it was given."""
    return cell[1:] if cell.startswith("'") and FORMULA.match(cell) else cell
