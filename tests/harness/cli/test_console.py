"""What a run prints: everything sent comes first, fits 80 columns, and is empty where nothing was measured."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from shading_atlas_bench.harness.cli.catalogue import show_catalogue
from shading_atlas_bench.harness.cli.comparison import show_comparison
from shading_atlas_bench.harness.cli.dry_run import show_plan
from shading_atlas_bench.harness.cli.main import COMMANDS, app
from shading_atlas_bench.harness.cli.summary import show_summary
from shading_atlas_bench.harness.workload.settings import Settings
from shading_atlas_bench.reports.store.results import Store
from tests.reports.synthetic import COMMON, make_store

BYTES = (1_000_000, 20_000, 40_000, 90_000)  # the mean after the keyframe is 50 kB, at 60 per second 24,000 kbit/s


def fill(folder: Path, variant: str = "fit=0.75") -> Path:
    """A run of one method in which each frame sends BYTES, a fifth of it video and the rest metadata."""
    with Store(folder) as store:
        for frame, total in enumerate(BYTES):
            parts = {"bytes_total": total, "bytes_video": total // 5, "bytes_metadata": total - total // 5}
            row = COMMON | parts | {"status": "ok", "server_ms": 5.0, "samples": 1000, "client_ms": 1.0}
            store.commit_frame("sas", variant, frame, [row | {"codec": "h264", "crf": 25}])
        store.notes["rare/sas[]/resets"] = "sas: none of its 4 frames holds an atlas reset."
    return folder


def test_the_first_size_is_everything_sent(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    show_summary(fill(tmp_path), whole=True)
    lines = capsys.readouterr().out.splitlines()
    (head,) = [n for n, line in enumerate(lines) if "kB/frame" in line]
    assert lines[head].split() == ["method", "codec", "kB/frame", "kbit/s", "largest", "keyframe", "video", "meta"]
    assert lines[head + 1].split() == ["sas", "h264", "25", "50.0", "24,000", "90.0", "1,000", "10.0", "40.0"]
    assert "not seen sas: none of its 4 frames holds an atlas reset." in lines


def test_many_methods_fit_the_console(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    make_store(tmp_path)
    monkeypatch.chdir(tmp_path.parent)
    show_summary(Path(tmp_path.name), whole=True)
    out = capsys.readouterr().out
    assert max(map(len, out.splitlines())) <= 80
    assert all(f"h264 {crf}" in out for crf in (5, 10, 25, 35))
    assert "none" in out


def test_a_frame_that_failed_leaves_cells_empty(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with Store(tmp_path) as store:
        row = COMMON | {"codec": "h264", "crf": 25, "status": "failed", "reason": "out of memory"}
        store.commit_frame("sas", "", 0, [row])
    show_summary(tmp_path, whole=True)
    out = capsys.readouterr().out
    shown = [line.split() for line in out.splitlines() if line.startswith("sas")]
    assert shown == [["sas"], ["sas", "h264", "25"], ["sas", "h264", "25"]]
    assert "out of memory" in out


def test_the_catalogue_fits_the_console(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setattr(
        "shading_atlas_bench.kernels.runtime.opencl.find_devices", list
    )  # drivers' names are as long as they like
    show_catalogue()
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    (first,) = [n for n, line in enumerate(lines) if "snakebinning@published:" in line]
    assert lines[first].rstrip().endswith(",")
    assert "average_clear=true" in lines[first + 1]


def test_a_comparison_names_the_same_sizes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    show_comparison(fill(tmp_path / "a"), fill(tmp_path / "b"), whole=True)
    out = capsys.readouterr().out
    assert "sas, CRF 25, frames: 4" in out
    lines = [line.split() for line in out.splitlines()]
    assert ["bytes_total", "50,000", "50,000", "40,000", "40,000", "same", "1"] in lines
    assert ["bytes_total_kbit_s", "24,000", "24,000", "same"] in lines
    assert ["bytes_total_key", "1,000,000", "1,000,000", "same"] in lines


def test_a_plan_says_whom_a_number_of_samples_does_not_reach(capsys: pytest.CaptureFixture[str]) -> None:
    told = "note --samples does not reach ppll: without an atlas it keeps its own number of samples."
    small = Settings(methods=("ppll@published", "ppll", "sas"), scene="shells", frames=1, width=64, height=36)
    for settings, says in (
        (replace(small, samples_per_pixel=2.0), True),
        (replace(small, samples_per_pixel=2.0, methods=("sas",)), False),
        (small, False),
    ):
        show_plan(settings, None)
        assert (told in " ".join(capsys.readouterr().out.split())) == says


@pytest.mark.parametrize("command", COMMANDS)
def test_flags_are_shown_without_a_value(command: str) -> None:
    shown = CliRunner().invoke(app, [command, "--help"]).output
    assert "--help" in shown
    assert "bool" not in shown.lower()
