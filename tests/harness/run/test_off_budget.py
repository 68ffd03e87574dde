"""Methods off their sample budget are named, with how far."""

from __future__ import annotations

from pathlib import Path

from shading_atlas_bench.harness.run.off_budget import NOTES, note_off_budget
from shading_atlas_bench.reports.store.results import Store
from tests.reports.synthetic import COMMON


def test_each_is_called_by_its_label(tmp_path: Path) -> None:
    with Store(tmp_path) as store:
        commit(store, "more", 0, 2000, 1000)
        store.notes["label/more[]"] = "more@published"
        note_off_budget(store)
        assert store.notes[f"{NOTES}/more[]"].startswith("more@published computes up to 100% more samples")


def commit(store: Store, method: str, frame: int, samples: int | None, budget: int | None) -> None:
    status = "ok" if samples is not None else "failed"
    row = COMMON | {"codec": "none", "status": status, "samples": samples, "sample_budget": budget}
    store.commit_frame(method, "", frame, [row], (), {})


def test_who_is_off_is_told_once_and_only_while_it_is(tmp_path: Path) -> None:
    with Store(tmp_path) as store:
        for frame, samples in enumerate((1000, 1049, 951)):
            commit(store, "near", frame, samples, 1000)
            commit(store, "list", frame, 5 * samples, None)
        for frame, samples in enumerate((1000, 1120, 1060)):
            commit(store, "more", frame, samples, 1000)
        commit(store, "fewer", 0, 400, 1000)
        commit(store, "failed", 0, None, 1000)
        note_off_budget(store)
        told = store.notes.under(NOTES)
        assert set(told) == {"more[]", "fewer[]"}
        assert "12% more samples than --samples asks for, in 2 of 3 frames" in told["more[]"]
        assert "60% fewer samples than --samples asks for, in its only frame" in told["fewer[]"]
        commit(store, "more", 3, 900, 1000)
        note_off_budget(store)
        assert "up to 12% more and 10% fewer samples" in store.notes[f"{NOTES}/more[]"]
        told = store.notes.under(NOTES)
        store.notes[f"{NOTES}/gone[]"] = "of an earlier time"
        note_off_budget(store)
        assert store.notes.under(NOTES) == told
