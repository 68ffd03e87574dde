"""What methods do in a few frames only, and which runs are too short to hold it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from shading_atlas_bench.harness.plugins import label_of, variant_string
from shading_atlas_bench.packers.interface import Packer, RareCost
from shading_atlas_bench.reports.store.results import Store

NOTES = "rare"  # where the store keeps the sentences


def note_unseen(store: Store, packers: Iterable[Packer]) -> None:
    """Write what no frame of a finished run holds into its notes, in place of what earlier frames did not hold."""
    packers = list(packers)
    own = tuple(f"{packer.name}[{variant_string(packer)}]/" for packer in packers)
    for key in store.notes.under(NOTES):
        if key.startswith(own):
            del store.notes[f"{NOTES}/{key}"]
    for key, text in unseen_costs(packers, store.statistics()).items():
        store.notes[f"{NOTES}/{key}"] = text


def unseen_costs(packers: Iterable[Packer], statistics: Iterable[dict[str, Any]]) -> dict[str, str]:
    """A sentence for each rare cost that no frame of a run holds, by METHOD[VARIANT]/COUNTER.

    statistics: rows of the run's statistics.csv. Methods without a value of the counter did not run, and are left out.
    """
    counts: dict[tuple[str, str, str], list[float]] = {}
    for row in statistics:
        if row["value"] is not None:
            counts.setdefault((row["method"], row["variant"], row["name"]), []).append(row["value"])
    found = {}
    for packer in packers:
        variant = variant_string(packer)
        for cost in packer.rare_costs():
            values = counts.get((packer.name, variant, cost.counter), [])
            if values and max(values) == 0:
                found[f"{packer.name}[{variant}]/{cost.counter}"] = _sentence(label_of(packer), cost, len(values))
    return found


def _sentence(label: str, cost: RareCost, frames: int) -> str:
    """What is missing, when it would come, and how many frames would show it."""
    certain = cost.frames is not None and cost.frames > frames
    shown = f"--frames {cost.frames} would show it" if certain else "how many frames that takes, the path decides"
    unseen = "its only frame does not hold" if frames == 1 else f"none of its {frames} frames holds"
    return f"{label}: {unseen} {cost.what}, and no number here includes its cost. It comes {cost.when}: {shown}."
