"""What methods and variants are called: as the harness noted it, or in older stores by what differs."""

from __future__ import annotations

from pathlib import Path

from shading_atlas_bench.reports.store.labels import NOTES, Labels, read_labels
from shading_atlas_bench.reports.store.results import Store
from tests.reports.synthetic import COMMON

ROW = COMMON | {"codec": "none", "status": "ok"}


def labels_of(folder: Path, keys: list[tuple[str, str]], notes: dict[str, str]) -> Labels:
    with Store(folder) as store:
        for method, variant in keys:
            for frame in range(2):
                store.commit_frame(method, variant, frame, [ROW])
        for key, text in notes.items():
            store.notes[key] = text
        return read_labels(store)


def test_labels_are_those_of_the_harness_defaults_first(tmp_path: Path) -> None:
    named = {("sas", "a=1"): "sas[a=1]", ("sas", "a=3"): "sas", ("grid", ""): "grid", ("sas", "a=2"): "sas@published"}
    notes = {f"{NOTES}/{method}[{variant}]": label for (method, variant), label in named.items()}
    found = labels_of(tmp_path, list(named), notes | {f"{NOTES}/sas[a=9]": "not finished yet"})
    assert found == named
    assert list(found.values()) == ["grid", "sas", "sas@published", "sas[a=1]"]


def test_without_them_brackets_hold_what_differs(tmp_path: Path) -> None:
    keys = [("sas", "a=1,b=2"), ("sas", "a=1,b=3"), ("grid", "cell=8")]
    assert labels_of(tmp_path, keys, {f"{NOTES}/grid[cell=8]": "one is not enough"}) == {
        ("grid", "cell=8"): "grid", ("sas", "a=1,b=2"): "sas[b=2]", ("sas", "a=1,b=3"): "sas[b=3]"
    }  # fmt: skip


def test_without_them_the_published_variant_is_named_so(tmp_path: Path) -> None:
    keys = [("sas", "a=1,b=2"), ("sas", "a=9,b=9"), ("sas", "a=1,b=3"), ("tss", "c=1")]
    noted = {"as_published/sas": "a=9,b=9"}
    assert labels_of(tmp_path / "all", keys, noted) == {
        ("sas", "a=9,b=9"): "sas@published", ("sas", "a=1,b=2"): "sas[b=2]", ("sas", "a=1,b=3"): "sas[b=3]",
        ("tss", "c=1"): "tss",
    }  # fmt: skip
    assert labels_of(tmp_path / "two", keys[:2], noted)["sas", "a=1,b=2"] == "sas"
    assert labels_of(tmp_path / "one", keys[1:2], noted) == {keys[1]: "sas@published"}
