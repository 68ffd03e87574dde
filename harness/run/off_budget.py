"""Which methods do not compute as many samples as `--samples` asks for, and by how far."""

from __future__ import annotations

from shading_atlas_bench.packers.budget import TOLERANCE
from shading_atlas_bench.reports.store.labels import read_labels
from shading_atlas_bench.reports.store.results import Store

NOTES = "warning/budget"  # where the store keeps the sentences


def note_off_budget(store: Store) -> None:
    """Write a warning about every method with frames off their sample budget, in place of earlier ones."""
    store.notes.replace(NOTES, off_budget(store))


def off_budget(store: Store) -> dict[str, str]:
    """A sentence by METHOD[VARIANT]."""
    labels = read_labels(store)
    shares: dict[tuple[str, str], dict[int, float]] = {}
    for row in store.rows():
        if row["sample_budget"] and row["samples"] is not None:
            share = row["samples"] / row["sample_budget"] - 1
            shares.setdefault((row["method"], row["variant"]), {})[row["frame"]] = share
    return {
        f"{method}[{variant}]": _sentence(labels[method, variant], list(of_frames.values()))
        for (method, variant), of_frames in shares.items()
        if max(map(abs, of_frames.values())) > TOLERANCE
    }


def _sentence(label: str, shares: list[float]) -> str:
    above, below, off = max(shares), min(shares), sum(abs(share) > TOLERANCE for share in shares)
    far = [f"{above:.0%} more"] * (above > TOLERANCE) + [f"{-below:.0%} fewer"] * (below < -TOLERANCE)
    frames = f"in {off} of {len(shares)} frames" if len(shares) > 1 else "in its only frame"
    return (
        f"{label} computes up to {' and '.join(far)} samples than --samples asks for, {frames}: it comes no nearer "
        "with this scene in this atlas."
    )
