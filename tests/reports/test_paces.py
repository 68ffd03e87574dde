"""Times of two processes: a machine that changes its pace is no change of the code, and a slower code is found."""

from __future__ import annotations

import numpy as np
import pytest

from shading_atlas_bench.reports.analysis.paces import FEWEST, Pace, sure_change

FRAMES = 12


def machine(random: np.random.Generator, frames: int, loads: tuple[float, ...]) -> np.ndarray:
    """How much longer device work takes in each frame: stretches of the same load, one after the other."""
    ends = np.sort(random.integers(1, frames, len(loads) - 1))
    stretches = np.split(np.arange(frames), ends)
    return np.concatenate([np.full(len(each), load) for each, load in zip(stretches, loads, strict=True)])


def run(
    random: np.random.Generator, code: float, loads: tuple[float, ...], feels: float = 1.0
) -> tuple[np.ndarray, Pace]:
    """Times of one run, of work that grows along the path, and what its reference says; feels: how much of the load
    the work feels (a thread's own processor time feels little of it). Everything is noisy by several per cent."""
    pace = machine(random, FRAMES, loads)
    noise = random.lognormal(0, 0.08, (2, FRAMES))
    times = code * np.linspace(20, 30, FRAMES) * pace**feels * noise[0]
    return times, Pace(dict(enumerate(12 * pace * noise[1])))


def judged(a: tuple[np.ndarray, Pace], b: tuple[np.ndarray, Pace]) -> float | None:
    return sure_change(dict(enumerate(zip(a[0], b[0], strict=True))), a[1], b[1])


def some_loads(random: np.random.Generator) -> tuple[float, ...]:
    return tuple(random.uniform(1, 2.5, random.integers(1, 5)))


@pytest.mark.parametrize("feels", [0.0, 0.3, 1.0, 1.3])
def test_the_same_code_under_changing_load_is_not_called_different(feels: float) -> None:
    random = np.random.default_rng(7)
    pairs = [(run(random, 1, some_loads(random), feels), run(random, 1, some_loads(random), feels)) for _ in range(200)]
    called = sum(judged(a, b) is not None for a, b in pairs)
    assert called <= 200 / 20


def test_a_busy_second_run_is_not_slower_code() -> None:
    """36.7 and 18.9 ms of the same code, the first beside two busy processes."""
    random = np.random.default_rng(1)
    busy, calm = run(random, 1, (1.94,)), run(random, 1, (1.0,))
    assert np.median(busy[0]) / np.median(calm[0]) > 1.7
    assert judged(busy, calm) is None


@pytest.mark.parametrize("factor", [0.6, 0.75, 1.3, 1.6])
def test_slower_and_faster_code_is_found_on_a_steady_machine(factor: float) -> None:
    random = np.random.default_rng(3)
    found = [judged(run(random, 1, (1.0,)), run(random, factor, (1.0,))) for _ in range(50)]
    sure = [change for change in found if change is not None]
    assert len(sure) >= 40
    assert all((change - 1) * (factor - 1) > 0 for change in sure)
    assert np.median(sure) == pytest.approx(factor, rel=0.1)


def test_disturbed_frames_are_left_out() -> None:
    times = {frame: (10.0, 20.0 + 0.01 * frame) for frame in range(FRAMES)}
    steady = Pace(dict.fromkeys(range(FRAMES), 5.0))
    assert sure_change(times, steady, steady) == pytest.approx(2.0, rel=0.01)
    few = Pace(steady.reference, frozenset(range(FEWEST - 1, FRAMES)))
    assert sure_change(times, steady, few) is None
    assert sure_change(times, few, steady) is None
    values = {"others_share": (0.0, 0.2, 0.4), "reference_ms": (4.0, 4.0, 4.0)}
    rows = [
        {"frame": frame, "name": name, "value": value}
        for name, each in values.items()
        for frame, value in enumerate(each)
    ]
    assert Pace.of(rows) == Pace({0: 4.0, 1: 4.0, 2: 4.0}, frozenset({2}))


def test_without_a_reference_nothing_is_sure() -> None:
    times = {frame: (10.0, 20.0) for frame in range(FRAMES)}
    steady = Pace(dict.fromkeys(range(FRAMES), 5.0))
    assert sure_change(times, Pace(), steady) is None
    assert sure_change(times, steady, Pace()) is None
    assert sure_change({}, steady, steady) is None
