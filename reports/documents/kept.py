"""The data that the documents' tables are written from: one JSON file each in reports/data, with where it came from."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypedDict

from shading_atlas_bench.errors import BenchError
from shading_atlas_bench.reports.store.csv_files import replace_file
from shading_atlas_bench.reports.store.data import DataError, read_json
from shading_atlas_bench.reports.store.records import Values

ROOT = Path(__file__).resolve().parents[2]  # of the repository
FOLDER = "reports/data"
ROWS = "rows"  # the part of a source that has only one

Row = dict[str, Any]
Parts = dict[str, list[Row]]


class DocumentError(BenchError, ValueError):
    """A document, or kept data, that cannot be used; the message is one sentence."""


@dataclass(frozen=True)
class Column:
    """A column of a table. forms: format strings over a row; the first is used whose fields all have a value.

    left: whether it is aligned to the left, as words are.
    """

    heading: str
    forms: tuple[str, ...]
    left: bool = False


@dataclass(frozen=True)
class Part:
    """One kind of rows of a source. key: fields that name a row. columns: of its table, none where it has no table.

    figure: what draws its rows as SVG, where a document shows them so.

    machine: fields that depend on the machine, such as times; all others are the same wherever they are measured. A row
    whose field `machine` is true depends on it as a whole.
    """

    key: tuple[str, ...]
    columns: tuple[Column, ...] = ()
    machine: tuple[str, ...] = ()
    figure: Callable[[list[Row]], str] | None = None


@dataclass(frozen=True)
class Source:
    """What a table is made from.

    commands: command lines of `bench`, without --out. digest: folders of their results, in that order, to rows by part.
    quick: whether it takes a minute or two, so that every change can be checked against it. scenes: files that the
    commands need beyond those named in them, as below BENCH_SCENES.
    """

    name: str
    commands: tuple[str, ...]
    digest: Callable[[Sequence[Path]], Parts]
    parts: dict[str, Part]
    quick: bool = False
    scenes: tuple[str, ...] = ()


class About(TypedDict):
    """Where rows come from: the commands that measured them, when, with what and in how many seconds, and all settings
    of their runs."""

    commands: list[str]
    commit: str
    date: str
    device: str
    driver: str
    seconds: int | float | None
    settings: list[Values]


@dataclass(frozen=True)
class Kept:
    """Rows by part, and where they come from."""

    about: About
    parts: Parts

    def as_json(self) -> str:
        """A row a line, so that a difference shows which."""
        about = ",\n".join(f"  {json.dumps(name)}: {json.dumps(value)}" for name, value in self.about.items())
        parts = []
        for name, rows in self.parts.items():
            lines = ",\n".join(f"   {json.dumps(row, ensure_ascii=False)}" for row in rows)
            parts.append(f"  {json.dumps(name)}: [\n{lines}\n  ]")
        whole = ",\n".join(parts)
        return f'{{\n "about": {{\n{about}\n }},\n "parts": {{\n{whole}\n }}\n}}\n'


def write_kept(name: str, kept: Kept, root: Path = ROOT) -> None:
    """Write the data of a source. Raises StoreError where that fails."""
    (root / FOLDER).mkdir(parents=True, exist_ok=True)
    replace_file(root / FOLDER / f"{name}.json", kept.as_json())


def read_kept(name: str, root: Path = ROOT) -> Kept | None:
    """The data of a source, None where none is kept yet. Raises DocumentError for a file that is none of these."""
    file = root / FOLDER / f"{name}.json"
    if not file.is_file():
        return None
    try:
        return read_json(file, Kept)
    except DataError as error:
        raise DocumentError(
            f"{file} is not what bench tables wrote: remove it and run bench tables {name}. {error}"
        ) from error


def checked(kept: Kept, fresh: Parts, parts: dict[str, Part]) -> Kept:
    """What has to be printed if the fresh rows are right: they, but with what depends on the machine as it is kept."""
    found = {}
    for name, rows in fresh.items():
        part = parts[name]
        before = {_key(row, part): row for row in kept.parts.get(name, [])}
        known = [row for row in rows if not before or _key(row, part) in before or not row.get("machine")]
        found[name] = [_with_kept(row, before.get(_key(row, part)), part) for row in known]
        _keep_missing(found[name], before, part)
    return Kept(kept.about, found)


def _keep_missing(rows: list[Row], before: dict[tuple[Any, ...], Row], part: Part) -> None:
    """Insert the rows that depend on the machine and that it did not give this time, where they were."""
    at = 0
    for key, row in before.items():
        place = next((place for place, other in enumerate(rows) if _key(other, part) == key), None)
        if place is None and row.get("machine"):
            rows.insert(at, row)
            place = at
        at = at if place is None else place + 1


def _with_kept(row: Row, before: Row | None, part: Part) -> Row:
    if before is None:
        return row
    if row.get("machine"):
        return before
    return row | {name: before.get(name) for name in part.machine}


def _key(row: Row, part: Part) -> tuple[Any, ...]:
    return tuple(row[name] for name in part.key)
