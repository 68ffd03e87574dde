"""Who wins where, in one sentence: only where the intervals separate."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from shading_atlas_bench.reports.analysis.fronts import Candidate, Range, ranges_won

FEWEST = 6  # values that an interval of a median needs
NAMES = {
    "flip": "FLIP error", "dssim": "DSSIM", "iwssim": "IW-SSIM", "psnr": "PSNR", "delta_e": "CIEDE2000 difference",
    "stretch_l2": "stretch",
}  # fmt: skip
CODING_NAMES = {"displayed": "as displayed", "lossless": "without video coding"}
BEST = {"iwssim": "Highest", "psnr": "Highest"}
COST_NAMES = {
    "server_ms": ("server time", "ms", 1.0),
    "samples": ("samples", "thousand", 1e-3),
    "bytes_total": ("bytes sent", "kB", 1e-3),
    "atlas_mb": ("atlas memory", "MB", 1.0),
}  # cost to its name, the unit people read, and what it is multiplied with for that
RULE = (
    "With a budget on the horizontal axis, a method is judged by its best cell whose whole interval of repetitions is "
    "within the budget. It wins where that cell has a lower error than every cell of the others whose interval begins "
    "within the budget: the 95 % interval of the median difference, frame by frame, excludes zero. A cell timed too "
    "rarely for an interval may be within every budget: it has to be beaten everywhere, and wins nothing. Cells that "
    "are not ok are on no front and win nothing."
)


def verdict(candidates: Sequence[Candidate], cost: str, error: str) -> str:
    """The sentence for candidates of one condition and coding, their costs in the unit of the store."""
    if not candidates:
        return "No cell has these values."
    if len({candidate.method for candidate in candidates}) < 2:
        return f"Only {candidates[0].method} has points here: there is nothing to compare."
    frames = max(len(candidate.errors) for candidate in candidates)
    if frames < FEWEST:
        return f"No clear winner: an interval needs {FEWEST} frames, and the sweep has {frames} (--frames {FEWEST})."
    if all(candidate.low is None for candidate in candidates):
        return f"No clear winner: the interval of a time needs {FEWEST} repetitions, and no cell has as many."
    ranges, open_ended = ranges_won(candidates), _without_interval(candidates)
    if all(each.method is None for each in ranges):
        return f"No clear winner: nowhere do the intervals separate.{open_ended}"
    name, unit, scale = COST_NAMES[cost]
    phrases = ", ".join(_phrase(each, scale) for each in ranges)
    return f"{BEST.get(error, 'Lowest')} {NAMES[error]} by {name} ({unit}): {phrases}.{open_ended}"


def _without_interval(candidates: Sequence[Candidate]) -> str:
    """A sentence about the cells that have no interval of their cost; nothing where all have one."""
    counts = Counter(candidate.method for candidate in candidates if candidate.low is None)
    if not counts:
        return ""
    which = ", ".join(f"{count} of {method}" for method, count in counts.items())
    return f" Cells without an interval count as within every budget: {which}."


def _phrase(each: Range, scale: float) -> str:
    who = f"{each.method} alone" if each.alone else each.method or "no clear winner"
    start = _number(each.start * scale)
    return f"{who} from {start} on" if each.end is None else f"{who} from {start} to {_number(each.end * scale)}"


def _number(value: float) -> str:
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}"
