"""Elementary functions against extended precision, at their edges, and one by one against many at once."""

from typing import Any

import numpy as np
import pytest

from shading_atlas_bench.arithmetic import functions

MOST = np.finfo(np.longdouble).nmant  # 52 where there is nothing more precise than float64
SLACK = 0.0 if MOST > 52 else 1.0  # what the reference itself may then be off

LARGE = np.concatenate([np.linspace(-1e6, 1e6, 20_001), 1 / np.linspace(-1, 1, 4_000)])
MULTIPLES = np.arange(-4000, 4000) * (np.pi / 2)
ANGLES = np.concatenate([np.linspace(-10, 10, 20_001), LARGE, MULTIPLES, 10.0 ** np.arange(-20.0, 6.0, 0.01)])
POSITIVE = np.concatenate([2.0 ** np.arange(-1000, 1000, 0.25), np.linspace(0.5, 2, 20_001)])
SHARES = np.linspace(-1, 1, 20_001)
CASES: dict[str, tuple[float, *tuple[np.ndarray, ...]]] = {
    "sin": (1, ANGLES),
    "cos": (1, ANGLES),
    "tan": (3, ANGLES),
    "arctan": (1, ANGLES),
    "arcsin": (2, SHARES),
    "exp": (1, np.linspace(-700, 700, 40_001)),
    "log": (1, POSITIVE),
    "log2": (2, POSITIVE),
    "arctan2": (2, ANGLES, ANGLES[::-1]),
    "hypot": (2, ANGLES, ANGLES[::-1]),
    "power": (1, 10.0 ** np.linspace(-6, 6, 20_001), np.linspace(-2.3, 2.3, 20_001)),
}


def off(found: np.ndarray, true: np.ndarray) -> float:
    """The largest error in units of the last place."""
    last_place = np.spacing(np.abs(true.astype(np.float64))).astype(np.longdouble)
    return float(np.max(np.abs(found.astype(np.longdouble) - true) / last_place))


@pytest.mark.parametrize("name", CASES)
def test_errors_are_within_their_bounds(name):
    bound, *arguments = CASES[name]
    true = getattr(np, name)(*(argument.astype(np.longdouble) for argument in arguments))
    assert off(getattr(functions, name)(*arguments), true) <= bound + SLACK


@pytest.mark.parametrize("name", CASES)
def test_edges_are_as_in_numpy(name):
    edges = np.array([0.0, -0.0, 1.0, -1.0, np.inf, -np.inf, np.nan, 5e-324, 1e308])
    if name in ("sin", "cos", "tan"):
        edges = edges[:-1]  # of more than 1e6 radians the multiples of a rounded pi are taken off
    arguments = [edges] if len(CASES[name]) == 2 else [side.ravel() for side in np.meshgrid(edges, edges)]
    if name == "power":
        arguments = [np.abs(arguments[0]), np.nan_to_num(arguments[1], nan=np.nan, posinf=1e308, neginf=-1e308)]
    if name == "hypot":  # squares overflow and underflow: no length here comes near
        fit = np.all([(np.abs(side) > 1e-150) & (np.abs(side) < 1e150) | (side == 0) for side in arguments], axis=0)
        arguments = [side[fit] for side in arguments]
    with np.errstate(all="ignore"):
        expected = getattr(np, name)(*arguments)
    found = getattr(functions, name)(*arguments)
    np.testing.assert_allclose(found, expected, rtol=1e-15, atol=0)
    whole = expected == 0
    np.testing.assert_array_equal(np.signbit(found[whole]), np.signbit(expected[whole]))


def test_numbers_one_by_one_are_those_of_arrays():
    sine, cosine = functions.sin_cos(ANGLES)
    for few in (ANGLES[:20], ANGLES[-20:], np.array([-0.0, 0.0, np.nan, np.inf, 1e9, -3e7])):
        many = np.concatenate([few, ANGLES])
        for one, all_ in zip(functions.sin_cos(few), functions.sin_cos(many), strict=True):
            np.testing.assert_array_equal(one, all_[: len(few)])
            numbers = np.isfinite(one)
            assert np.signbit(one[numbers]).tolist() == np.signbit(all_[: len(few)][numbers]).tolist()
    assert functions.sin_cos(float(ANGLES[7])) == (sine[7], cosine[7])


def test_types_and_shapes_are_those_of_the_arguments():
    single = np.linspace(0.1, 1, 60, dtype=np.float32).reshape(3, 4, 5)
    doubles: Any = np.ones(5)  # the annotations have no mixture of types, and no lists
    numbers: Any = [0, 1]
    assert functions.sin(single).dtype == functions.power(single, 2.4).dtype == np.float32
    assert functions.exp(single.astype(np.float64)).dtype == functions.hypot(single, doubles).dtype == np.float64
    assert functions.hypot(single[:, :1], single[0]).shape == (3, 4, 5)
    np.testing.assert_array_equal(functions.sin(single), functions.sin(single.astype(np.float64)).astype(np.float32))
    for number in (functions.sin(0.5), functions.log(2), functions.arctan2(1, 2)):
        assert isinstance(number, np.float64)
    assert functions.log(np.zeros((0, 3))).shape == (0, 3)
    assert functions.cos(numbers).shape == (2,)


def test_powers_of_two_are_exact():
    steps = np.arange(-1074, 1024)
    np.testing.assert_array_equal(functions.log2(np.ldexp(1.0, steps)), steps)


def test_angles_beyond_a_million_stay_on_the_circle():
    sine, cosine = functions.sin_cos(np.array([1e7, -3e12, 1e300]))
    np.testing.assert_allclose(sine * sine + cosine * cosine, 1, rtol=1e-15)
    assert sine[0] == pytest.approx(np.sin(1e7), abs=1e-8)
