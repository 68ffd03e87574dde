"""Medians and means of any finite numbers, also of those whose sum is beyond floating point."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable


def median(values: Iterable[float]) -> float:
    """As `statistics.median`; the middle two are halved before they are added where their sum is infinite."""
    known = list(values)
    middle = statistics.median(known)
    if math.isfinite(middle):
        return middle
    return statistics.median_low(known) / 2 + statistics.median_high(known) / 2


def mean(values: Iterable[float]) -> float:
    """As `statistics.fmean`; values are made smaller by a power of two where their sum is infinite."""
    known = list(values)
    try:
        return statistics.fmean(known)
    except OverflowError:
        down = math.ldexp(1.0, -len(known).bit_length())
        middle = math.fsum(value * down for value in known) / len(known) / down
        return min(max(middle, min(known)), max(known))


def finite(value: float | None) -> float | None:
    """The value, or None where it is beyond floating point."""
    return value if value is not None and math.isfinite(value) else None
