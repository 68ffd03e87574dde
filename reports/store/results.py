"""The results store: one SQLite file per run, one transaction per finished frame."""

from __future__ import annotations

import json
import math
import sqlite3
from collections.abc import Iterable, Iterator, Mapping, MutableMapping, Sequence
from pathlib import Path
from typing import Any
from zlib import crc32

from shading_atlas_bench.reports.store.columns import BY_NAME, FRAME_COLUMNS, FRAME_KEY, STATUSES, Column
from shading_atlas_bench.reports.store.data import DataError, Kind, as_kind, decode_json
from shading_atlas_bench.reports.store.database import Cell, Database, StoreError
from shading_atlas_bench.reports.store.names import encodable
from shading_atlas_bench.reports.store.records import (
    FRAME_ROW,
    REPEAT_ROW,
    REQUIRED,
    STAGE_ROW,
    STATISTIC_ROW,
    Plan,
    Row,
    WholeNumber,
)

FILE = "results.sqlite"
SQL_TYPES = {str: "TEXT", int: "INTEGER", float: "REAL"}

_FRAME = "method TEXT NOT NULL, variant TEXT NOT NULL, frame INTEGER NOT NULL"
_TABLES = (
    "CREATE TABLE plan (content TEXT NOT NULL)",
    "CREATE TABLE notes (key TEXT PRIMARY KEY, value TEXT NOT NULL)",
    f"CREATE TABLE finished ({_FRAME}, PRIMARY KEY (method, variant, frame))",
    f"CREATE TABLE rows ({', '.join(f'{c.name} {SQL_TYPES[c.type]}' for c in FRAME_COLUMNS)})",
    # NULL differs from NULL in an index, so absent codecs and rates are given a value there.
    "CREATE UNIQUE INDEX row_key ON rows"
    " (scene, path_hash, method, variant, coalesce(codec, ''), coalesce(crf, -1), frame)",
    "CREATE INDEX row_frame ON rows (method, variant, frame)",
    f"CREATE TABLE stages ({_FRAME}, stage TEXT NOT NULL, ms REAL, launches INTEGER NOT NULL,"
    " PRIMARY KEY (method, variant, frame, stage))",
    f"CREATE TABLE statistics ({_FRAME}, name TEXT NOT NULL, value REAL, PRIMARY KEY (method, variant, frame, name))",
    f"CREATE TABLE repeats ({_FRAME}, repetition INTEGER NOT NULL, stage TEXT NOT NULL, ms REAL,"
    " PRIMARY KEY (method, variant, frame, repetition, stage))",
)
# Another one for every other layout of the tables, so that none is read as if it were this one.
SCHEMA_VERSION = crc32("".join(_TABLES).encode()) >> 1
_OF_FRAME = ("rows", "stages", "statistics", "repeats", "finished")

METHODS = "methods."  # in a flat plan, before a method with its parameters; their value is a hash of its files
HASHES = {
    "suite": "files of the suite itself were edited",
    "scene_hash": "the scene has another content",
    "path_hash": "the camera path is another one",
}


class Store:
    """The results of one run, in `folder`/results.sqlite.

    folder: made if absent, as the store in it is, unless must_exist. Everything written is committed at once; a frame
        is committed as a whole.
    checked: whether it is made sure first that what is read is what was written.

    Raises StoreError if must_exist and there is no store, if the file is no whole store of this version, or if its path
    is too long for SQLite; later StoreFileError, if it cannot be read or written.
    """

    def __init__(self, folder: Path, *, must_exist: bool = False, checked: bool = True) -> None:
        self.folder = Path(folder)
        self._database = Database(self.folder / FILE, _TABLES, SCHEMA_VERSION, made=not must_exist, checked=checked)
        self.notes = Notes(self, self._database)

    def close(self) -> None:
        """Close the file; nothing is pending, so this loses nothing."""
        self._database.close()

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def plan(self) -> Plan | None:
        """The plan of this run, None before `set_plan`. Raises StoreError for what is none."""
        found = self.read("plan", "SELECT content FROM plan", tuple[str])
        if not found:
            return None
        try:
            return decode_json(found[0][0], Plan, f"The table plan of {self.folder / FILE}")
        except DataError as error:
            raise StoreError(f"{error} Run again into a new folder.") from error

    def set_plan(self, plan: dict[str, Any], *, begun: bool | None = None) -> None:
        """Bind the store to a plan, given as JSON values; before it has begun its device may still change.

        begun: whether there are results of it; if None, whether a frame is finished here. Raises StoreError, naming
        each difference, if the store is bound to another one.
        """
        wanted = json.loads(json.dumps(plan))
        with self._database.transaction():
            existing = self.plan()
            begun = bool(self.finished()) if begun is None else begun
            if existing and not begun and existing | {"device": wanted.get("device")} == wanted:
                existing = None
            if existing is None:
                self._database.delete("plan")
                self._database.insert("plan", [(json.dumps(wanted, sort_keys=True),)])
        if existing is not None and existing != wanted:
            differences = "; ".join(_differences(flat(existing), flat(wanted)))
            raise StoreError(
                f"{self.folder} holds another run: {differences}. Give another --out, or the same arguments and "
                "files to resume."
            )

    def finished(self) -> set[tuple[str, str, int]]:
        """The committed frames, as (method, variant, frame)."""
        return set(self.read("finished", "SELECT method, variant, frame FROM finished", tuple[str, str, WholeNumber]))

    def commit_frame(
        self,
        method: str,
        variant: str,
        frame: int,
        rows: list[dict[str, Any]],
        stages: Iterable[tuple[str, float, int]] = (),
        statistics: Mapping[str, float] | None = None,
        repeats: Iterable[tuple[int, str, float]] = (),
    ) -> None:
        """Write all results of one frame of one method in one transaction, in place of earlier ones.

        rows: by column name of frames.csv; method, variant and frame may be left out. None, NaN and infinity mean that
            there is no value. NumPy scalars are taken as their Python values.
        stages: (stage, milliseconds, launches). statistics: name to number.
        repeats: (repetition, stage, milliseconds): every timing of `--repeat`, of which rows and stages hold medians.

        Raises StoreError for an unknown column or status, a lacking key, a value of the wrong type, or no row.
        """
        place = (str(method), str(variant), int(frame))
        named: dict[str, Cell] = dict(zip(("method", "variant", "frame"), place, strict=True))
        if not rows:
            raise StoreError(f"Frame {frame} of {method} has no row: each frame has at least one, also a failed one.")
        records = [_record({**row, **named}, row) for row in rows]
        stage_records = [(*place, stage, _number(ms), int(launches)) for stage, ms, launches in stages]
        statistic_records = [(*place, name, _number(value)) for name, value in (statistics or {}).items()]
        repeat_records = [(*place, int(repetition), stage, _number(ms)) for repetition, stage, ms in repeats]
        try:
            with self._database.transaction():
                for table in _OF_FRAME:
                    self._database.delete(table, **named)
                self._database.insert("rows", records)
                self._database.insert("stages", stage_records)
                self._database.insert("statistics", statistic_records)
                self._database.insert("repeats", repeat_records)
                self._database.insert("finished", [place])
        except sqlite3.IntegrityError as error:
            raise StoreError(
                f"Frame {frame} of {method} cannot be stored: two entries of one key ({error})."
            ) from error

    def add_repetition(
        self, method: str, variant: str, repetition: int, times: Iterable[tuple[int, str, float]]
    ) -> None:
        """Write one more timing of a method's finished frames, as (frame, stage, milliseconds), in one transaction.

        It takes the place of an earlier one of the same number. Rows and stages stay as they are.
        """
        records = [(method, variant, int(frame), int(repetition), stage, _number(ms)) for frame, stage, ms in times]
        with self._database.transaction():
            self._database.delete("repeats", method=method, variant=variant, repetition=repetition)
            self._database.insert("repeats", records)

    def rows(self) -> list[Row]:
        """All rows, by column name, sorted by the key; absent values are None and sort first.

        Raises StoreError for rows of a frame that is not finished, for a finished one without rows, and as the others
        for values of wrong types.
        """
        query = f"SELECT {', '.join(BY_NAME)} FROM rows ORDER BY {', '.join(FRAME_KEY)}"
        rows, finished = self.read("rows", query, FRAME_ROW), self.finished()
        found = {(row["method"], row["variant"], row["frame"]) for row in rows}
        for there, lacking, frames in (("rows", "finished", found - finished), ("finished", "rows", finished - found)):
            for method, variant, frame in sorted(frames)[:1]:
                raise StoreError(
                    f"{self.folder / FILE} has in its table {there} the frame {frame} of {method}[{variant}], which "
                    f"its table {lacking} lacks: run again into a new folder."
                )
        return rows

    def stages(self) -> list[Row]:
        """Time of each stage, by the column names of stages.csv, sorted by its key."""
        return self.read("stages", _of_frames("stages", "stage, ms, launches", "stage"), STAGE_ROW)

    def statistics(self) -> list[Row]:
        """What methods report, by the column names of statistics.csv, sorted by its key; also of invalid frames."""
        return self.read("statistics", _of_frames("statistics", "name, value", "name"), STATISTIC_ROW)

    def repeats(self) -> list[Row]:
        """Every repetition of a timing: place of its frame, repetition, stage and ms, sorted by all but the last."""
        return self.read("repeats", _of_frames("repeats", "repetition, stage, ms", "repetition, stage"), REPEAT_ROW)

    def read(self, table: str, query: str, kind: type[Kind], values: Sequence[Cell] = ()) -> list[Kind]:
        """The records that a query gives, each of a kind of tuple, or of row by column name.

        Raises StoreError for a value of another type, naming table, record and column.
        """
        is_tuple = issubclass(getattr(kind, "__origin__", kind), tuple)
        found = self._database.select(query, values) if is_tuple else self._database.select_named(query)
        source = f"The table {table} of {self.folder / FILE}"
        try:
            return as_kind(found, list[kind], source)  # type: ignore[valid-type]  # a type that is made when it runs
        except DataError as error:
            raise StoreError(f"{error} Run again into a new folder.") from error


class Notes(MutableMapping[str, str]):
    """Texts about a run, by key; each is committed as it is set, and iteration is sorted by key.

    Keys are PREFIX/NAME. The report shows `environment/...` (machine, device, versions), `warning/...`,
    `skipped/STAGE` (the reason as value), `scene/...` (what was found, repaired or is not supported), `device/...`,
    `label/METHOD[VARIANT]` (what it is called), `prepare_ms/METHOD[VARIANT]`, `rare/METHOD[VARIANT]/STATISTIC` (what a
    method does in a few frames only, and did in none of these) and `published/METHOD` (what changes where its
    parameters are as published). `run/complete` says that nothing is left to do.
    """

    def __init__(self, store: Store, database: Database) -> None:
        self._store, self._database = store, database

    def __getitem__(self, key: str) -> str:
        found = self._store.read("notes", "SELECT value FROM notes WHERE key = ?", tuple[str], (key,))
        if not found:
            raise KeyError(key)
        return found[0][0]

    def __setitem__(self, key: str, value: object) -> None:
        self.write({key: value})

    def write(self, values: Mapping[str, object]) -> None:
        """Set all of these in one transaction: each is one more wait for the disk."""
        with self._database.transaction():
            for key, value in values.items():
                self._database.delete("notes", key=encodable(key))
                self._database.insert("notes", [(encodable(key), encodable(str(value)))])

    def __delitem__(self, key: str) -> None:
        with self._database.transaction():
            if not self._database.delete("notes", key=key):
                raise KeyError(key)

    def __iter__(self) -> Iterator[str]:
        return iter([key for (key,) in self._store.read("notes", "SELECT key FROM notes ORDER BY key", tuple[str])])

    def __len__(self) -> int:
        return len(self._database.select("SELECT key FROM notes"))

    def under(self, prefix: str) -> dict[str, str]:
        """The notes whose key starts with `prefix`/ (the slash may be given), by the rest of their key."""
        start = f"{prefix.rstrip('/')}/"
        found = self._store.read("notes", "SELECT key, value FROM notes ORDER BY key", tuple[str, str])
        return {key.removeprefix(start): text for key, text in found if key.startswith(start)}

    def replace(self, prefix: str, texts: Mapping[str, str]) -> None:
        """Make these the notes under `prefix`/, by the rest of their key, in place of all that were there."""
        for key in self.under(prefix):
            del self[f"{prefix}/{key}"]
        self.update({f"{prefix}/{key}": text for key, text in texts.items()})


def _of_frames(table: str, values: str, order: str) -> str:
    """A query of a table of frames, with the scene and path that the frames belong to."""
    return (
        f"SELECT scene, path_hash, method, variant, frame, {values} FROM {table}"
        " JOIN (SELECT DISTINCT scene, path_hash, method, variant, frame FROM rows) USING (method, variant, frame)"
        f" ORDER BY scene, path_hash, method, variant, frame, {order}"
    )


def _record(row: dict[str, Any], given: dict[str, Any]) -> tuple[Cell, ...]:
    """A row as the values of all columns in order, checked; `given` is the row as the caller gave it."""
    unknown = [name for name in row if name not in BY_NAME]
    if unknown:
        raise StoreError(
            f"frames.csv has no column {', '.join(map(repr, unknown))}; reports/store/columns.py lists them."
        )
    for name in ("method", "variant", "frame"):
        if name in given and given[name] != row[name]:
            raise StoreError(f"A row of {row['method']} says {name} {given[name]!r} instead of {row[name]!r}.")
    record = {name: _checked(column, row.get(name)) for name, column in BY_NAME.items()}
    lacking = [name for name in REQUIRED if record[name] is None]
    if lacking:
        raise StoreError(f"A row of {row['method']} lacks {', '.join(lacking)}.")
    if record["status"] not in STATUSES:
        raise StoreError(f"The status {record['status']!r} is unknown; known are {', '.join(STATUSES)}.")
    return tuple(record.values())


def _checked(column: Column, value: Any) -> Cell:
    """The value as the column's type; None for None, NaN and infinity."""
    if hasattr(value, "item"):
        value = value.item()
    if value is None:
        return None
    if column.type is str:
        if isinstance(value, str):
            return encodable(value)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        number = _number(value)
        if number is None or column.type is float:
            return number
        if number == int(number):
            return int(value)
    raise StoreError(f"The column {column.name!r} takes {column.type.__name__}, not {value!r}.")


def _number(value: float | None) -> float | None:
    """A finite float, or None."""
    if value is None or not math.isfinite(value):
        return None
    return float(value)


def flat(value: object, prefix: str = "") -> dict[str, Any]:
    """Nested dicts as one, keys joined by dots."""
    if not isinstance(value, dict):
        return {prefix: value}
    found: dict[str, Any] = {}
    for key, inner in value.items():
        found |= flat(inner, f"{prefix}.{key}" if prefix else str(key))
    return found


def _differences(old: dict[str, Any], new: dict[str, Any]) -> list[str]:
    """What differs between two flat plans, each as part of a sentence; what hashes stand for, not they themselves."""

    def text(values: dict[str, Any], key: str) -> str:
        return json.dumps(values[key]) if key in values else "absent"

    keys = sorted(key for key in old.keys() | new.keys() if text(old, key) != text(new, key))
    methods = [key for key in keys if key.startswith(METHODS)]
    others = [key for key in keys if key not in methods]
    told = [HASHES.get(key) or f"{key} was {text(old, key)} and is now {text(new, key)}" for key in others]
    return [*_of_methods(methods, old, new), *told]


def _of_methods(keys: list[str], old: dict[str, Any], new: dict[str, Any]) -> list[str]:
    """The same of the keys `methods.NAME[PARAMETERS]`."""

    def names(chosen: Iterable[str]) -> list[str]:
        return list(dict.fromkeys(key.removeprefix(METHODS).partition("[")[0] for key in chosen))

    edited = names(key for key in keys if key in old and key in new)
    before, now = (names(key for key in values if key.startswith(METHODS)) for values in (old, new))
    changed = names(key for key in keys if key not in old or key not in new)
    found = [f"the files of {name} were edited" for name in edited]
    found += [f"{name} had other parameters" for name in changed if name in before and name in now]
    if left := [name for name in changed if name not in now]:
        found.append(f"it has {', '.join(left)}, too")
    if lacking := [name for name in changed if name not in before]:
        found.append(f"it lacks {', '.join(lacking)}")
    return found
