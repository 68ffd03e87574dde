"""CIEDE2000 against the published test pairs (1e-4), its twin and colour-science (1e-3)."""

import io
import warnings

import numpy as np
import pytest

from shading_atlas_bench.kernels.inputs.pictures import KINDS, damaged, flat, on_device, rendering
from shading_atlas_bench.kernels.metrics.ciede2000 import Ciede2000, ciede2000, ciede2000_twin
from shading_atlas_bench.kernels.metrics.colour import lab_from_srgb

# Sharma, Wu and Dalal 2005, table 1: L, a, b of both colours and their difference.
PAIRS = np.loadtxt(
    io.StringIO("""
50 2.6772 -79.7751 50 0 -82.7485 2.0425
50 3.1571 -77.2803 50 0 -82.7485 2.8615
50 2.8361 -74.0200 50 0 -82.7485 3.4412
50 -1.3802 -84.2814 50 0 -82.7485 1.0000
50 -1.1848 -84.8006 50 0 -82.7485 1.0000
50 -0.9009 -85.5211 50 0 -82.7485 1.0000
50 0 0 50 -1 2 2.3669
50 -1 2 50 0 0 2.3669
50 2.4900 -0.0010 50 -2.4900 0.0009 7.1792
50 2.4900 -0.0010 50 -2.4900 0.0010 7.1792
50 2.4900 -0.0010 50 -2.4900 0.0011 7.2195
50 2.4900 -0.0010 50 -2.4900 0.0012 7.2195
50 -0.0010 2.4900 50 0.0009 -2.4900 4.8045
50 -0.0010 2.4900 50 0.0010 -2.4900 4.8045
50 -0.0010 2.4900 50 0.0011 -2.4900 4.7461
50 2.5000 0 50 0 -2.5000 4.3065
50 2.5 0 73 25 -18 27.1492
50 2.5 0 61 -5 29 22.8977
50 2.5 0 56 -27 -3 31.9030
50 2.5 0 58 24 15 19.4535
50 2.5 0 50 3.1736 0.5854 1.0000
50 2.5 0 50 3.2972 0 1.0000
50 2.5 0 50 1.8634 0.5757 1.0000
50 2.5 0 50 3.2592 0.3350 1.0000
60.2574 -34.0099 36.2677 60.4626 -34.1751 39.4387 1.2644
63.0109 -31.0961 -5.8663 62.8187 -29.7946 -4.0864 1.2630
61.2901 3.7196 -5.3901 61.4292 2.2480 -4.9620 1.8731
35.0831 -44.1164 3.7933 35.0232 -40.0716 1.5901 1.8645
22.7233 20.0904 -46.6940 23.0331 14.9730 -42.5619 2.0373
36.4612 47.8580 18.3852 36.2715 50.5065 21.2231 1.4146
90.8027 -2.0831 1.4410 91.1528 -1.6435 0.0447 1.4441
90.9257 -0.5406 -0.9208 88.6381 -0.8985 -0.7239 1.5381
6.7747 -0.2908 -2.4247 5.8714 -0.0985 -2.2286 0.6377
2.0776 0.0795 -1.1350 0.9033 -0.0636 -0.5514 0.9082
""")
)


def science(a, b):
    """The difference by colour-science."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import colour
    return colour.delta_E(a, b, method="CIE 2000")


@pytest.mark.parametrize("forward", [True, False])
def test_the_published_pairs(device, forward):
    a, b = (PAIRS[:, :3], PAIRS[:, 3:6]) if forward else (PAIRS[:, 3:6], PAIRS[:, :3])
    np.testing.assert_allclose(ciede2000_twin(a, b), PAIRS[:, 6], atol=1e-4)
    np.testing.assert_allclose(ciede2000(device, a, b), PAIRS[:, 6], atol=2e-4)


def test_random_colours_agree_with_the_twin_and_colour_science(device):
    rng = np.random.default_rng(0)
    a = rng.uniform([0, -120, -120], [100, 120, 120], (40_000, 3)).astype(np.float32)
    b = np.where(rng.random((40_000, 1)) < 0.5, a + rng.normal(0, 4, a.shape), a[::-1]).astype(np.float32)
    expected = ciede2000_twin(a.astype(np.float64), b.astype(np.float64))
    np.testing.assert_allclose(expected, science(a.astype(np.float64), b.astype(np.float64)), atol=1e-8)
    np.testing.assert_allclose(ciede2000(device, a, b), expected, atol=1e-3)


def test_greys_and_equal_colours(device):
    grey = np.array([[0, 0, 0], [100, 0, 0], [50, 0, 0], [20, 30, -40.0]])
    other = np.array([[100, 0, 0], [0, 0, 0], [50, 10, 0], [20, 30, -40.0]])
    expected = ciede2000_twin(grey, other)
    np.testing.assert_allclose(ciede2000(device, grey, other), expected, atol=1e-4)
    assert expected[0] == pytest.approx(100, abs=1e-3)
    assert ciede2000(device, grey, other)[3] == 0


@pytest.mark.parametrize("kind", KINDS)
def test_the_mean_over_pictures(device, kind):
    reference = rendering(75, 103)
    test = damaged(reference, kind)
    metric = Ciede2000(device, 103, 75)
    metric.reference(on_device(device, reference))
    metric.compare(on_device(device, test))
    assert metric.mean() == pytest.approx(science(lab_from_srgb(reference), lab_from_srgb(test)).mean(), abs=1e-3)
    metric.compare(on_device(device, reference))
    assert metric.mean() == 0


def test_black_against_white_is_100(device):
    metric = Ciede2000(device, 5, 3)
    metric.reference(on_device(device, flat(3, 5, (0, 0, 0))))
    metric.compare(on_device(device, flat(3, 5, (255, 255, 255))))
    assert metric.mean() == pytest.approx(100, abs=1e-2)
