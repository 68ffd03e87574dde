"""Every kernel is measured by a case, and every case does what its formulas and its twin say."""

import numpy as np
import pytest

from shading_atlas_bench.harness.cases import find_cases
from shading_atlas_bench.kernels.case import INPUTS, evaluate
from shading_atlas_bench.kernels.device import Device, kernel_names
from shading_atlas_bench.kernels.runtime.opencl import DeviceError

CASES = {case.name: case for case in find_cases()}


def test_every_kernel_is_measured_once():
    measured = [kernel for case in CASES.values() for kernel in case.costs]
    assert sorted(measured) == sorted(kernel_names())


def test_names_are_not_shared():
    assert len(CASES) == len(find_cases())


@pytest.mark.parametrize("kind", INPUTS)
@pytest.mark.parametrize(
    "name", ["common/scan", "doctor/polynomial", "sas/corners", "shade/faces", "snakebinning/counting"]
)
def test_a_case_launches_its_kernels_and_agrees_with_its_twin(device, name, kind):
    """Whole numbers equal; others finite where the twin's are and close to them."""
    case = CASES[name]
    trial = case.make(device, kind, min(case.checked, 512))
    with device.record() as record:
        trial.run()  # the first leaves something that later ones forget
        results = trial.results()
    assert set(case.costs) <= set(record.kernels)
    for cost in case.costs.values():
        assert evaluate(cost.items, trial.counts) > 0
        assert evaluate(cost.bytes, trial.counts) > 0
    for result in results:
        assert result.found.shape == result.expected.shape
        if result.found.dtype.kind in "iu":
            np.testing.assert_array_equal(result.found, result.expected)
        else:
            np.testing.assert_allclose(result.found, result.expected, rtol=0.1, atol=1e-3)


def test_inputs_are_the_same_every_time(device):
    case = CASES["common/scan"]
    first, second = (case.make(device, "typical", 100).results()[0].expected for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_an_unknown_variant_lists_the_known_ones():
    with pytest.raises(DeviceError, match="default, contracted, relaxed"):
        Device.open(variant="sloppy")
