"""The store keeps whole frames only, refuses what it does not know, and says what is wrong."""

from __future__ import annotations

import math
import os
import shutil
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from shading_atlas_bench.reports.store.columns import DOCUMENT, FRAME_COLUMNS, document
from shading_atlas_bench.reports.store.csv_files import write_all
from shading_atlas_bench.reports.store.database import StoreError, StoreFileError
from shading_atlas_bench.reports.store.results import FILE, Store
from tests.reports.synthetic import COMMON, METHODS, PLAN, alter, frame_rows, make_store

ISSUE_ORDER = """scene,scene_hash,path,path_hash,frame_rate,method,variant,codec,crf,frame,status,reason,width,height,
fov,cell_radius,cell_fov,latency,reference_eye,bandwidth,device,seed,pvs_triangles,placed_triangles,samples,
sample_budget,atlas_width,atlas_height,fill,pvs_ms,structs_ms,
gather_ms,server_ms,serialise_ms,fill_ms,encode_ms,network_ms,decode_ms,receive_ms,draw_host_ms,client_ms,frame_ms,
wall_ms,bytes_total,bytes_video,bytes_alpha,bytes_metadata,bytes_geometry,
compression_ratio,flip,view_dependence,dssim,iwssim,psnr,delta_e,stretch_l2,stretch_linf,coherence,coherence_bytes,missing_px,holes_px,
peak_mb,skipped"""
ROW = COMMON | {"codec": "none", "status": "ok"}


def test_columns_are_the_promised_ones_and_documented() -> None:
    assert [column.name for column in FRAME_COLUMNS] == ISSUE_ORDER.replace("\n", "").split(",")
    assert DOCUMENT.read_text(encoding="utf-8") == document(), "run python -m shading_atlas_bench.reports.store.columns"


def test_everything_committed_is_read_back(tmp_path: Path) -> None:
    make_store(tmp_path)
    with Store(tmp_path, must_exist=True) as store:
        assert store.plan() == PLAN
        assert store.finished() == {(m, v, f) for m, (v, _, _) in METHODS.items() for f in range(12)}
        rows = store.rows()
        assert len(rows) == 3 * 12 * 5
        found = [row for row in rows if (row["method"], row["frame"]) == ("sas", 3)]
        wanted = sorted(frame_rows("sas", 3), key=lambda row: (row["codec"], row["crf"] or -1))
        for row, given in zip(found, wanted, strict=True):
            assert {name: row[name] for name in given} == given
            assert all(row[name] is None for name in row.keys() - given.keys() - {"method", "variant", "frame"})
        assert {row["stage"]: row["launches"] for row in store.stages() if row["method"] == "bins"}[
            "structs/place"
        ] == 5
        assert [r["value"] for r in store.statistics() if (r["method"], r["name"]) == ("sas", "bias")][5] == 1.0
        assert len(store.repeats()) == 3 * 12 * 2
        assert store.notes.under("warning") == {
            "noise": "Repeated timings spread by 14 %: other programs were running."
        }


def test_missing_and_infinite_values_are_absent(tmp_path: Path) -> None:
    with Store(tmp_path) as store:
        row = ROW | {"psnr": float("inf"), "flip": float("nan"), "dssim": None, "samples": np.int64(7)}
        row |= {"iwssim": np.float32("nan"), "bytes_video": float("nan"), "fill": np.float32(0.5)}
        store.commit_frame("sas", "", 0, [row], [("a", float("nan"), 1)], {"b": float("-inf")})
        (found,) = store.rows()
        assert [found[name] for name in ("psnr", "flip", "dssim", "iwssim", "bytes_video")] == [None] * 5
        assert (found["samples"], found["fill"]) == (7, 0.5)
        assert (store.stages()[0]["ms"], store.statistics()[0]["value"]) == (None, None)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"flipp": 0.1}, "flipp"),
        ({"status": "fine"}, "fine"),
        ({"status": None}, "status"),
        ({"path_hash": None}, "path_hash"),
        ({"samples": 1.5}, "samples"),
        ({"samples": True}, "samples"),
        ({"flip": "0.1"}, "flip"),
        ({"device": 3}, "device"),
        ({"frame": 4}, "frame"),
    ],
)
def test_wrong_rows_are_refused_and_nothing_is_kept(tmp_path: Path, change: dict, named: str) -> None:
    with Store(tmp_path) as store:
        with pytest.raises(StoreError, match=named):
            store.commit_frame("sas", "", 3, [ROW, ROW | {"codec": "jpeg"} | change])
        assert store.finished() == set()
        assert store.rows() == []


def test_two_rows_of_one_key_are_refused_and_the_earlier_frame_stays(tmp_path: Path) -> None:
    with Store(tmp_path) as store:
        store.commit_frame("sas", "", 3, [ROW | {"flip": 0.5}], [("a", 1.0, 1)])
        with pytest.raises(StoreError, match="two entries"):
            store.commit_frame("sas", "", 3, [ROW, ROW])
        with pytest.raises(StoreError, match="no row"):
            store.commit_frame("sas", "", 3, [])
        assert [row["flip"] for row in store.rows()] == [0.5]
        store.commit_frame("sas", "", 3, [ROW | {"flip": 0.25}], [("b", 1.0, 1)])
        assert [row["flip"] for row in store.rows()] == [0.25]
        assert [row["stage"] for row in store.stages()] == ["b"]


def test_another_plan_is_refused_naming_each_difference(tmp_path: Path) -> None:
    with Store(tmp_path) as store:
        store.set_plan(PLAN)
        store.set_plan(PLAN)
        other = {"settings": PLAN["settings"] | {"frames": 13, "crf": (5,)}, "extra": None}
        with pytest.raises(StoreError) as caught:
            store.set_plan(other)
        for part in (
            "settings.frames was 12 and is now 13",
            "settings.crf",
            "the scene has another content",
            "extra was absent",
        ):
            assert part in str(caught.value)
        assert "seed" not in str(caught.value)
        assert store.plan() == PLAN


@pytest.mark.parametrize(
    ("now", "told"),
    [
        ({"grid[a=1]": "y", "sas[b=1]": "x"}, "the files of grid were edited"),
        ({"grid[a=2]": "x", "sas[b=1]": "x"}, "grid had other parameters"),
        ({"grid[a=1]": "x", "grid[a=2]": "x"}, "grid had other parameters; it has sas, too"),
        ({"tss[c=1,d=2]": "x"}, "it has grid, sas, too; it lacks tss"),
        ({"grid": "x"}, "grid had other parameters; it has sas, too"),
    ],
)
def test_of_methods_it_is_said_what_was_done_to_them(tmp_path: Path, now: dict, told: str) -> None:
    with Store(tmp_path) as store:
        store.set_plan({"methods": {"grid[a=1]": "x", "sas[b=1]": "x"}})
        with pytest.raises(StoreError) as caught:
            store.set_plan({"methods": now})
    assert str(caught.value).startswith(f"{tmp_path} holds another run: {told}. Give")


def test_before_the_first_frame_the_device_may_change(tmp_path: Path) -> None:
    """As it does where a compiler dies and the next device goes on."""
    with Store(tmp_path) as store:
        store.set_plan(PLAN | {"device": "first"})
        store.set_plan(PLAN | {"device": "second"})
        assert (store.plan() or {})["device"] == "second"
        with pytest.raises(StoreError, match="the scene has another content"):
            store.set_plan(PLAN | {"device": "third", "scene_hash": "another"})
        store.commit_frame("sas", "", 0, [ROW])
        with pytest.raises(StoreError, match=r"device was \"second\""):
            store.set_plan(PLAN | {"device": "first"})


def test_a_store_with_other_columns_is_refused_in_words(tmp_path: Path) -> None:
    make_store(tmp_path)
    with closing(sqlite3.connect(tmp_path / "results.sqlite")) as connection:
        connection.execute("PRAGMA user_version = 1")
    with pytest.raises(StoreError, match="another version"):
        Store(tmp_path)


def test_another_repetition_takes_the_place_of_one_of_its_number_only(tmp_path: Path) -> None:
    make_store(tmp_path)
    with Store(tmp_path) as store:
        before = store.repeats()
        for ms in (7.0, 8.0):
            store.add_repetition("sas", METHODS["sas"][0], 2, [(frame, "structs/all", ms) for frame in range(12)])
        added = [row for row in store.repeats() if row not in before]
        assert [(row["method"], row["repetition"], row["frame"], row["ms"]) for row in added] == [
            ("sas", 2, frame, 8.0) for frame in range(12)
        ]
        assert len(store.repeats()) == len(before) + 12


def test_reading_writes_nothing_into_what_is_no_store(tmp_path: Path) -> None:
    """An emptied store lost its CSV files to the next report, and another program's tables got ours beside them."""
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty" / "results.sqlite").touch()
    (tmp_path / "empty" / "frames.csv").write_text("kept", encoding="utf-8")
    with pytest.raises(StoreError, match="no results in"):
        write_all(tmp_path / "empty")
    assert (tmp_path / "empty" / "frames.csv").read_text(encoding="utf-8") == "kept"
    assert not (tmp_path / "empty" / "results.sqlite").stat().st_size
    foreign = tmp_path / "results.sqlite"
    with closing(sqlite3.connect(foreign)) as other:
        other.execute("CREATE TABLE foo (bar)")
    before = foreign.read_bytes()
    for must_exist in (True, False):
        with pytest.raises(StoreError, match="written by another program"):
            Store(tmp_path, must_exist=must_exist)
    assert foreign.read_bytes() == before


def test_a_folder_without_a_store_is_named(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="no results in"):
        Store(tmp_path / "nothing", must_exist=True)
    assert not (tmp_path / "nothing").exists()
    (tmp_path / "results.sqlite").write_text("this is a text, and a long one, not a database" * 50, encoding="utf-8")
    with pytest.raises(StoreError, match="no whole results store"):
        Store(tmp_path)


KILLED = """
import os, signal, sys
from pathlib import Path
from shading_atlas_bench.reports.store.results import FILE, Store
from tests.reports.synthetic import frame_rows
frame, moment = 0, int(sys.argv[2])
store = Store(Path(sys.argv[1]))
store._database.select("PRAGMA cache_size = 4")  # pages reach the file before the transaction ends
insert = store._database.insert
def insert_and_die(table, records):
    insert(table, records)
    if frame == 2 and table == ("rows", "stages", "statistics", "repeats", "finished")[moment]:
        os.kill(os.getpid(), getattr(signal, "SIGKILL", 9))
store._database.insert = insert_and_die
for frame in range(4):
    rows = frame_rows("sas", frame)
    store.commit_frame("sas", "v", frame, rows, [(f"s{i}", 1.0, 1) for i in range(2000)], {"n": 1.0}, [(0, "s", 1.0)])
"""


@pytest.mark.parametrize("moment", range(5))
def test_a_kill_within_a_transaction_leaves_whole_frames_only(tmp_path: Path, moment: int) -> None:
    root = Path(__file__).parents[2]
    ended = subprocess.run(
        [sys.executable, "-c", KILLED, str(tmp_path), str(moment)], cwd=root, env=os.environ | {"PYTHONPATH": str(root)}
    )
    assert abs(ended.returncode) == 9
    with Store(tmp_path) as store:
        assert store.finished() == {("sas", "v", 0), ("sas", "v", 1)}
        assert len(store.rows()) == 2 * 5
        assert len(store.stages()) == 2 * 2000
        assert len(store.statistics()) == len(store.repeats()) == 2
        store.commit_frame("sas", "v", 2, frame_rows("sas", 2))
        assert len(store.finished()) == 3


def test_a_folder_too_deep_for_sqlite_is_refused(tmp_path):
    deep = tmp_path.joinpath(*["d" * 200] * 3)
    with pytest.raises(StoreError, match="SQLite opens files in up to 489: give a folder whose path"):
        Store(deep)
    assert not deep.exists()
    Store(tmp_path / ("d" * 200) / ("e" * (489 - 202 - len(str(tmp_path))))).close()


@pytest.mark.parametrize(
    ("table", "column", "value", "says"),
    [
        ("rows", "fov", "wide", "Expected `float"),
        ("rows", "fov", b"\0", "got `bytes`"),
        ("rows", "fov", math.inf, "Expected `float"),
        ("rows", "frame", 2.5, "Expected `int"),
        ("rows", "frame", -1, "Expected `int` >= 0"),
        ("rows", "status", "fine", "Invalid enum value 'fine'"),
        ("rows", "scene", None, "Expected `str"),
        ("stages", "ms", "long", "Expected `float"),
        ("statistics", "value", b"", "got `bytes`"),
        ("repeats", "repetition", "first", "Expected `int"),
        ("finished", "frame", "first", "Expected `int"),
        ("notes", "value", b"\xff", "Expected `str"),
        ("plan", "content", '{"a":' * 5000, "got `object`"),
        ("plan", "content", "[]", "Expected `object"),
    ],
)
def test_a_value_of_another_type_is_named_by_table_and_column(
    tmp_path: Path, table: str, column: str, value: object, says: str
) -> None:
    with Store(tmp_path) as store:
        store.set_plan({"a": 1})
        store.notes["a/b"] = "c"
        row = COMMON | {"codec": "none", "status": "ok"}
        store.commit_frame("sas", "", 0, [row], [("a/b", 1.0, 1)], {"x": 1.0}, [(1, "a/b", 1.0)])
    alter(tmp_path, f"UPDATE {table} SET {column} = ?", value)

    def read_all(store: Store) -> None:
        for read in (store.rows, store.stages, store.statistics, store.repeats, store.plan):
            read()
        store.notes.under("a")

    with Store(tmp_path) as store, pytest.raises(StoreError) as caught:
        read_all(store)
    sentence = str(caught.value)
    assert says in sentence
    assert f"The table {table} of {tmp_path / 'results.sqlite'}" in sentence
    assert table in ("notes", "plan", "finished") or f"].{column}`" in sentence


@pytest.mark.parametrize(
    "statement",
    [
        "CREATE VIEW more AS SELECT 1",
        "CREATE TRIGGER t AFTER INSERT ON notes BEGIN DELETE FROM rows; END",
        "ALTER TABLE rows ADD COLUMN more",
        "DROP INDEX row_frame",
    ],
)
def test_a_store_with_other_tables_is_refused(tmp_path: Path, statement: str) -> None:
    Store(tmp_path).close()
    with sqlite3.connect(tmp_path / "results.sqlite") as connection:
        connection.execute(statement)
    connection.close()
    with pytest.raises(StoreError, match="its tables are others"):
        Store(tmp_path)


def test_text_that_utf_8_lacks_is_kept_as_escapes(tmp_path: Path) -> None:
    with Store(tmp_path) as store:
        store.commit_frame("sas", "", 0, [COMMON | {"codec": "none", "status": "failed", "reason": "caf\udce9 \ud800"}])
        store.notes["scene/\ud800"] = "\udce9"
        assert store.rows()[0]["reason"] == "caf\\udce9 \\ud800"
        assert store.notes["scene/\\ud800"] == "\\udce9"


def test_a_store_that_was_written_twice_at_once_holds_both(tmp_path: Path):
    """The sum of the digests is of all that is in the file, whoever wrote it."""
    with closing(Store(tmp_path / "both")) as one, closing(Store(tmp_path / "both")) as other:
        for number in range(4):
            one.notes[f"one/{number}"] = "a"
            other.notes[f"other/{number}"] = "b"
            del one.notes[f"one/{number}"]
        one.set_plan({"a": 1})
        with pytest.raises(StoreError, match="holds another run"):
            other.set_plan({"a": 2}, begun=True)
    with Store(tmp_path / "both", must_exist=True) as store:
        assert dict(store.notes) == {f"other/{number}": "b" for number in range(4)}


@pytest.mark.parametrize(("old", "new"), [(b"out of memory", b"out of nothing"[:13]), (b"cpu-skylake", b"cpu-skylark")])
def test_a_text_that_was_changed_in_the_file_is_noticed(tmp_path: Path, old: bytes, new: bytes) -> None:
    make_store(tmp_path)
    data = (tmp_path / FILE).read_bytes()
    assert old in data
    (tmp_path / FILE).write_bytes(data.replace(old, new, 1))
    with pytest.raises(StoreFileError, match="its checksum does not hold"):
        Store(tmp_path)


def test_zeros_of_either_sign_and_names_of_numpy_are_what_was_written(tmp_path: Path) -> None:
    numbers: dict[str, Any] = {np.str_("a"): np.float32(0.1)}
    with Store(tmp_path) as store:
        store.commit_frame("sas", "", 0, [ROW | {"flip": -0.0}], statistics=numbers)
    with Store(tmp_path) as store:
        assert [row["flip"] for row in store.rows()] == [0.0]


@pytest.mark.parametrize("name", [("a", 1), "\ud800", 1 << 70])
def test_a_value_that_sqlite_does_not_take_is_not_the_files_fault(tmp_path: Path, name: Any) -> None:
    with Store(tmp_path) as store:
        with pytest.raises(StoreError, match="A value cannot be kept") as caught:
            store.commit_frame("sas", "", 0, [ROW], statistics={name: 1.0})
        assert not isinstance(caught.value, StoreFileError)
        assert store.finished() == set()
    Store(tmp_path).close()


@pytest.mark.parametrize("gone", ["file", "folder"])
def test_a_store_that_is_deleted_while_it_is_written_is_one_sentence(tmp_path: Path, gone: str) -> None:
    with Store(tmp_path / "run") as store:
        store.commit_frame("sas", "", 0, [ROW])
        if gone == "file":
            (tmp_path / "run" / FILE).unlink()
        else:
            shutil.rmtree(tmp_path / "run")
        with pytest.raises(StoreFileError, match="was deleted or moved while it was in use"):
            store.commit_frame("sas", "", 1, [ROW])


def test_a_full_disk_keeps_whole_frames_and_is_told(tmp_path: Path) -> None:
    resource = pytest.importorskip("resource", reason="files can be limited under Unix only")
    with Store(tmp_path) as store:
        store.commit_frame("sas", "", 0, [ROW])
        soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, ((tmp_path / FILE).stat().st_size + 8192, hard))
        try:
            with pytest.raises(StoreFileError, match=r"cannot be (read or )?written"):
                store.commit_frame("sas", "", 1, [ROW], [(f"stage {i}", 1.0, 1) for i in range(5000)])
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        assert store.finished() == {("sas", "", 0)}
        store.commit_frame("sas", "", 1, [ROW])
    with Store(tmp_path) as store:
        assert store.finished() == {("sas", "", 0), ("sas", "", 1)}


@pytest.mark.parametrize("what", ["folder", "link", "pipe"])
def test_what_is_no_file_is_no_store(tmp_path: Path, what: str) -> None:
    if what == "folder":
        (tmp_path / FILE).mkdir()
    elif what == "link":
        (tmp_path / FILE).symlink_to(tmp_path / "elsewhere")
    elif hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / FILE)
    else:
        pytest.skip("there are no pipes with names here")
    with pytest.raises(StoreFileError, match="is no file"):
        Store(tmp_path)
    assert not (tmp_path / "elsewhere").exists()


def test_reading_needs_no_right_to_write(tmp_path: Path) -> None:
    """A reader takes no lock that another process holds, and none that a read-only disk refuses."""
    make_store(tmp_path)
    with Store(tmp_path) as writer, writer._database.transaction(), Store(tmp_path, must_exist=True) as reader:
        assert len(reader.rows()) == 3 * 12 * 5
