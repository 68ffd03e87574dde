"""A results store whose cells hold anything: reports and comparisons of it, or an error for people."""

from __future__ import annotations

import contextlib
import shutil
import sqlite3
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from shading_atlas_bench.harness.cli.comparison import show_comparison
from shading_atlas_bench.harness.cli.report import show_report
from shading_atlas_bench.harness.cli.summary import show_summary
from shading_atlas_bench.reports.store.columns import BY_NAME
from shading_atlas_bench.reports.store.database import StoreError
from shading_atlas_bench.reports.store.results import FILE, Store
from tests.fuzz.cases import fuzzed, nothing_beside, one_sentence
from tests.fuzz.values import DEEP, TEXTS
from tests.reports.synthetic import make_store

FRAMES = 2
COLUMNS = {
    "rows": tuple(BY_NAME),
    "stages": ("method", "variant", "frame", "stage", "ms", "launches"),
    "statistics": ("method", "variant", "frame", "name", "value"),
    "finished": ("method", "variant", "frame"),
    "notes": ("key", "value"),
    "plan": ("content",),
}
CELLS = st.one_of(
    st.none(),
    st.integers(-(2**63), 2**63 - 1),
    st.sampled_from([0, 1, -1, 7, 10**15, 2**62]),
    st.floats(),
    st.sampled_from([1e308, -1e308, 5e-324, 1e100, 0.0]),
    TEXTS.map(lambda text: text.encode("utf-8", errors="backslashreplace").decode()),
    st.sampled_from(["ok", "skipped", "failed", "none", "jpeg", "device/name", "saved/x", "label/sas[]", '{"a": 1}']),
    st.binary(max_size=8),
    DEEP.map(lambda levels: "[" * levels),
)


@st.composite
def statements(draw: st.DrawFn) -> tuple[str, tuple[object, ...]]:
    """SQL that puts a value into a column of some rows, takes rows out, or makes other tables."""
    table = draw(st.sampled_from(sorted(COLUMNS)))
    where = draw(st.sampled_from(["", " WHERE rowid % 3 = 0", " WHERE rowid = 1"]))
    how = draw(st.sampled_from(["set"] * 8 + ["raw", "delete", "schema"]))
    column = draw(st.sampled_from(COLUMNS[table]))
    if how == "set":
        return f"UPDATE OR IGNORE {table} SET {column} = ?{where}", (draw(CELLS),)
    if how == "raw":  # text that is no UTF-8
        return f"UPDATE OR IGNORE {table} SET {column} = CAST(? AS TEXT){where}", (draw(st.binary(max_size=8)),)
    if how == "delete":
        return f"DELETE FROM {table}{where}", ()
    endless = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i AS content FROM n"
    return draw(
        st.sampled_from(
            [
                "CREATE TRIGGER t AFTER DELETE ON notes BEGIN DELETE FROM rows; END",
                f"DROP TABLE {table}",
                "PRAGMA user_version = 0",
                f"ALTER TABLE {table} ADD COLUMN another",
                f"CREATE VIEW more AS {endless}",
            ]
        )
    ), ()


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A store as it was made, and a place for one that is changed."""
    place = tmp_path_factory.mktemp("rows")
    make_store(place / "whole" / "run", FRAMES)
    (place / "one" / "run").mkdir(parents=True)
    return place / "whole" / "run", place / "one" / "run"


def seal(folder: Path) -> None:
    """Make the checksum hold, as somebody would who wants to be believed; where nothing can be read, it does not."""
    with contextlib.suppress(StoreError), Store(folder, checked=False) as store:
        store._database.select("UPDATE seal SET value = ?", (store._database._sum(),))


@fuzzed
@given(st.lists(statements(), min_size=1, max_size=3))
def test_a_store_s_rows(folders: tuple[Path, Path], changes: list[tuple[str, tuple[object, ...]]]) -> None:
    whole, folder = folders
    shutil.copy(whole / FILE, folder / FILE)
    connection = sqlite3.connect(folder / FILE, isolation_level=None)
    for statement, values in changes:
        try:
            connection.execute(statement, values)
        except sqlite3.Error:  # it is no change, then
            continue
    connection.close()
    seal(folder)
    with nothing_beside(folder):
        with one_sentence():
            show_report(folder)
        with one_sentence():
            show_comparison(whole, folder)
        with one_sentence():
            show_summary(folder)
