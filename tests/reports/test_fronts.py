"""Pareto fronts and who wins where, on planted data: a winner, an overlap, nothing to say."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shading_atlas_bench.reports.analysis.fronts import Candidate, Range, pareto_front, ranges_won
from shading_atlas_bench.reports.pages.sweep_words import verdict

FRAMES = 8
FEW = st.integers(0, 6).map(float)  # few values, so that ties happen
POINTS = st.lists(st.tuples(FEW, FEW), max_size=20)


def beats(a: tuple[float, float], b: tuple[float, float]) -> bool:
    return a[0] <= b[0] and a[1] <= b[1] and a != b


@settings(max_examples=60, deadline=None)
@given(points=POINTS)
def test_a_point_is_on_the_front_exactly_if_no_other_beats_it(points: list[tuple[float, float]]) -> None:
    front = pareto_front(points)
    expected = {i for i, point in enumerate(points) if not any(beats(other, point) for other in points)}
    assert set(front) == expected
    assert len(front) == len(expected)
    places = [points[index] for index in front]
    assert places == sorted(places)
    assert [error for _, error in places] == sorted((error for _, error in places), reverse=True)


def cell(method: str, cost: float, error: float, width: float = 0.1, noise: float = 0.0) -> Candidate:
    """A candidate whose cost has an interval of +-width, and whose errors go up and down over the frames."""
    errors = {frame: error + 0.01 * frame + noise * (-1) ** frame for frame in range(FRAMES)}
    return Candidate(method, cost * (1 - width), cost, cost * (1 + width), error, errors)


def test_a_planted_winner_is_found_and_only_where_it_wins() -> None:
    cells = [cell("a", 10, 0.3), cell("a", 40, 0.1), cell("b", 20, 0.2)]
    assert ranges_won(cells) == [
        Range(9.0, 11.0, None),
        Range(11.0, 18.0, "a", alone=True),
        Range(18.0, 22.0, None),
        Range(22.0, 36.0, "b"),
        Range(36.0, 44.0, None),
        Range(44.0, None, "a"),
    ]


def test_intervals_of_time_that_overlap_leave_no_winner_between_them() -> None:
    wide = ranges_won([cell("a", 10, 0.3, width=0.5), cell("b", 12, 0.2, width=0.5)])
    assert [(each.start, each.method) for each in wide] == [(5.0, None), (18.0, "b")]


def test_errors_that_differ_in_no_consistent_direction_leave_no_winner() -> None:
    cells = [cell("a", 10, 0.30, noise=0.1), cell("b", 10, 0.31, noise=-0.1)]
    assert all(each.method is None for each in ranges_won(cells))
    assert verdict(cells, "server_ms", "flip").startswith("No clear winner: nowhere")


def test_a_rival_that_is_better_in_no_cell_does_not_hide_the_winner() -> None:
    cells = [cell("a", 10, 0.1, width=0), cell("b", 10, 0.2, width=0), cell("b", 20, 0.15, width=0)]
    assert ranges_won(cells) == [Range(10.0, None, "a")]


@pytest.mark.parametrize(
    ("cells", "says"),
    [
        ([], "No cell has these values."),
        ([cell("a", 10, 0.3)], "Only a has points here: there is nothing to compare."),
        (
            [cell("a", 10, 0.3, width=0), cell("b", 20, 0.2, width=0)],
            "Lowest FLIP error by server time (ms): a alone from 10 to 20, b from 20 on.",
        ),
        (
            [Candidate("a", None, 10, None, 0.3, {0: 0.3}), Candidate("b", None, 20, None, 0.2, {0: 0.2})],
            "No clear winner: an interval needs 6 frames, and the sweep has 1 (--frames 6).",
        ),
        (
            [Candidate(name, None, 10, None, 0.3, dict.fromkeys(range(6), 0.3)) for name in "ab"],
            "No clear winner: the interval of a time needs 6 repetitions, and no cell has as many.",
        ),
    ],
)
def test_the_sentence(cells: list[Candidate], says: str) -> None:
    assert verdict(cells, "server_ms", "flip") == says


def test_a_higher_psnr_wins_in_words() -> None:
    cells = [cell("a", 1e4, -20, width=0), cell("b", 1e4, -30, width=0)]
    assert verdict(cells, "samples", "psnr") == "Highest PSNR by samples (thousand): b from 10 on."


def test_a_rival_without_an_interval_has_to_be_beaten_at_every_budget() -> None:
    """Better than all by its error, at a cost that is not known well: nobody can be called the winner beside it."""
    cells = [cell("a", 10, 0.3), cell("b", 20, 0.2)]
    better, worse = (replace(cell("c", 15, error), low=None, high=None) for error in (0.1, 0.4))
    assert all(each.method is None for each in ranges_won([*cells, better]))
    assert "1 of c" in verdict([*cells, better], "server_ms", "flip")
    # One that loses to both changes nothing, but that nobody is alone any more.
    assert [(each.start, each.method) for each in ranges_won([*cells, worse])] == [
        (9.0, None), (11.0, "a"), (18.0, None), (22.0, "b"),
    ]  # fmt: skip
    assert not any(each.alone for each in ranges_won([*cells, worse]))


def test_a_cell_without_an_interval_wins_nothing() -> None:
    best = replace(cell("a", 10, 0.1), low=None, high=None)
    ranges = ranges_won([best, cell("a", 12, 0.4), cell("b", 20, 0.2)])
    assert [(each.method, each.alone) for each in ranges] == [(None, False), ("a", True), (None, False)]
