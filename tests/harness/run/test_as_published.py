"""What a method changes as its paper has it is told where a run has both, and only where it matters."""

from __future__ import annotations

from pathlib import Path

from shading_atlas_bench.harness.measure.returned import CheckedPacker
from shading_atlas_bench.harness.plugins import published_values, variant_string
from shading_atlas_bench.harness.run.as_published import NOTES, note_as_published
from shading_atlas_bench.packers.interface import Packer
from shading_atlas_bench.packers.snakebinning.packer import SnakeBinning
from shading_atlas_bench.packers.tss.packer import TessellatedShadingStreaming
from shading_atlas_bench.reports.store.results import Store
from tests.reports.synthetic import COMMON


def commit(store: Store, packer: Packer, crf: int | None, frame: int, **values: float) -> None:
    row = COMMON | {"codec": "none" if crf is None else "h264", "crf": crf, "status": "ok"} | values
    store.commit_frame(packer.name, variant_string(packer), frame, [row], (), {})


def test_differences_above_five_percent_are_told_by_coding(tmp_path: Path) -> None:
    usual, published = SnakeBinning(), SnakeBinning(**published_values(SnakeBinning))
    with Store(tmp_path) as store:
        for frame in range(6):
            commit(store, usual, None, frame, samples=1000, flip=0.05, server_ms=100.0, coherence=0.9)
            commit(store, published, None, frame, samples=1040, flip=0.06, server_ms=80.0, coherence=0.0)
        note_as_published(store, map(CheckedPacker, [usual, published]))
        told = store.notes.under(NOTES)
        assert told == {
            "snakebinning": "snakebinning@published against snakebinning: server time -20%, FLIP without loss +20%, "
            "coherence -100%."
        }
        note_as_published(store, map(CheckedPacker, [usual]))
        assert not store.notes.under(NOTES)


def test_times_are_told_only_where_their_intervals_are_apart(tmp_path: Path) -> None:
    usual, published = SnakeBinning(), SnakeBinning(**published_values(SnakeBinning))
    with Store(tmp_path) as store:
        for frame in range(8):
            commit(store, usual, None, frame, server_ms=100.0 + 40 * (frame % 2))
            commit(store, published, None, frame, server_ms=110.0 + 40 * (frame % 2))
        note_as_published(store, map(CheckedPacker, [usual, published]))
        assert "server time" not in store.notes.under(NOTES)["snakebinning"]


def test_what_differs_in_a_rare_frame_counts(tmp_path: Path) -> None:
    usual, published = SnakeBinning(), SnakeBinning(**published_values(SnakeBinning))
    with Store(tmp_path) as store:
        for frame in range(9):
            commit(store, usual, 25, frame, bytes_total=1000)
            commit(store, published, 25, frame, bytes_total=2000 if frame == 8 else 1000)
        note_as_published(store, map(CheckedPacker, [usual, published]))
        assert store.notes.under(NOTES)["snakebinning"].endswith("bytes per frame at CRF 25 +12%.")


def test_equal_results_are_told_as_such_and_one_variant_alone_is_not(tmp_path: Path) -> None:
    both = [TessellatedShadingStreaming(), TessellatedShadingStreaming(**published_values(TessellatedShadingStreaming))]
    with Store(tmp_path) as store:
        for packer in both:
            commit(store, packer, None, 0, samples=1000, flip=0.05)
        note_as_published(store, map(CheckedPacker, both))
        assert store.notes.under(NOTES)["tss"].endswith("nothing differs by more than 5%.")
        note_as_published(store, map(CheckedPacker, [SnakeBinning(sink=8), both[0]]))
        assert not store.notes.under(NOTES)


def test_of_a_variant_without_a_frame_that_counts_nothing_is_said(tmp_path: Path) -> None:
    usual, published = SnakeBinning(), SnakeBinning(**published_values(SnakeBinning))
    with Store(tmp_path) as store:
        commit(store, usual, 25, 0, samples=1000, flip=0.05)
        commit(store, published, 25, 0, status="invalid")
        note_as_published(store, map(CheckedPacker, [usual, published]))
        assert store.notes.under(NOTES)["snakebinning"].endswith("not both have a frame that counts.")
