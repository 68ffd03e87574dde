"""Kernels read no memory that nothing wrote, or let nothing depend on it: fresh memory is full of one byte, then of
another, and results are the same."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from shading_atlas_bench.harness.cases import find_cases
from shading_atlas_bench.kernels.case import INPUTS
from shading_atlas_bench.kernels.device import Device
from tests.portability.small import small_trial


class Filled(Device):
    """A device whose fresh memory is full of `byte`."""

    byte = 0

    def empty(self, shape: int | tuple[int, ...], dtype: Any) -> Any:
        return self._full(super().empty(shape, dtype))

    def recycled(self, shape: int | tuple[int, ...], dtype: Any) -> Any:
        return self._full(super().recycled(shape, dtype))

    def _full(self, array: Any) -> Any:
        array.set(np.full(array.nbytes, self.byte, np.uint8).view(array.dtype).reshape(array.shape))
        return array


@pytest.fixture(scope="module")
def filled() -> Filled:
    device = Filled.open()
    assert isinstance(device, Filled)
    return device


def results_with(filled: Filled, byte: int, case, kind: str) -> list[np.ndarray]:
    """What a case finds where fresh memory is full of a byte."""
    filled.byte = byte
    return [np.asarray(result.found) for result in small_trial(case, filled, kind).results()]


@pytest.mark.parametrize("case", find_cases(), ids=lambda case: case.name)
def test_results_do_not_depend_on_what_was_in_memory(filled, case):
    for kind in INPUTS:
        zeros, others = results_with(filled, 0, case, kind), results_with(filled, 0xFF, case, kind)
        assert len(zeros) == len(others) > 0
        for first, second in zip(zeros, others, strict=True):
            np.testing.assert_array_equal(first, second)


def test_a_dependence_shows(filled):
    case = next(case for case in find_cases() if case.name == "roofline/copying")
    found = []
    for filled.byte in (0, 0xFF):
        (result,) = case.make(filled, INPUTS[0], 61).results()  # it copies 48
        found.append(result.found)
    np.testing.assert_array_equal(found[0][:48], found[1][:48])
    assert (found[0][48:] == 0).all()
    assert np.isnan(found[1][48:]).all()
