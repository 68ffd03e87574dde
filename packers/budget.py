"""Rates: at how many texels per pixel a method computes as many shading samples as a frame may have, or as many as its
atlas has room for."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from shading_atlas_bench.arithmetic.functions import log2, power

TOLERANCE = 0.05  # share by which the samples of a frame may differ from its budget
CLOSE = 0.01  # share within which a search ends, so that the next frames need none
LOWEST, HIGHEST = 1 / 64, 8.0  # texels per pixel along each axis
ALL = 1 << 62  # a budget that nothing reaches
TRIALS = 32
FURTHEST = 2.0  # by which the rate of a trial may differ from that of the one before
NARROW = 1.001  # ratio of the rates around the budget at which a search ends
NARROW_ROOM = 1.01  # likewise where the upper one is too high for the atlas
FIRST = 1.009  # change of the rate where the samples do not tell it: mostly so little does, and the search ends with it


@dataclass
class BudgetedRate:
    """Texels per pixel along each axis, kept from frame to frame for as long as it meets the budget.

    lowest, highest: between which it is.
    reached: the samples of the last search's end where they do not meet its budget, because the atlas has no room for
    more, or no rate comes nearer; else None.
    """

    rate: float = 1.0
    reached: int | None = None
    lowest: float = LOWEST
    highest: float = HIGHEST

    def keeps(self, budget: int, found: int | None) -> bool:
        """Whether `found` samples, None if there is no room for them, stay: they meet the budget, or are as near to it
        as the last search came."""
        if found is None:
            return False
        beyond = (self.rate <= self.lowest and found > budget) or (self.rate >= self.highest and found < budget)
        return beyond or _near(found, budget) or (self.reached is not None and _near(found, self.reached))

    def meet(
        self,
        budget: int,
        count: Callable[[float], int | None],
        found: int | None = None,
        highest: float = HIGHEST,
    ) -> bool:
        """Find the rate at which a frame has about `budget` samples, beginning at the present one, which stays if it
        `keeps` the budget. Returns whether there is one that the atlas has room for.

        count: the samples at a rate, about as many as its square and never fewer with a higher one; None where the
        atlas has no room for them. Where the budget is ALL, anything else that grows like them. Its last call is of the
        rate that is kept. found: the samples at the present rate, if they are known; of a layout that grew from
        frame to frame, which may have room where one made at once has none. highest: the rate that none may exceed.
        """
        if self.rate > highest:
            found = None
        self.rate, self.highest = min(self.rate, highest), highest
        if found is None:
            found = count(self.rate)
        if self.keeps(budget, found):
            return True
        self.reached = None
        best, nearest, last = self._search(budget, count, found)
        self.rate = self.lowest if best is None else best
        if last != self.rate and count(self.rate) is None and best is not None:
            return self.meet(budget, count, highest=highest)  # `found` was of a layout that cannot be made anew
        if nearest is not None and not _near(nearest, budget):
            self.reached = nearest
        return best is not None

    def _search(
        self, budget: int, count: Callable[[float], int | None], found: int | None
    ) -> tuple[float | None, int | None, float | None]:
        """The best rate with its samples, None if none has room, and the rate that was tried last."""
        few, many, degree = None, None, 2.0  # rates with too few and too many samples; with which power of it they grow
        rate, last, narrow, stride = self.rate, None, NARROW, 1.0
        best, nearest = (None, None) if found is None else (rate, found)
        for trial in range(TRIALS):
            narrow = NARROW_ROOM if found is None else narrow
            few, many = (rate, many) if found is not None and found < budget else (few, rate)
            if few and many and many < narrow * few:
                break
            before = rate, found
            stride = min(max(stride * stride, FIRST), FURTHEST)
            if found is None:
                rate /= stride
            elif budget == ALL:
                rate *= stride
            else:
                wanted = float(power(budget / max(found, 1), 1 / degree))
                rate *= min(max(wanted, 1 / FURTHEST), FURTHEST)
            if few and many and (trial % 3 == 2 or not few < rate < many):  # a count in steps, or a full atlas
                rate = math.sqrt(few * many)
            rate = min(max(rate, self.lowest), self.highest)
            if rate == before[0]:
                break
            found, last = count(rate), rate
            if found is not None and (nearest is None or abs(found - budget) <= abs(nearest - budget)):
                best, nearest = rate, found
            if nearest is not None and abs(nearest - budget) <= CLOSE * budget:
                break
            at_lowest = rate == self.lowest and (found is None or found > budget)
            at_highest = rate == self.highest and found is not None and found < budget
            if at_lowest or at_highest:
                break
            if found is not None and before[1] is not None and rate != before[0]:
                degree = float(log2(max(found, 1) / max(before[1], 1)) / log2(rate / before[0]))
                degree = min(max(degree, 0.5), 2.0)
        return best, nearest, last


def _near(found: int, wanted: int) -> bool:
    return abs(found - wanted) <= TOLERANCE * wanted
