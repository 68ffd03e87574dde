"""Sample budgets: every method with an atlas meets them by its own means, and says where it cannot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shading_atlas_bench.packers.budget import ALL, HIGHEST, LOWEST, NARROW, TOLERANCE, BudgetedRate
from shading_atlas_bench.packers.interface import Packer, ServerScene
from shading_atlas_bench.packers.sas import ShadingAtlasStreaming
from shading_atlas_bench.packers.snakebinning import SnakeBinning
from shading_atlas_bench.packers.tss import TessellatedShadingStreaming
from tests.packers.rooms import changing_sets, frame_of
from tests.packers.streams import Stream

counts = st.integers(1, 10**7)
rates = st.floats(LOWEST, HIGHEST)


class Counted:
    """A count of samples that remembers which rates it was asked for; None above `room`."""

    def __init__(self, count: Callable[[float], int], room: float = HIGHEST) -> None:
        self.count, self.room = count, room
        self.asked: list[float] = []

    def __call__(self, rate: float) -> int | None:
        self.asked.append(rate)
        return None if rate > self.room else self.count(rate)


@given(st.integers(1000, 10**7), rates, st.floats(1e3, 1e6), st.floats(0, 1e4))
def test_a_smooth_count_is_met_or_an_end_is_reached(budget: int, start: float, unit: float, least: float) -> None:
    count, rate = Counted(lambda rate: int(least + unit * rate * rate)), BudgetedRate(start)
    assert rate.meet(budget, count)
    assert count.asked[-1] == rate.rate
    assert LOWEST <= rate.rate <= HIGHEST
    assert rate.keeps(budget, count(rate.rate))
    assert rate.reached in (None, count(rate.rate))


@given(st.integers(1000, 10**7), rates, st.floats(1e3, 1e6), st.floats(2 * LOWEST, HIGHEST))
def test_an_atlas_is_filled_where_it_has_no_room_for_the_budget(
    budget: int, start: float, unit: float, room: float
) -> None:
    count, rate = Counted(lambda rate: int(unit * rate * rate), room), BudgetedRate(start)
    assert rate.meet(budget, count)
    assert count.asked[-1] == rate.rate <= room
    found = count(rate.rate)
    assert found is not None
    if unit * room * room < 0.9 * budget:
        assert rate.rate > 0.97 * room
        assert rate.reached == found
        trials = len(count.asked)
        assert rate.meet(budget, count)
        assert len(count.asked) == trials + 1
    elif unit * LOWEST * LOWEST < budget and unit * room * room > budget:
        assert abs(found - budget) <= TOLERANCE * budget + 1


@given(st.floats(2.0**-16, 4), st.floats(0.97, 1.03), st.floats(1e3, 1e6))
def test_all_that_there_is_room_for_up_to_a_rate_of_one(room: float, change: float, unit: float) -> None:
    """At least a thousand samples, of which one more or less is no change."""
    rate = BudgetedRate(lowest=2.0**-17)
    assert rate.meet(ALL, Counted(lambda rate: 1000 + int(unit * rate * rate), room), highest=1.0)
    assert 0.97 * min(room, 1) < rate.rate <= min(room, 1)
    before, count = rate.rate, Counted(lambda rate: 1000 + int(unit * (rate / change) ** 2), room * change)
    assert rate.meet(ALL, count, highest=1.0)
    assert 0.95 * min(room * change, 1) < rate.rate <= min(room * change, 1)
    if before <= room * change and abs(change - 1) < 0.02:
        assert count.asked == [before]
    assert len(count.asked) <= 14


def test_a_rate_above_the_highest_is_given_up() -> None:
    count, rate = Counted(lambda rate: int(1000 * rate)), BudgetedRate(3.0)
    assert rate.meet(3000, count, 3000, highest=1.0)
    assert rate.rate == count.asked[-1] == 1.0


def test_what_no_rate_has_room_for_is_left_at_the_lowest() -> None:
    count, rate = Counted(lambda rate: 10, 0.0), BudgetedRate()
    assert not rate.meet(1000, count)
    assert rate.rate == count.asked[-1] == LOWEST


@given(counts, rates, st.lists(st.tuples(rates, st.integers(1, 10**6)), min_size=1, max_size=20))
def test_of_a_count_in_steps_nothing_nearer_is_left(budget: int, start: float, steps: list) -> None:
    count = Counted(lambda rate: 1 + sum(height for place, height in steps if rate >= place))
    rate = BudgetedRate(start)
    rate.meet(budget, count)
    sides = [side for place, _ in steps for side in (place, max(LOWEST, np.nextafter(place, 0)))]
    nearest = min(abs(count.count(side) - budget) for side in (LOWEST, HIGHEST, *sides))
    assert abs(count.count(rate.rate) - budget) <= max(nearest, TOLERANCE * budget) or _is_narrow(steps, rate.rate)


def _is_narrow(steps: list, rate: float) -> bool:
    """Whether the rate lies so near to a step that the search ends there."""
    return min(abs(np.log(place / rate)) for place, _ in steps) < 0.01


def test_a_rate_within_the_tolerance_stays() -> None:
    count, rate = Counted(lambda rate: 1000), BudgetedRate(0.7)
    assert rate.meet(round(1000 / (1 + 0.9 * TOLERANCE)), count)
    assert (rate.rate, count.asked) == (0.7, [0.7])
    assert rate.meet(1020, count, 1020)
    assert len(count.asked) == 1


@pytest.mark.parametrize(("budget", "end"), [(1, LOWEST), (10**9, HIGHEST)])
def test_what_no_rate_reaches_ends_at_an_end_and_stays_there(budget: int, end: float) -> None:
    count, rate = Counted(lambda rate: 1000 + int(100 * rate)), BudgetedRate()
    assert rate.meet(budget, count)
    assert rate.rate == count.asked[-1] == end
    trials = len(count.asked)
    assert rate.meet(budget, count)
    assert (rate.rate, len(count.asked)) == (end, trials + 1)


@pytest.mark.parametrize("budget", [500_001, 1_999_999, 3_000_000])
def test_a_count_that_grows_like_the_square_is_met_at_the_second_trial(budget: int) -> None:
    count, rate = Counted(lambda rate: int(1e6 * rate * rate)), BudgetedRate()
    assert rate.meet(budget, count)
    assert count.asked == [1.0, rate.rate]
    assert abs(count.count(rate.rate) - budget) <= 1


@pytest.mark.parametrize(("budget", "end", "then"), [(1, LOWEST, 3000), (10**9, HIGHEST, 500)])
def test_at_an_end_nothing_is_searched_while_the_budget_lies_beyond_it(budget: int, end: float, then: int) -> None:
    """Also where the samples are not what they were when the end was reached."""
    rate = BudgetedRate()
    assert rate.meet(budget, Counted(lambda rate: 1000 + int(100 * rate)))
    count = Counted(lambda rate: then)
    assert rate.meet(budget, count)
    assert (rate.rate, count.asked) == (end, [end])


@pytest.mark.parametrize(("few", "many"), [(500, 2000), (200, 1100), (900, 1800), (100, 1200), (800, 5000)])
def test_a_step_across_the_budget_is_looked_for_closely(few: int, many: int) -> None:
    """No rate comes near to the budget: there are too few samples below 0.7 and too many from there on."""
    count, rate = Counted(lambda rate: few if rate < 0.7 else many), BudgetedRate()
    assert rate.meet(1000, count)
    below, above = (max(r for r in count.asked if r < 0.7), min(r for r in count.asked if r >= 0.7))
    assert above < NARROW * below
    nearest = few if 1000 - few < many - 1000 else many
    assert (count(rate.rate), rate.reached) == (nearest, nearest)


METHODS = [ShadingAtlasStreaming, TessellatedShadingStreaming, SnakeBinning]


@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.name)
@pytest.mark.parametrize("budget", [8_000, 30_000, 150_000])
def test_a_walk_meets_its_budget(scene: ServerScene, method: type[Packer], budget: int) -> None:
    stream, again = Stream(method, scene), Stream(method, scene)
    for step in range(4):
        frame = replace(frame_of(scene, 1024, 1024, 4 * step), sample_budget=budget)
        payload = stream.send(frame)
        assert stream.violations(frame, payload) == []
        assert payload.unplaced == {}
        assert abs(payload.sample_count - budget) <= TOLERANCE * budget
        assert again.send(frame).planes["atlas"].get().tobytes() == payload.planes["atlas"].get().tobytes()


def test_a_layout_that_grew_is_not_kept_where_it_cannot_be_made_anew() -> None:
    """The present rate is the nearest to the budget, but the atlas has room for its samples only as they lie."""
    count, rate = Counted(lambda rate: int(100_000 * rate * rate), room=0.999), BudgetedRate()
    assert rate.meet(120_000, count, 100_000)
    assert count.asked[-1] == rate.rate
    assert 0.98 < rate.rate <= count.room


@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.name)
def test_a_budget_that_the_atlas_does_not_hold_fills_it(scene: ServerScene, method: type[Packer]) -> None:
    counts = []
    for budget in (None, 10**6):
        stream = Stream(method, scene)
        for step in range(3):
            frame = replace(frame_of(scene, 128, 128, 4 * step), sample_budget=budget)
            payload = stream.send(frame)
            assert stream.violations(frame, payload) == []
            assert payload.sample_count <= 128 * 128
        counts.append(payload.sample_count)
    assert counts[1] > 0.9 * counts[0]


@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.name)
@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 1000), budgets=st.lists(st.integers(1, 10**6), min_size=4, max_size=4))
def test_any_budgets_and_sets_are_valid(
    scene: ServerScene, method: type[Packer], seed: int, budgets: list[int]
) -> None:
    stream, rng = Stream(method, scene), np.random.default_rng(seed)
    sets = changing_sets(rng, scene.triangles.count, ["little", "none", "all", "one"], 0.05)
    for chosen, budget in zip(sets, budgets, strict=True):
        frame = replace(frame_of(scene, 256, 256, 0, chosen), sample_budget=budget)
        assert stream.violations(frame, stream.send(frame)) == []
