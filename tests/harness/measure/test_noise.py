"""The machine's noise: equal timings are calm, uneven ones and a loaded machine are said so, with the numbers."""

from __future__ import annotations

import itertools
import os
import time

import pytest

from shading_atlas_bench.harness.measure import noise
from shading_atlas_bench.harness.measure.noise import noise_warnings


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch):
    """Sets the machine's load, and how long the work takes, in turn."""

    def be(load: float, *seconds: float) -> list[str]:
        clock = itertools.accumulate(itertools.chain.from_iterable((0.0, each) for each in itertools.cycle(seconds)))
        monkeypatch.setattr(noise, "load", lambda: load)
        monkeypatch.setattr(os, "cpu_count", lambda: 4)
        monkeypatch.setattr(time, "perf_counter", lambda: next(clock))
        return noise_warnings()

    return be


def test_equal_work_in_equal_time_on_an_idle_machine_is_calm(machine) -> None:
    assert machine(0.0, 0.004) == []
    assert machine(1.9, 0.004, 0.0041) == []


def test_a_loaded_machine_is_said_to_be_busy(machine) -> None:
    (warning,) = machine(2.5, 0.004)
    assert "load 2.5 on 4 cores" in warning


def test_equal_work_in_unequal_time_is_said_to_be_noisy(machine) -> None:
    (warning,) = machine(0.0, 0.004, 0.006)
    assert "varied by 50 %" in warning, "from 4 to 6 ms, over the median of 4"
