"""What methods do in a few frames only, and which runs are too short to hold it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from shading_atlas_bench.harness.measure.returned import CheckedPacker
from shading_atlas_bench.packers.interface import RareCost
from shading_atlas_bench.reports.store.results import Store

NOTES = "rare"  # where the store keeps the sentences


Costs = Mapping[CheckedPacker, tuple[RareCost, ...]]  # of each packer, as it told them


def note_unseen(store: Store, costs: Costs) -> None:
    """Write what no frame of a finished run holds into its notes, in place of what earlier frames did not hold."""
    own = tuple(f"{packer.name}[{packer.variant}]/" for packer in costs)
    for key in store.notes.under(NOTES):
        if key.startswith(own):
            del store.notes[f"{NOTES}/{key}"]
    for key, text in unseen_costs(costs, store.statistics()).items():
        store.notes[f"{NOTES}/{key}"] = text


def unseen_costs(costs: Costs, statistics: Iterable[dict[str, Any]]) -> dict[str, str]:
    """A sentence for each rare cost that no frame of a run holds, by METHOD[VARIANT]/COUNTER.

    statistics: rows of the run's statistics.csv. Methods without a value of the counter did not run, and are left out.
    """
    counts: dict[tuple[str, str, str], list[float]] = {}
    for row in statistics:
        if row["value"] is not None:
            counts.setdefault((row["method"], row["variant"], row["name"]), []).append(row["value"])
    found = {}
    for packer, known in costs.items():
        for cost in known:
            values = counts.get((packer.name, packer.variant, cost.counter), [])
            if values and max(values) == 0:
                key = f"{packer.name}[{packer.variant}]/{cost.counter}"
                found[key] = _sentence(packer.label, cost, len(values))
    return found


def _sentence(label: str, cost: RareCost, frames: int) -> str:
    """What is missing, when it would come, and how many frames would show it."""
    certain = cost.frames is not None and cost.frames > frames
    shown = f"--frames {cost.frames} would show it" if certain else "how many frames that takes, the path decides"
    unseen = "its only frame does not hold" if frames == 1 else f"none of its {frames} frames holds"
    return f"{label}: {unseen} {cost.what}, and no number here includes its cost. It comes {cost.when}: {shown}."
