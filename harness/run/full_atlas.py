"""Which methods had no room in the atlas for the texels of their own rule, and in how many frames."""

from __future__ import annotations

from collections import defaultdict

from shading_atlas_bench.packers.interface import FULL
from shading_atlas_bench.reports.store.labels import read_labels
from shading_atlas_bench.reports.store.results import Store

NOTES = "warning/full"  # where the store keeps the sentences


def note_full_atlas(store: Store) -> None:
    """Write a sentence about every method whose atlas was full, in place of earlier ones."""
    store.notes.replace(NOTES, full_atlases(store))


def full_atlases(store: Store) -> dict[str, str]:
    """A sentence by METHOD[VARIANT], of the frames for which the method says so (the statistic FULL)."""
    labels = read_labels(store)
    told: dict[tuple[str, str], list[float]] = defaultdict(list)
    for row in store.statistics():
        if row["name"] == FULL:
            told[row["method"], row["variant"]].append(row["value"])
    return {
        f"{method}[{variant}]": _sentence(labels[method, variant], sum(value > 0 for value in values), len(values))
        for (method, variant), values in told.items()
        if any(values)
    }


def _sentence(label: str, full: int, frames: int) -> str:
    times = "in its only frame" if frames == 1 else f"in {full} of {frames} frames"
    return (
        f"{label} fills its atlas {times}, and has fewer texels there than by its own rule: compare a larger --atlas."
    )
