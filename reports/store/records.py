"""The types of what a folder of results holds, for reports/store/data.py: a row of each table of its store, the plan of
the run, and the settings in its run.json."""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Annotated, Any, Literal, TypeAlias, TypedDict

from msgspec import Meta

from shading_atlas_bench.reports.store.columns import (
    FRAME_COLUMNS,
    FRAME_KEY,
    SKIP_COLUMNS,
    STAGE_COLUMNS,
    STATISTIC_COLUMNS,
    STATUSES,
    Column,
)

Row: TypeAlias = dict[str, Any]  # by column name, each value of its column's type or None

REQUIRED = (*(name for name in FRAME_KEY if name not in ("codec", "crf")), "status")

_MakeType: TypeAlias = Callable[[str, dict[str, Any]], type[Row]]
_typed_dict: _MakeType = TypedDict  # type: ignore[assignment]  # mypy knows only those that are written out
_LARGEST = sys.float_info.max
Finite = Annotated[float, Meta(ge=-_LARGEST, le=_LARGEST)]
WholeNumber = Annotated[int, Meta(ge=0)]

# Two levels of names are what plans of runs and sweeps have.
Plain: TypeAlias = str | int | float | bool | None
_Inner: TypeAlias = Plain | list[Plain]
Values: TypeAlias = dict[str, _Inner]
Plan: TypeAlias = dict[str, _Inner | dict[str, _Inner | dict[str, _Inner]]]


class RunFile(TypedDict):
    """What reports need of a run.json."""

    settings: Values


def row_type(
    name: str, columns: Iterable[Column], required: Collection[str], others: Mapping[str, Any] | None = None
) -> type[Row]:
    """The type of a row with these columns, for msgspec; those that are not required may be None. others: types of
    columns that are not the usual ones, by name."""
    kinds = {column.name: _kind(column) for column in columns} | dict(others or {})
    fields = {column: kind if column in required else kind | None for column, kind in kinds.items()}
    return _typed_dict(name, fields)


def _kind(column: Column) -> Any:
    if column.name == "status":
        return Literal[STATUSES]
    if column.name == "frame":
        return WholeNumber
    return Finite if column.type is float else column.type


def _without(name: str, columns: Iterable[Column]) -> list[Column]:
    return [column for column in columns if column.name != name]


def _names(columns: Iterable[Column]) -> list[str]:
    return [column.name for column in columns]


FRAME_ROW = row_type("FrameRow", FRAME_COLUMNS, REQUIRED)
REPEAT_COLUMNS = [*_without("launches", STAGE_COLUMNS), Column("repetition", "", "which timing", "count", int)]
STAGE_ROW = row_type("StageRow", STAGE_COLUMNS, _names(_without("ms", STAGE_COLUMNS)))
STATISTIC_ROW = row_type("StatisticRow", STATISTIC_COLUMNS, _names(_without("value", STATISTIC_COLUMNS)))
REPEAT_ROW = row_type("RepeatRow", REPEAT_COLUMNS, _names(_without("ms", REPEAT_COLUMNS)))
SKIP_ROW = row_type("SkipRow", SKIP_COLUMNS, ())
