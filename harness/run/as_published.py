"""Where a method at its defaults and the same method as its paper has it differ, in a run that has both."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from shading_atlas_bench.harness.measure.returned import CheckedPacker
from shading_atlas_bench.harness.plugins import default_values, published_values, variant_of
from shading_atlas_bench.reports.store.csv_files import summarise
from shading_atlas_bench.reports.store.results import Store

Rows = dict[tuple[str, int | None], dict[str, Any]]  # of summary.csv, by codec and rate

NOTES = "published"  # where the store keeps the sentences
MATTERS = 0.05  # relative difference from which on it is told
TIME = "server_ms"  # of which only medians with separate intervals are told
MEASURES = {
    "samples_mean": "samples",
    "flip_mean": "FLIP",
    "dssim_mean": "DSSIM",
    "iwssim_mean": "IW-SSIM",
    "coherence_mean": "coherence",
    "bytes_total_mean": "bytes per frame",
}  # column of summary.csv to its name in sentences; means, because rebuilt frames count
CODED = ("flip_mean", "dssim_mean", "iwssim_mean", "bytes_total_mean")  # measures that depend on the coding


def note_as_published(store: Store, packers: Iterable[CheckedPacker]) -> None:
    """Write a sentence about every method that ran at its defaults and as published, in place of earlier ones."""
    store.notes.replace(NOTES, differences(summarise(store.rows()), list(packers)))


def differences(summaries: list[dict[str, Any]], packers: list[CheckedPacker]) -> dict[str, str]:
    """By method, what its paper's parameters change by more than MATTERS. summaries: rows of summary.csv."""
    ran = {(packer.name, packer.variant) for packer in packers}
    found = {}
    for name, kind in {packer.name: type(packer.own) for packer in packers}.items():
        usual = default_values(kind)
        variants = [variant_of(values) for values in (usual, usual | published_values(kind))]
        if variants[0] != variants[1] and {(name, variant) for variant in variants} <= ran:
            found[name] = _sentence(name, *(_of_variant(summaries, name, each) for each in variants))
    return found


def _of_variant(summaries: list[dict[str, Any]], method: str, variant: str) -> Rows:
    """A variant's rows."""
    return {
        (row["codec"], row["crf"]): row
        for row in summaries
        if (row["method"], row["variant"]) == (method, variant) and row["codec"] is not None
    }


def _sentence(method: str, usual: Rows, published: Rows) -> str:
    changes, compared = _slower(usual, published), False
    for coding in (each for each in usual if each in published):
        for name, meaning in MEASURES.items():
            own, other = usual[coding][name], published[coding][name]
            if own is None or other is None:
                continue
            compared = True
            if own and abs(other / own - 1) > MATTERS:
                of = _coding_words(*coding) if name in CODED else ""
                changes.append(f"{meaning}{of} {other / own - 1:+.0%}")
    told = ", ".join(sorted(set(changes), key=changes.index))
    alike = f"nothing differs by more than {MATTERS:.0%}" if compared else "not both have a frame that counts"
    return f"{method}@published against {method}: {told or alike}."


def _slower(usual: Rows, published: Rows) -> list[str]:
    """The change of the server's time, which all codings share, where the machine's noise leaves no doubt of it."""
    pairs = [(usual[coding], published[coding]) for coding in usual if coding in published]
    for own, other in pairs[:1]:
        ends = [row[f"{TIME}_{end}"] for row in (own, other) for end in ("low", "high")]
        if None not in ends and (ends[1] < ends[2] or ends[3] < ends[0]):
            change = other[f"{TIME}_median"] / own[f"{TIME}_median"] - 1
            return [f"server time {change:+.0%}"] if abs(change) > MATTERS else []
    return []


def _coding_words(codec: str, crf: int | None) -> str:
    if codec == "none":
        return " without loss"
    return f" at CRF {crf}" if crf is not None else f" as {codec.upper()}"
