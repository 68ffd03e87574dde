"""Smooth lines against SciPy's."""

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import gaussian_filter1d

from shading_atlas_bench.scenes.lines import curve, smoothed


@pytest.mark.parametrize("count", [2, 3, 9, 40])
def test_curves_are_those_of_scipy(count):
    rng = np.random.default_rng(count)
    at, points = np.cumsum(rng.uniform(0.1, 2, count)), rng.normal(size=(count, 3))
    points[count // 2] = points[count // 2 - 1]
    where = np.linspace(at[0], at[-1], 200)
    np.testing.assert_allclose(curve(at, points, where), PchipInterpolator(at, points)(where), atol=1e-14)


@pytest.mark.parametrize(("count", "deviation"), [(300, 9.0), (300, 1.5), (5, 8.0)])
def test_smoothing_is_that_of_scipy(count, deviation):
    values = np.random.default_rng(0).normal(size=(count, 2))
    expected = gaussian_filter1d(values, deviation, axis=0, mode="nearest")
    np.testing.assert_allclose(smoothed(values, deviation), expected, atol=1e-14)
    np.testing.assert_array_equal(smoothed(values[:, 0], deviation), smoothed(values, deviation)[:, 0])
