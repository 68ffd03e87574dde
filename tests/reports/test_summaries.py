"""Summaries, with numbers worked out by hand: spikes show, the keyframe stands apart, what is missing stays empty."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from shading_atlas_bench.reports.store.columns import BY_NAME, SENT, statistic_columns, summary_columns
from shading_atlas_bench.reports.store.csv_files import measure_statistics, summarise, write_all
from shading_atlas_bench.reports.store.results import Store
from tests.reports.synthetic import COMMON

# The second frame after the keyframe is a spike, as an atlas reset is.
BYTES = (1000, 100, 600, 200)
PACE = 50.0


def rows_of(values: tuple, name: str = "bytes_total", **changes: object) -> list[dict]:
    """Rows of frames.csv that hold one measure and nothing else."""
    empty = dict.fromkeys(BY_NAME)
    row = empty | COMMON | {"method": "sas", "variant": "", "codec": "h264", "crf": 25, "status": "ok"}
    row |= {"frame_rate": PACE}
    return [row | {"frame": frame, name: value} | changes for frame, value in enumerate(values)]


def statistics(name: str, rows: list[dict]) -> dict[str, float | None]:
    """The statistics of a measure by their suffix."""
    found = measure_statistics(BY_NAME[name], rows)
    assert set(found) == {column.name for column in statistic_columns(BY_NAME[name])}
    return {key.removeprefix(f"{name}_"): value for key, value in found.items()}


def test_sizes_leave_the_keyframe_out_and_show_it_apart() -> None:
    found = statistics("bytes_total", rows_of(BYTES))
    assert found == {
        "median": 200.0,  # of 100, 200, 600
        "low": None,  # three values have no interval
        "high": None,
        "mean": 300.0,  # (100 + 600 + 200) / 3
        "max": 600,
        "key": 1000,
        "total": 1900,  # the only one with the keyframe in it
        "kbit_s": 120.0,  # 300 bytes * 8 bits * 50 per second / 1000
    }


def test_times_and_qualities_hold_the_first_frame() -> None:
    found = statistics("flip", rows_of((0.75, 0.125, 0.25, 0.375), "flip"))
    assert found == {"median": 0.3125, "low": None, "high": None, "mean": 0.375, "max": 0.75}
    assert statistics("server_ms", rows_of((9.0, 1.0, 2.0), "server_ms"))["max"] == 9.0


def test_a_ratio_of_sizes_leaves_the_keyframe_out_but_has_no_sum() -> None:
    found = statistics("compression_ratio", rows_of((0.5, 0.25, 0.125), "compression_ratio"))
    assert (found["mean"], found["max"], found["key"]) == (0.1875, 0.25, 0.5)
    assert not {"total", "kbit_s"} & set(found)


def test_what_is_missing_stays_empty() -> None:
    nothing = statistics("bytes_alpha", rows_of((None, None, None), "bytes_alpha"))
    assert set(nothing.values()) == {None}
    alone = statistics("bytes_total", rows_of((1000,)))
    assert (alone["key"], alone["total"]) == (1000, 1000)
    assert [alone[name] for name in ("median", "mean", "max", "kbit_s")] == [None] * 4
    unpaced = statistics("bytes_total", rows_of(BYTES, frame_rate=None))
    assert (unpaced["mean"], unpaced["kbit_s"]) == (300.0, None)
    headless = statistics("bytes_total", rows_of(BYTES)[1:])
    assert (headless["key"], headless["mean"], headless["total"]) == (None, 300.0, 900)


def test_frames_that_failed_do_not_count() -> None:
    rows = rows_of(BYTES)
    rows[2]["status"] = "invalid"
    (summary,) = summarise(rows)
    assert (summary["bytes_total_mean"], summary["bytes_total_max"], summary["bytes_total_total"]) == (150.0, 200, None)


def test_every_size_has_its_columns_and_the_total_comes_first() -> None:
    assert SENT == ("bytes_total", "bytes_video", "bytes_alpha", "bytes_metadata", "bytes_geometry")
    names = [column.name for column in summary_columns()]
    firsts = [name for name in names if name.startswith("bytes_") and name.endswith("_median")]
    assert firsts == [f"{name}_median" for name in SENT]
    known = {column.name: column for column in summary_columns()}
    for name in SENT:
        assert "after the keyframe" in known[f"{name}_median"].meaning
        assert known[f"{name}_kbit_s"].unit == "kbit/s"
    assert "the first among them" in known["flip_median"].meaning


def test_the_file_has_the_numbers_and_empty_cells(tmp_path: Path) -> None:
    with Store(tmp_path) as store:
        for row in rows_of(BYTES):
            store.commit_frame("sas", "", row["frame"], [row])
    write_all(tmp_path)
    with (tmp_path / "summary.csv").open(encoding="utf-8", newline="") as file:
        (summary,) = csv.DictReader(file)
    assert float(summary["bytes_total_kbit_s"]) == pytest.approx(120)
    assert summary["bytes_total_key"] == "1000"
    assert summary["frame_rate"] == "50.0"
    assert summary["bytes_alpha_mean"] == summary["bytes_alpha_total"] == summary["flip_max"] == ""
