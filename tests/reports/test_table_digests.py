"""Rows of the documents' tables from planted results."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from shading_atlas_bench.harness.cases import find_cases
from shading_atlas_bench.reports.charts.figures import COLOURS
from shading_atlas_bench.reports.documents.catalogue import SOURCES
from shading_atlas_bench.reports.documents.digests import (
    BROKEN_STAGES,
    equal_parts,
    kernel_parts,
    limit_parts,
    mapping_parts,
    reset_parts,
    stress_parts,
    switch_parts,
)
from shading_atlas_bench.reports.documents.figure import draw_samples
from shading_atlas_bench.reports.documents.markdown import table_text
from shading_atlas_bench.reports.store.columns import KERNEL_COLUMNS, STRESS_COLUMNS, SWEEP_SETTINGS
from shading_atlas_bench.reports.store.csv_files import write_csv
from shading_atlas_bench.reports.store.results import Store
from tests.reports.synthetic import COMMON


def row_of(columns: tuple, **values: Any) -> dict[str, Any]:
    return dict.fromkeys(column.name for column in columns) | values


def trial(method: str, step: int, status: str = "ok", **values: Any) -> dict[str, Any]:
    named = {"test": "wide", "method": method, "variant": "", "unit": "degrees"}
    magnitude = (60.0, 120.0, 179.0)[step]
    return row_of(
        STRESS_COLUMNS, **named, step=step, magnitude=magnitude, status=status, passed=int(status == "ok"), **values
    )


def test_the_stress_table_has_the_ends_and_where_a_method_broke(tmp_path: Path):
    rows = [trial("raster", step, error=0.001) for step in range(3)]
    rows += [trial("sas", 0, error=0.02), trial("sas", 1, error=0.04), trial("sas", 2, "invalid", reason="lost")]
    write_csv(tmp_path / "stress.csv", STRESS_COLUMNS, rows)
    parts = stress_parts([tmp_path])
    line = table_text(SOURCES["stress"].parts["rows"], parts["rows"]).splitlines()[-1]
    assert line == "| wide | 60 .. 179 degrees | 0.001, 0.001 |  | 0.020 **120 !** |  |  |"
    facts = {row["name"]: row["value"] for row in parts["facts"]}
    assert facts == {"tests": 1, "magnitudes": 3, "trials": 6, "wrong": 1}
    assert parts["errors"][1] == {"test": "wide", "label": "sas", "first": 0.02, "last": None, "passed": False}


def test_the_kernels_tables_count_kernels_and_compare_variants(tmp_path: Path):
    usual = {"kernel": "atlas/lookup.a", "case": "atlas/lookup", "input": "typical", "values": 0, "whole_values": 200}
    shares = {"copy_share": 0.1, "arithmetic_share": 0.2}
    rows = [
        row_of(KERNEL_COLUMNS, **usual, **shares, variant="default", ms=2.0, misassigned=1),
        row_of(KERNEL_COLUMNS, **usual, variant="relaxed", ms=1.0, misassigned=150),
        row_of(KERNEL_COLUMNS, **usual | {"kernel": "atlas/lookup.b"}, variant="default", ms=1.0, misassigned=1),
    ]
    write_csv(tmp_path / "kernels.csv", KERNEL_COLUMNS, rows)
    parts, columns = kernel_parts([tmp_path]), SOURCES["kernels"].parts
    assert {row["name"]: row["value"] for row in parts["facts"]} == {"kernels": 2, "stages": 1}
    assert table_text(columns["variants"], parts["variants"]).splitlines()[-1] == "| `relaxed` | 0.50 | 1 | 1 | 0 |"
    line = "| `atlas/lookup` | 0.005 of the values wrong | 0.75 of the values wrong |"
    assert table_text(columns["broken"], parts["broken"]).splitlines()[-1] == line
    assert [row["misassigned"] for row in parts["errors"]] == [1]
    assert parts["roofs"] == [{"kernel": "atlas/lookup.a", "share": 0.2}, {"kernel": "atlas/lookup.b", "share": None}]


def test_the_stages_that_relaxed_arithmetic_breaks_are_cases():
    assert set(BROKEN_STAGES) <= {case.name for case in find_cases()}


def test_resets_are_told_from_the_first_twelve_frames(tmp_path: Path):
    with Store(tmp_path) as store:
        for frame in range(20):
            total = {0: 90_000, 15: 30_000}.get(frame, 10_000)
            row = COMMON | {"codec": "h264", "crf": 25, "status": "ok", "bytes_total": total}
            store.commit_frame("sas", "", frame, [row])
    first, whole = reset_parts([tmp_path])["rows"]
    assert (first["frames"], first["median"], first["max"], first["key"]) == (12, 10, 10, 90)
    assert (whole["frames"], whole["median"], whole["max"], whole["largest"]) == (20, 10, 30, 15)
    assert (whole["mean"], whole["max_over_median"]) == ((18 * 10 + 30) / 19, 3)


def test_methods_off_their_equal_samples_are_named(tmp_path: Path):
    settings = {name: 1 for name in SWEEP_SETTINGS} | {"scene": "hall", "path": "walk"}
    same: dict[str, Any] = {
        "folder": "cells/a",
        "variant": "",
        "varied": {},
        "condition": "",
        "codings": {},
        "settings": settings,
    }
    cells = [same | {"method": name} for name in ("sas", "snakebinning")]
    content = {"settings": settings, "vary": [], "rule": {}, "timed": True, "frames": 1, "left_out": [], "cells": cells}
    (tmp_path / "sweep.json").write_text(json.dumps(content), encoding="utf-8")
    with Store(tmp_path / "cells" / "a") as store:
        for method, samples in (("sas", 58_000), ("snakebinning", 86_400), ("tss", 49_000)):
            measured = {"samples": samples, "sample_budget": 57_600, "flip": samples / 1e6, "bytes_total": samples}
            codings = ({"codec": "none", "crf": None}, {"codec": "h264", "crf": 25})
            store.commit_frame(method, "", 1, [COMMON | measured | coding | {"status": "ok"} for coding in codings])
    (row,) = equal_parts([tmp_path])["rows"]
    assert (row["scene"], row["asked"], row["off"]) == ("hall", 1.0, "snakebinning +50%, tss -15%")
    drawn = draw_samples([row, row | {"asked": 2.0, "off": ""}])
    assert [drawn.count(f'stroke="{colour}"') for colour in COLOURS[:3]] == [2, 2, 2]
    assert drawn.count("L") == 2  # only sas met both: a line without coding and one with


def test_switches_are_told_by_what_most_variants_have_and_rebuilt_frames_stand_apart(tmp_path: Path):
    settings = {"ours": ("0.3", "exact", "true"), "published": ("0.3", "paper", "false")}
    others = ("0", "paper", "false"), ("0", "exact", "true")
    for (name, usual), flipped in zip(settings.items(), others, strict=True):
        variants = [usual, *((*usual[:n], flipped[n], *usual[n + 1 :]) for n in range(3))]
        with Store(tmp_path / name) as store:
            for capacity, enlarge, points in variants:
                variant = f"capacity={capacity},enlarge={enlarge},points={points}"
                for frame in range(4):
                    row = COMMON | {"status": "ok", "samples": 100 * frame, "bytes_total": (9000, 10, 70, 10)[frame]}
                    rows = [row | {"codec": "none"}, row | {"codec": "h264", "crf": 25}]
                    counted = {"rebuilds": 1 + (frame >= 2), "triangles_moved": (0, 2, 50, 4)[frame]}
                    store.commit_frame("snakebinning", variant, frame, rows, statistics=counted)
            store.commit_frame("sas", "a=1", 1, [COMMON | {"status": "ok", "codec": "none", "samples": 7}])
    rows = switch_parts([tmp_path / name for name in settings])["rows"]
    names = {name: [row["variant"] for row in rows if row["settings"] == name] for name in settings}
    assert names["ours"] == ["none", "no spare capacity", "enlargement as published", "points as published", "sas"]
    assert names["published"] == ["none", "no spare capacity", "enlargement of ours", "points of ours", "sas"]
    row, rival = rows[0], rows[4]
    assert (row["samples"], row["rebuilt"], row["triangles_moved"], row["moved_frozen"]) == (200, 1, 56 / 3, 3)
    assert (row["bytes_total"], row["bytes_rebuilt"], row["bytes_frozen"]) == (30, 70, 10)
    assert (rival["samples"], rival["rebuilt"], rival["bytes_total"]) == (7, None, None)


def test_limited_lists_are_told_from_full_ones(tmp_path: Path):
    with Store(tmp_path) as store:
        for variant, total, flip in (("mode=depth-limited", 400, 0.2), ("mode=full", 1000, 0.1)):
            measured = {"bytes_total": total, "flip": flip, "holes_px": 0.0, "server_ms": total / 100}
            store.commit_frame("ppll", variant, 1, [COMMON | measured | {"codec": "none", "status": "ok"}])
    (row,) = limit_parts([tmp_path])["rows"]
    assert (row["bytes_total_full"], row["bytes_total"], row["flip_full"], row["flip"]) == (1000, 400, 0.1, 0.2)
    assert (row["bytes_total_ratio"], row["flip_ratio"], row["server_ratio"], row["size"]) == (0.4, 2, 0.4, "320x180")


def mapping_run(folder: Path, codec: str, values: dict[str, tuple[float, float]]) -> None:
    """SnakeBinning by `freeze/mapping`: texels that superblocks leave, and triangles that move, or bytes."""
    with Store(folder) as store:
        for lane, (unallocated, cost) in values.items():
            freeze, mapping = lane.split("/")
            variant = f"assignment=first,freeze={freeze},mapping={mapping},orphans=found"
            row = COMMON | {"codec": "none", "status": "ok", "flip": 0.1}
            coded = [] if codec == "none" else [row | {"codec": codec, "crf": 25, "bytes_total": cost}]
            statistics = {"unallocated": unallocated, "wasted_in_superblocks": 144, "triangles_moved": cost}
            for frame in range(3):
                store.commit_frame("snakebinning", variant, frame, [row, *coded], statistics=statistics)


def test_what_mapping_frees_is_told_from_pairs_of_runs(tmp_path: Path):
    """Areas from runs without coding, costs from coded ones; a run without its partner has no ratio."""
    whole = 512 * 512
    mapping_run(tmp_path / "a", "none", {"0.0/off": (whole - 1144, 10), "0.0/exact": (whole - 644, 20)})
    mapping_run(tmp_path / "b", "none", {"0.0/exact": (whole - 644, 20)})
    mapping_run(tmp_path / "c", "h264", {f"{f}/{m}": (0, c) for f, m, c in (
        ("0.0", "off", 100), ("0.0", "exact", 300), ("0.05", "off", 10), ("0.05", "exact", 20),
    )})  # fmt: skip
    parts = mapping_parts([tmp_path / name for name in "abc"])
    both, alone = parts["rows"]
    assert (both["superblocks_off"], both["superblocks"]) == (1144, 644)
    assert (both["superblocks_freed"], both["strips_freed"]) == (1 - 644 / 1144, 0.5)
    assert (both["triangles_moved_ratio"], both["flip_ratio"]) == (2, 1)
    assert (alone["superblocks_off"], alone["superblocks"], alone["superblocks_freed"]) == (None, 644, None)
    (costs,) = parts["costs"]
    assert [costs[name] for name in ("bytes_off", "bytes", "bytes_off_frozen", "bytes_frozen")] == [100, 300, 10, 20]
