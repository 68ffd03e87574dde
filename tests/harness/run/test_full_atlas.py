"""Methods without room for their texels are named, with in how many frames."""

from __future__ import annotations

from pathlib import Path

from shading_atlas_bench.harness.run.full_atlas import NOTES, note_full_atlas
from shading_atlas_bench.packers.interface import FULL
from shading_atlas_bench.reports.store.results import Store
from tests.reports.synthetic import COMMON


def commit(store: Store, method: str, frame: int, statistics: dict[str, float]) -> None:
    row = COMMON | {"codec": "none", "status": "ok"}
    store.commit_frame(method, "", frame, [row], (), statistics)


def test_who_has_no_room_is_told_once(tmp_path: Path) -> None:
    with Store(tmp_path) as store:
        for frame, full in enumerate((0, 1, 1)):
            commit(store, "often", frame, {FULL: full, "bias": 0.5})
            commit(store, "never", frame, {FULL: 0})
            commit(store, "list", frame, {"layers": 3})
        commit(store, "short", 0, {FULL: 1})
        store.notes[f"{NOTES}/gone[]"] = "of an earlier time"
        note_full_atlas(store)
        told = store.notes.under(NOTES)
    assert set(told) == {"often[]", "short[]"}
    assert told["often[]"].startswith("often fills its atlas in 2 of 3 frames")
    assert told["short[]"].startswith("short fills its atlas in its only frame")
