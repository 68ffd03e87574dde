"""What each method and variant is called wherever results are shown."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from shading_atlas_bench.reports.store.results import Store

Key = tuple[str, str]  # method and variant
Labels = dict[Key, str]
NOTES = "label"  # where the store keeps the labels that `bench run` and `bench sweep` gave, by METHOD[VARIANT]


def read_labels(store: Store) -> Labels:
    """The unique label of every method and variant with results, sorted by method and label: `NAME` at its defaults,
    `NAME@published` as published, else with what differs from either in brackets.

    Where a store of an earlier version has no labels, the defaults are not known, and brackets hold what variants of a
    method do not share.
    """
    keys = sorted({(method, variant) for method, variant, _ in store.finished()})
    labels = _noted(keys, store.notes.under(NOTES))
    if labels is None:
        labels = _by_difference(keys, store.notes.under("as_published").items())
    return dict(sorted(labels.items(), key=lambda item: (item[0][0], item[1])))


def _noted(keys: Collection[Key], notes: Mapping[str, str]) -> Labels | None:
    """The labels that the notes hold; None where one is missing."""
    names = {(method, variant): f"{method}[{variant}]" for method, variant in keys}
    return {key: notes[name] for key, name in names.items()} if notes.keys() >= set(names.values()) else None


def _by_difference(keys: Collection[Key], published: Collection[Key]) -> Labels:
    """Labels with the parameters in which variants of a method differ, and `@published` for those in `published`."""
    labels: Labels = {}
    for method in {method for method, _ in keys}:
        variants = [variant for name, variant in keys if name == method]
        others = [variant for variant in variants if (method, variant) not in published]
        shared = set.intersection(*(set(variant.split(",")) for variant in others or variants))
        for variant in others:
            own = [part for part in variant.split(",") if part not in shared]
            labels[method, variant] = f"{method}[{','.join(own)}]" if own else method
        for variant in variants:
            labels.setdefault((method, variant), f"{method}@published")
    return labels
