"""Every cost of a frame is in a column, and the columns add up; the reference is shaded for the eye asked for."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from shading_atlas_bench.harness.measure.pipeline import Filled
from shading_atlas_bench.harness.run.run import run
from shading_atlas_bench.harness.workload.settings import Settings, SettingsError
from shading_atlas_bench.reports.store.results import Store

SMALL = Settings(
    methods=("all",), frames=2, width=160, height=90, atlas_width=256, atlas_height=256, crf=(25,), detail=40_000
)
PARTS = (
    "server_ms",
    "serialise_ms",
    "fill_ms",
    "encode_ms",
    "network_ms",
    "decode_ms",
    "receive_ms",
    "draw_host_ms",
    "client_ms",
)


def rows_of(folder: Path) -> list[dict[str, Any]]:
    with Store(folder, must_exist=True) as store:
        return store.rows()


@pytest.fixture(scope="module")
def rows(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, Any]]:
    folder = tmp_path_factory.mktemp("costs") / "run"
    assert run(SMALL, folder).well
    return rows_of(folder)


def test_the_parts_of_a_frame_make_it_up_within_5_percent(rows: list[dict[str, Any]]) -> None:
    assert {row["method"] for row in rows} == {"ppll", "sas", "snakebinning", "tss"}
    for row in rows:
        whole = row["frame_ms"]
        assert 0.95 * whole <= sum(row[part] or 0.0 for part in PARTS) <= whole * (1 + 1e-9), row["method"]
        assert row["server_ms"] + row["serialise_ms"] == pytest.approx(row["wall_ms"])
        assert min(row[part] for part in PARTS) >= 0
        assert row["structs_ms"] + row["gather_ms"] == pytest.approx(row["server_ms"])


def test_the_network_takes_what_its_bandwidth_says(rows: list[dict[str, Any]]) -> None:
    for row in rows:  # 100 Mbit/s are 12.5 bytes in a microsecond
        assert row["network_ms"] == pytest.approx(row["bytes_total"] / 12_500)


def test_only_coded_planes_are_filled(rows: list[dict[str, Any]]) -> None:
    by_codec = {(row["method"], row["codec"]): row["fill_ms"] for row in rows}
    assert min(by_codec["sas", "h264"], by_codec["sas", "none"]) > 0
    times: Any = SimpleNamespace(read_ms=1.0, fill_ms=2.0)
    assert [Filled.milliseconds(times, key) for key in (("none", None), ("h264", 25))] == [1.0, 2.0]


def test_a_set_from_the_cache_keeps_the_time_it_took(rows: list[dict[str, Any]], tmp_path: Path) -> None:
    assert run(replace(SMALL, methods=("sas",)), tmp_path / "again").well
    times = {row["frame"]: row["pvs_ms"] for row in rows}
    assert min(times.values()) > 0
    assert {row["frame"]: row["pvs_ms"] for row in rows_of(tmp_path / "again")} == times


def test_the_reference_is_shaded_for_the_eye_that_is_asked_for(rows: list[dict[str, Any]], tmp_path: Path) -> None:
    assert run(replace(SMALL, methods=("sas",), reference_eye="server"), tmp_path / "server").well
    server = [row for row in rows_of(tmp_path / "server") if row["codec"] == "none"]
    client = [row for row in rows if (row["method"], row["codec"]) == ("sas", "none")]
    assert [row["reference_eye"] for row in client + server] == ["client"] * 2 + ["server"] * 2
    for ours, theirs in zip(client, server, strict=True):
        assert 0 < theirs["flip"] < ours["flip"] < theirs["flip"] + 2 * ours["view_dependence"]
        assert ours["view_dependence"] == pytest.approx(theirs["view_dependence"], rel=0.2)


def test_one_eye_in_one_place_depends_on_no_view(tmp_path: Path) -> None:
    assert run(replace(SMALL, methods=("sas",), cell_radius=0.0, frames=1), tmp_path / "still").well
    assert {row["view_dependence"] for row in rows_of(tmp_path / "still")} == {0.0}


@pytest.mark.parametrize(
    ("setting", "says"),
    [
        ({"reference_eye": "mine"}, "give one of client, server"),
        ({"bandwidth": 0.0}, r"give 0\.001 to"),
    ],
)
def test_what_cannot_be_used_is_one_sentence(setting: dict[str, Any], says: str) -> None:
    with pytest.raises(SettingsError, match=says):
        replace(SMALL, **setting)
