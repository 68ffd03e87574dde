"""Methods in the codings that their clients showed, and which of them beats which."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from typing import Any

from shading_atlas_bench.reports.store.columns import BY_NAME, MEASURED_STATUSES
from shading_atlas_bench.reports.store.csv_files import after_keyframe, median_interval
from shading_atlas_bench.reports.store.labels import Key

Row = dict[str, Any]
Coding = tuple[str | None, int | None]


@dataclass(frozen=True)
class Judged:
    """A method in one coding, its summary and its rows."""

    key: Key
    summary: Row
    rows: list[Row]

    @property
    def coding(self) -> Coding:
        """Codec and rate; None for a row without one."""
        return self.summary["codec"], self.summary["crf"]

    def values(self, name: str) -> dict[int, float]:
        """The values of a measure, by frame, that its statistics are over."""
        measured = (row for row in self.rows if row["status"] in MEASURED_STATUSES)
        return after_keyframe(name, {row["frame"]: row[name] for row in measured if row[name] is not None})

    def beats(self, rival: Judged, name: str) -> bool:
        """Whether the 95 % interval of the median difference, frame by frame, lies on the better side of zero."""
        sign = -1 if BY_NAME[name].better == "lower" else 1
        a, b = self.values(name), rival.values(name)
        low, _ = median_interval(sorted(sign * (a[frame] - b[frame]) for frame in a.keys() & b.keys()))
        return low is not None and low > 0

    def beats_all(self, others: list[Judged], name: str) -> bool:
        """Whether it beats every one of the others that has such values, of which there are some."""
        rivals = [other for other in others if other.key != self.key and other.values(name)]
        return bool(rivals) and all(self.beats(rival, name) for rival in rivals)


def displayed_codings(rows: list[Row]) -> dict[Coding, list[Row]]:
    """Rows of one method by coding: those whose picture a client showed, or the first where none did."""
    by_coding: dict[Coding, list[Row]] = defaultdict(list)
    for row in rows:
        by_coding[row["codec"], row["crf"]].append(row)
    judged = {
        coding: found for coding, found in by_coding.items() if any(row["client_ms"] is not None for row in found)
    }
    return judged or dict(list(by_coding.items())[:1])


def displayed(rows: list[Row], summaries: list[Row], key: Key) -> list[Judged]:
    """A method in the codings that a client showed, those with video coding first."""
    codings = displayed_codings([row for row in rows if (row["method"], row["variant"]) == key])
    own = {(row["codec"], row["crf"]): row for row in summaries if (row["method"], row["variant"]) == key}
    ordered = sorted(codings, key=lambda coding: coding[0] == "none")
    return [Judged(key, own[coding], codings[coding]) for coding in ordered]
