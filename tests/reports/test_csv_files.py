"""The CSV files: sorted, the same bytes for the same results, nothing missing as zero, medians as documented."""

from __future__ import annotations

import csv
import errno
import math
import os
import subprocess
import sys
from pathlib import Path
from statistics import NormalDist, median

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shading_atlas_bench.reports.store.columns import FRAME_COLUMNS, FRAME_KEY, KEYFRAME_APART, MEASURES
from shading_atlas_bench.reports.store.csv_files import (
    median_interval,
    read_csv,
    replace_file,
    summarise,
    write_all,
    write_csv,
    written,
)
from shading_atlas_bench.reports.store.data import DataError
from shading_atlas_bench.reports.store.database import StoreError, StoreFileError
from shading_atlas_bench.reports.store.results import Store
from tests.reports.synthetic import COMMON, make_store

FILES = ("frames.csv", "summary.csv", "stages.csv", "statistics.csv")
TEXTS = st.text(st.characters(codec="utf-8", exclude_characters="\0", exclude_categories=["Cs"]), max_size=12)
NUMBERS = st.none() | st.floats() | st.integers(-(2**53), 2**53)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    make_store(folder)
    write_all(folder)
    return folder


def test_same_results_give_the_same_bytes_in_whatever_order_they_came(folder: Path, tmp_path: Path) -> None:
    make_store(tmp_path, order=-1)
    write_all(tmp_path)
    for name in FILES:
        assert (tmp_path / name).read_bytes() == (folder / name).read_bytes(), name
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([*FILES, "results.sqlite"])


def test_frames_are_sorted_and_failures_are_empty_not_zero(folder: Path) -> None:
    rows = read_csv(folder / "frames.csv")
    keys = [tuple(int(row[k] or -1) if k in ("crf", "frame") else row[k] for k in FRAME_KEY) for row in rows]
    assert keys == sorted(set(keys))
    assert len(rows) == 3 * 12 * 5
    failed = [row for row in rows if row["status"] == "failed"]
    assert len(failed) == 5
    for row in failed:
        assert row["reason"] == "out of memory"
        assert all(row[measure.name] == "" for measure in MEASURES)
    hidden = [row for row in rows if row["crf"] not in ("25", "")]
    assert all(row["flip"] == row["psnr"] == "" for row in hidden)


def test_summary_holds_medians_of_frames_that_are_ok(folder: Path) -> None:
    rows, summaries = read_csv(folder / "frames.csv"), read_csv(folder / "summary.csv")
    assert len(summaries) == 3 * 5
    for summary in summaries:
        of_key = [row for row in rows if all(row[k] == summary[k] for k in FRAME_KEY if k != "frame")]
        good = [row for row in of_key if row["status"] == "ok"]
        counts = {"grid": (12, 11, 1, 0, 0), "bins": (12, 11, 0, 0, 1), "sas": (12, 12, 0, 0, 0)}
        names = ("frames", "frames_ok", "frames_overflow", "frames_skipped", "frames_failed")
        assert tuple(int(summary[name]) for name in names) == counts[summary["method"]]
        for measure in MEASURES:
            of_measure = [row for row in good if row["frame"] != "0" or measure.name not in KEYFRAME_APART]
            values = [float(row[measure.name]) for row in of_measure if row[measure.name]]
            if not values:
                assert summary[f"{measure.name}_median"] == summary[f"{measure.name}_low"] == ""
                continue
            low, middle, high = (float(summary[f"{measure.name}_{s}"]) for s in ("low", "median", "high"))
            assert middle == median(values)
            assert low <= middle <= high


@pytest.mark.parametrize("n", [6, 7, 12, 30, 101])
def test_the_interval_covers_the_median_as_often_as_it_says(n: int) -> None:
    values = np.sort(np.random.default_rng(1).normal(size=(4000, n)), axis=1)
    ends, median = [median_interval(list(row)) for row in values], NormalDist().median
    covered = np.mean([low is not None and high is not None and low <= median <= high for low, high in ends])
    assert 0.95 - 0.012 < covered < 0.995


def test_few_values_have_no_interval() -> None:
    assert [median_interval([1.0] * n) for n in range(6)] == [(None, None)] * 6
    assert median_interval([1.0, 2, 3, 4, 5, 6]) == (1.0, 6.0)
    assert median_interval(list(range(660))) == (304.0, 355.0)


@settings(max_examples=15, deadline=None)
@given(values=st.lists(st.tuples(TEXTS, NUMBERS), max_size=6))
def test_any_text_and_number_is_read_back(values: list, tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.mktemp("any")
    with Store(folder) as store:
        for frame, (text, number) in enumerate(values):
            row = COMMON | {"codec": None, "status": "failed", "reason": text, "flip": number}
            store.commit_frame(text, text, frame, [row])
        rows = store.rows()
    write_csv(folder / "frames.csv", FRAME_COLUMNS, rows)
    found = sorted(read_csv(folder / "frames.csv"), key=lambda row: int(row["frame"]))
    for (text, number), cells in zip(values, found, strict=True):
        assert cells["method"] == cells["variant"] == cells["reason"] == " ".join(text.splitlines())
        if number is None or not math.isfinite(number):
            assert cells["flip"] == ""
        else:
            assert float(cells["flip"]) == float(number)
    assert len(summarise(rows)) == len({text for text, _ in values})


def test_a_file_that_cannot_be_replaced_is_named(tmp_path: Path) -> None:
    (tmp_path / "frames.csv" / "open").mkdir(parents=True)  # on Windows the same error as of a file that is open
    hint = r"another program\?" if os.name == "nt" else r"delete that folder, or give another one\."
    with pytest.raises(StoreError, match=rf"frames\.csv cannot be written .*{hint}$"):
        write_csv(tmp_path / "frames.csv", [], [])
    assert [path.name for path in tmp_path.iterdir()] == ["frames.csv"]


@pytest.mark.parametrize("text", ["=1+1", "+1", "-1", "@x", "\tx", "\rx", "'=1", "''-x", "'x", "x=1", "", "'"])
def test_no_text_is_a_formula_and_all_are_read_back(text: str, tmp_path: Path) -> None:
    """Numbers below zero stay numbers."""
    row = dict.fromkeys((column.name for column in FRAME_COLUMNS), None) | {"reason": text, "psnr": -1.5}
    write_csv(tmp_path / "frames.csv", FRAME_COLUMNS, [row])
    with (tmp_path / "frames.csv").open(encoding="utf-8", newline="") as file:
        (cells,) = csv.DictReader(file)
    assert not cells["reason"].startswith(("=", "+", "-", "@", "\t", "\r"))
    assert cells["psnr"] == "-1.5"
    assert read_csv(tmp_path / "frames.csv")[0]["reason"] == " ".join(text.splitlines())


def test_a_damaged_csv_file_is_a_sentence(tmp_path: Path) -> None:
    for content in (b"a,b\n1,2,3\n", b'a\n"1\n', b"\xff"):
        (tmp_path / "a.csv").write_bytes(content)
        with pytest.raises(DataError, match=r"a\.csv is n"):
            read_csv(tmp_path / "a.csv")


def test_what_a_killed_process_left_half_written_goes_and_that_of_others_stays(tmp_path: Path) -> None:
    with subprocess.Popen([sys.executable, "-c", ""]) as ended:
        pass
    parts = [f".report.html.{ended.pid}", f".report.html.{os.getppid()}", f".frames.csv.{ended.pid}"]
    names = [*parts, ".report.html.kept"]
    for name in names:
        (tmp_path / name).write_bytes(b"half")
    replace_file(tmp_path / "report.html", "whole")
    assert {path.name for path in tmp_path.iterdir()} == {"report.html", *names[1:]}


@pytest.mark.parametrize(
    ("code", "hint"),
    [
        (errno.ENOSPC, "make room"),
        (errno.ENOENT, "was its folder deleted"),
        (errno.EBUSY, "give another folder"),
        (errno.EACCES, "open in another program" if os.name == "nt" else "make it and its folder writable"),
        (errno.EPERM, "open in another program" if os.name == "nt" else "make it and its folder writable"),
    ],
)
def test_a_file_that_cannot_be_written_is_named_with_what_to_do(code: int, hint: str) -> None:
    with pytest.raises(StoreFileError, match=rf"^a\.csv cannot be written \(.*\): .*{hint}"), written(Path("a.csv")):
        raise OSError(code, os.strerror(code))


def test_a_folder_that_is_gone_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(StoreFileError, match="was its folder deleted"):
        replace_file(tmp_path / "gone" / "frames.csv", "")
