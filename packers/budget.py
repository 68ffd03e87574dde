"""Sample budgets: the rate at which a method computes as many shading samples as a frame may have."""

from __future__ import annotations

import math
from collections.abc import Callable

TOLERANCE = 0.05  # share by which the samples of a frame may differ from its budget
CLOSE = 0.01  # share within which a search ends, so that the next frames need none
LOWEST, HIGHEST = 1 / 64, 8.0  # texels per pixel along each axis
TRIALS = 24
FURTHEST = 2.0  # by which the rate of a trial may differ from that of the one before


def keeps(budget: int, found: int, rate: float) -> bool:
    """Whether `found` samples at `rate` stay: they are within TOLERANCE of the budget, or no rate comes nearer."""
    beyond = (rate <= LOWEST and found > budget) or (rate >= HIGHEST and found < budget)
    return beyond or abs(found - budget) <= TOLERANCE * budget


def rate_for(budget: int, count: Callable[[float], int], rate: float, found: int | None = None) -> float:
    """The rate, in texels per pixel along each axis, at which a frame has about `budget` samples.

    count: the samples at a rate; they never become fewer with a higher one, and are about as many as its square. Its
    last call is of the rate that is returned. rate: where the search begins; it stays if it `keeps` the budget. Else
    the search goes on until the samples are within CLOSE, or as near as rates come. found: the samples at `rate`, if
    they are known.
    """
    last = None if found is not None else rate
    found = count(rate) if found is None else found
    if keeps(budget, found, rate):
        return rate
    few, many, power = None, None, 2.0  # rates with too few and too many samples; of which power of it they grow
    best, least = rate, abs(found - budget)
    for trial in range(TRIALS):
        few, many = (rate, many) if found < budget else (few, rate)
        before = rate, max(found, 1)
        rate *= min(max((budget / before[1]) ** (1 / power), 1 / FURTHEST), FURTHEST)
        if few and many and (trial % 3 == 2 or not few < rate < many):  # a count in steps
            rate = math.sqrt(few * many)
        rate = min(max(rate, LOWEST), HIGHEST)
        found, last = count(rate), rate
        if abs(found - budget) <= least:
            best, least = rate, abs(found - budget)
        at_an_end = rate in (LOWEST, HIGHEST) and keeps(budget, found, rate)
        if least <= CLOSE * budget or at_an_end or (few and many and many < 1.001 * few):
            break
        if rate != before[0]:
            power = math.log(max(found, 1) / before[1]) / math.log(rate / before[0])
            power = min(max(power, 0.5), 2.0)
    if last != best:
        count(best)
    return best
