"""Costs that come now and then: methods name them, and a run says which it does not hold."""

from __future__ import annotations

from pathlib import Path

from shading_atlas_bench.harness.measure.returned import CheckedPacker
from shading_atlas_bench.harness.plugins import find_packers, variant_string
from shading_atlas_bench.harness.run.rare import note_unseen, unseen_costs
from shading_atlas_bench.packers.interface import Packer, RareCost
from shading_atlas_bench.packers.sas import ShadingAtlasStreaming
from shading_atlas_bench.packers.snakebinning import SnakeBinning
from shading_atlas_bench.reports.store.results import Store
from tests.reports.synthetic import COMMON


def costs(*packers: Packer) -> dict[CheckedPacker, tuple[RareCost, ...]]:
    return {(checked := CheckedPacker(packer)): checked.rare_costs() for packer in packers}


def rows(packer: Packer, **counts: list[float]) -> list[dict]:
    """Rows of statistics.csv."""
    place = {"method": packer.name, "variant": variant_string(packer)}
    return [
        place | {"frame": frame, "name": name, "value": value}
        for name, values in counts.items()
        for frame, value in enumerate(values)
    ]


def test_only_methods_that_keep_a_layout_have_rare_costs() -> None:
    with_costs = {name for name, packer in find_packers().items() if packer().rare_costs()}
    assert with_costs == {"sas", "snakebinning"}


def test_parameters_decide_what_there_is_and_when() -> None:
    assert {cost.counter: cost.frames for cost in SnakeBinning(mapping="exact").rare_costs()} == {
        "resets": None, "remappings": 61, "rebuilds": 10
    }  # fmt: skip
    bare = SnakeBinning(remap_interval=0, freeze=0.0)
    assert [cost.counter for cost in bare.rare_costs()] == ["resets"]


def test_what_was_seen_is_not_told_and_what_was_not_is() -> None:
    sas, snake = ShadingAtlasStreaming(), SnakeBinning(mapping="exact")
    seen = rows(sas, resets=[0, 0, 1])
    assert unseen_costs(costs(sas), seen) == {}
    others = rows(snake, resets=[0] * 12, remappings=[0] * 12, rebuilds=[0, 1] * 6)
    found = unseen_costs(costs(sas, snake), seen + others)
    texts = {key.rpartition("/")[2]: text for key, text in found.items()}
    assert set(texts) == {"resets", "remappings"}
    assert "none of its 12 frames holds a new mapping of all bins" in texts["remappings"]
    assert "--frames 61 would show it" in texts["remappings"]
    assert "the path decides" in texts["resets"]
    published = ShadingAtlasStreaming(complete=True)
    (named,) = unseen_costs(costs(published), rows(published, resets=[0, 0])).values()
    assert named.startswith("sas@published: none of its 2 frames")
    (alone,) = unseen_costs(costs(sas), rows(sas, resets=[0])).values()
    assert "its only frame does not hold" in alone


def test_a_method_that_did_not_run_is_not_told_of() -> None:
    assert unseen_costs(costs(ShadingAtlasStreaming()), []) == {}


def test_notes_follow_the_frames(tmp_path: Path) -> None:
    sas = ShadingAtlasStreaming()
    variant = variant_string(sas)
    with Store(tmp_path) as store:
        row = COMMON | {"codec": "none", "status": "ok"}
        store.commit_frame("sas", variant, 0, [row], (), {"resets": 0})
        store.notes["rare/tss[]/other"] = "of another method"
        note_unseen(store, costs(sas))
        assert list(store.notes.under("rare")) == [f"sas[{variant}]/resets", "tss[]/other"]
        store.commit_frame("sas", variant, 1, [row], (), {"resets": 1})
        note_unseen(store, costs(sas))
        assert list(store.notes.under("rare")) == ["tss[]/other"]
