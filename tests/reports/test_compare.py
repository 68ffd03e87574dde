"""Two runs compared: equal runs are the same, a planted change is found, chance is called ambiguous."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from shading_atlas_bench.reports.analysis.compare import CompareError, Comparison, compare, differences, noise
from shading_atlas_bench.reports.store.database import StoreError
from shading_atlas_bench.reports.store.results import Store
from tests.reports.synthetic import COMMON, make_store


def one_method(folder: Path, values: np.ndarray, metric: str = "flip", variant: str = "v", **other: object) -> Path:
    with Store(folder) as store:
        for frame, value in enumerate(values):
            ok = np.isfinite(value)
            row = COMMON | {"codec": "none", "status": "ok" if ok else "failed", metric: value} | other
            store.commit_frame("sas", variant, frame, [row])
    return folder


def only(found: list[Comparison], metric: str) -> Comparison:
    (comparison,) = [item for item in found if item.metric == metric]
    return comparison


def test_a_run_is_the_same_as_itself_and_metrics_of_all_codings_are_merged(tmp_path: Path) -> None:
    make_store(tmp_path / "a")
    make_store(tmp_path / "b", order=-1)
    found = compare(tmp_path / "a", tmp_path / "b")
    assert {item.verdict for item in found} == {"same"}
    assert {item.method for item in found} == {"grid", "sas", "bins"}
    server = [item for item in found if (item.method, item.metric) == ("sas", "server_ms")]
    assert [(item.codec, item.crf, item.frames) for item in server] == [("all", None, 12)]
    video = [(item.codec, item.crf) for item in found if (item.method, item.metric) == ("sas", "bytes_video")]
    assert video == [("h264", 5), ("h264", 10), ("h264", 25), ("h264", 35), ("none", None)]


def test_a_slower_run_is_worse_in_its_times_only(tmp_path: Path) -> None:
    make_store(tmp_path / "a")
    make_store(tmp_path / "b", slower=1.3)
    found = compare(tmp_path / "a", tmp_path / "b")
    changed = {item.metric for item in found if item.verdict != "same"}
    assert changed == {"structs_ms", "gather_ms", "server_ms", "wall_ms"}
    server = next(item for item in found if item.metric == "server_ms")
    assert server.verdict == "worse"
    assert server.change == pytest.approx(0.3, abs=0.01)
    back = compare(tmp_path / "b", tmp_path / "a")
    assert {item.verdict for item in back if item.metric in changed} == {"better"}


@pytest.mark.parametrize(
    ("metric", "factor", "verdict"),
    [
        ("psnr", 1.2, "better"), ("psnr", 0.8, "worse"), ("flip", 1.001, "same"), ("gather_ms", 2.0, "ambiguous"),
        ("network_ms", 1.005, "same"), ("network_ms", 1.05, "worse"),
        ("peak_mb", 1.05, "same"), ("peak_mb", 1.2, "worse"),
    ],
)  # fmt: skip
def test_direction_and_threshold(tmp_path: Path, metric: str, factor: float, verdict: str) -> None:
    values = np.random.default_rng(2).uniform(20, 30, 20)
    a = one_method(tmp_path / "a", values, metric)
    b = one_method(tmp_path / "b", values * factor, metric)
    assert only(compare(a, b), metric).verdict == verdict


def test_chance_and_too_few_frames_are_ambiguous(tmp_path: Path) -> None:
    random = np.random.default_rng(3)
    a = one_method(tmp_path / "a", random.uniform(1, 2, 30))
    b = one_method(tmp_path / "b", random.uniform(1, 2, 30))
    assert only(compare(a, b), "flip").verdict == "ambiguous"
    a = one_method(tmp_path / "c", np.ones(4))
    b = one_method(tmp_path / "d", np.full(4, 2.0))
    assert only(compare(a, b), "flip").verdict == "ambiguous"


def test_a_spike_and_a_keyframe_that_medians_hide_are_told(tmp_path: Path) -> None:
    calm, spiky = np.full(20, 100), np.full(20, 100)
    calm[0], spiky[0], spiky[9] = 1000, 4000, 1000
    a = one_method(tmp_path / "a", calm, "bytes_total", frame_rate=50.0)
    b = one_method(tmp_path / "b", spiky, "bytes_total", frame_rate=50.0)
    found = compare(a, b)
    total = only(found, "bytes_total")
    assert (total.a, total.b, total.frames) == (100.0, 100.0, 19)
    assert total.mean_a == 100.0
    assert total.mean_b == pytest.approx(2800 / 19)
    values = {name: only(found, f"bytes_total_{name}") for name in ("kbit_s", "max", "key", "total")}
    assert values["kbit_s"].a == 40.0
    assert values["kbit_s"].b == pytest.approx(2800 / 19 * 0.4)
    assert [(values[name].a, values[name].b) for name in ("max", "key", "total")] == [
        (100.0, 1000.0), (1000.0, 4000.0), (2900.0, 6800.0)
    ]  # fmt: skip
    assert {(row.verdict, row.p) for row in values.values()} == {("worse", None)}
    assert {only(compare(b, a), f"bytes_total_{name}").verdict for name in values} == {"better"}


def test_failed_frames_are_left_out_of_metrics_but_not_forgotten(tmp_path: Path) -> None:
    values = np.linspace(1, 2, 20)
    a = one_method(tmp_path / "a", values)
    b = one_method(tmp_path / "b", np.where(np.arange(20) < 12, np.nan, values))
    found = compare(a, b)
    assert (only(found, "flip").verdict, only(found, "flip").frames) == ("same", 8)
    ok = only(found, "ok")
    assert (ok.verdict, ok.a, ok.b, ok.frames) == ("worse", 1.0, 0.4, 20)


def test_single_variants_are_matched_across_runs(tmp_path: Path) -> None:
    a = one_method(tmp_path / "a", np.linspace(1, 2, 20), variant="block=1")
    b = one_method(tmp_path / "b", np.linspace(1, 2, 20) / 2, variant="block=2")
    flip = only(compare(a, b), "flip")
    assert (flip.variant, flip.verdict) == ("block=1 -> block=2", "better")


def test_variants_are_called_as_their_runs_call_them(tmp_path: Path) -> None:
    values = np.linspace(1, 2, 20)
    a = one_method(tmp_path / "a", values, variant="block=1")
    b = one_method(tmp_path / "b", values, variant="block=2")
    assert only(compare(a, b), "flip").label == "sas"
    for folder, variant, label in ((a, "block=1", "sas"), (b, "block=2", "sas@published"), (b, "block=3", "sas[c=3]")):
        with Store(folder) as store:
            store.notes[f"label/sas[{variant}]"] = label
    assert only(compare(a, b), "flip").label == "sas -> sas@published"
    assert only(compare(b, b), "flip").label == "sas@published"
    one_method(b, values, variant="block=3")
    assert differences(b, a) == ["only A has sas@published, sas[c=3]"]


def test_different_work_is_refused(tmp_path: Path) -> None:
    a = one_method(tmp_path / "a", np.ones(3))
    b = one_method(tmp_path / "b", np.ones(3), path_hash="other")
    with pytest.raises(CompareError, match="path_hash"):
        compare(a, b)
    with pytest.raises(StoreError, match="no results"):
        compare(a, tmp_path / "c")


def test_a_scene_that_is_lit_from_elsewhere_is_refused(tmp_path: Path) -> None:
    """Two worlds of one scene and path hash, and a run of an earlier version, which had no other hash."""
    hashes = {"a": "one", "b": "another", "c": None}
    a, b, c = (one_method(tmp_path / name, np.linspace(1, 2, 20)) for name in hashes)
    for folder, drawn in zip((a, b, c), hashes.values(), strict=True):
        with Store(folder) as store:
            store.set_plan({"drawn_hash": drawn} if drawn else {})
    with pytest.raises(CompareError, match="drawn_hash"):
        compare(a, b)
    assert only(compare(a, c), "flip").verdict == "same"
    assert differences(a, c) == ["drawn_hash: one in A, None in B"]


def test_what_differs_besides_is_said(tmp_path: Path) -> None:
    a, b = one_method(tmp_path / "a", np.ones(12)), one_method(tmp_path / "b", np.ones(8))
    for folder, code, latency in ((a, "1", 50), (b, "2", 80)):
        with Store(folder) as store:
            store.set_plan({"methods": {"sas[v]": code}, "settings": {"latency": latency, "frames": 12}})
            store.notes["label/sas[v]"] = "sas"
    assert differences(a, b) == [
        "the code of sas", "12 frames in A, 8 in B: those that both have are compared", "latency: 50 in A, 80 in B",
    ]  # fmt: skip
    assert differences(a, a) == []
    assert only(compare(a, b), "flip").frames == 8


def test_noise_is_told_and_other_warnings_are_not(tmp_path: Path) -> None:
    folder = one_method(tmp_path / "a", np.ones(3))
    with Store(folder) as store:
        store.notes.update({"warning/00": "busy", "warning/disturbed/pace": "away", "warning/atlas/sas[]": "full"})
    assert noise(folder) == ["busy", "away"]
