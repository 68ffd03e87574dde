"""Which frames were measured while the machine did something else, or changed its pace."""

from __future__ import annotations

from statistics import median

from shading_atlas_bench.reports.pages.tables import ranges
from shading_atlas_bench.reports.store.disturbance import OTHERS, REFERENCE, is_disturbed, of_frames
from shading_atlas_bench.reports.store.results import Store

NOTES = "warning/disturbed"  # where the store keeps the sentences
PACE = 1.5  # of the reference's time over its median along the path, beyond which frames are called out of pace
WINDOW = 3  # frames in a row that must be: one alone is a slip of the clock


def note_disturbed(store: Store) -> None:
    """Write a warning about frames that other programs disturbed, and about those out of pace, in place of earlier
    ones."""
    store.notes.replace(NOTES, disturbed(store))


def disturbed(store: Store) -> dict[str, str]:
    """A sentence each, by what it is about."""
    statistics = store.statistics()
    others, paces = of_frames(statistics, OTHERS), of_frames(statistics, REFERENCE)
    found = {}
    if busy := {frame for frame, taken in others.items() if is_disturbed(taken)}:
        most = max(others[frame] for frame in busy)
        found["others"] = (
            f"Other programs took up to {most:.0%} of the machine's cores in {_frames(busy)}: compare ratios, not "
            "times, or run again on a quiet machine."
        )
    if away := out_of_pace(paces):
        usual = median(paces.values())
        times = [paces[frame] / usual for frame in away]
        found["pace"] = (
            f"The reference took {min(times):.1f} to {max(times):.1f} times as long as usual in {_frames(away)}: the "
            "machine changed its pace, and times there are of another one."
        )
    return found


def out_of_pace(milliseconds: dict[int, float]) -> set[int]:
    """The frames in runs of at least WINDOW whose time, of work that hardly changes, is PACE times the median's or
    more, or less than a PACE-th of it. milliseconds: by frame."""
    if len(milliseconds) < 2 * WINDOW:
        return set()
    usual = median(milliseconds.values())
    frames = sorted(milliseconds)
    away: set[int] = set()
    for first in range(len(frames) - WINDOW + 1):
        window = frames[first : first + WINDOW]
        shares = [milliseconds[frame] / usual for frame in window]
        if min(shares) >= PACE or max(shares) <= 1 / PACE:
            away.update(window)
    return away


def _frames(frames: set[int]) -> str:
    return f"frame{'s' * (len(frames) > 1)} {ranges(frames)}"
