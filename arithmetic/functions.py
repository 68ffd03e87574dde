"""Elementary functions of float64 and float32 arrays, the same to the last bit on every processor.

Each takes numbers or arrays that broadcast and computes in float64; the result is float32 where all arrays are, else
float64, and a number for numbers. Errors, in units of the last place of a float64 result: sin and cos (of up to 1e6
radians), exp, log, arctan 1; power 1 while its logarithm is below 32 either way; arctan2, arcsin, log2, hypot 2; tan 3.

The polynomials and reductions are those of fdlibm: Copyright (C) 1993 by Sun Microsystems, Inc. Permission to use,
copy, modify, and distribute this software is freely granted, provided that this notice is preserved.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Array, Doubles, Floats

Numbers = TypeVar("Numbers", float, Doubles, Floats)  # what a function takes is what it gives

BLOCK = 8192  # elements: the intermediate arrays of a block stay in a processor's nearest cache
FEW = 24  # numbers that are computed one by one
LARGEST_ANGLE = 1e6  # radians; up to there multiples of pi / 2 are taken off exactly, beyond it those of 2 * np.pi

# pi / 2 as two parts of 33 bits and the rest: multiples of the parts up to 2 ** 20 are exact.
HALF_PI_PARTS = (1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21)
PI_REST = 1.2246467991473531772e-16  # what pi is above np.pi
# log 2 as one part of 32 bits and the rest.
LOG2_HIGH, LOG2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
PER_LOG2 = 1.44269504088896338700  # 1 / log 2
ROOT_HALF = 0.7071067811865476

SINE = (
    -1.66666666666666324348e-01,
    8.33333333332248946124e-03,
    -1.98412698298579493134e-04,
    2.75573137070700676789e-06,
    -2.50507602534068634195e-08,
    1.58969099521155010221e-10,
)
COSINE = (
    4.16666666666666019037e-02,
    -1.38888888888741095749e-03,
    2.48015872894767294178e-05,
    -2.75573143513906633035e-07,
    2.08757232129817482790e-09,
    -1.13596475577881948265e-11,
)
EXPONENTIAL = (
    1.66666666666666019037e-01,
    -2.77777777770155933842e-03,
    6.61375632143793436117e-05,
    -1.65339022054652515390e-06,
    4.13813679705723846039e-08,
)
LOGARITHM = (
    6.666666666666735130e-01,
    3.999999999940941908e-01,
    2.857142874366239149e-01,
    2.222219843214978396e-01,
    1.818357216161805012e-01,
    1.531383769920937332e-01,
    1.479819860511658591e-01,
)
ARCTANGENT = (
    3.33333333333329318027e-01,
    -1.99999999998764832476e-01,
    1.42857142725034663711e-01,
    -1.11111104054623557880e-01,
    9.09088713343650656196e-02,
    -7.69187620504482999495e-02,
    6.66107313738753120669e-02,
    -5.83357013379057348645e-02,
    4.97687799461593236017e-02,
    -3.65315727442169155270e-02,
    1.62858201153657823623e-02,
)
# arctan x = arctan c + arctan((x - c) / (1 + c x)) for c = 0, 1/2, 1, 3/2, infinity, from these x on: the fraction as
# (p x - q) / (r + s x), and arctan c in two parts.
ARCTANGENT_FROM = np.array([0.4375, 0.6875, 1.1875, 2.4375])
ARCTANGENT_FRACTION = np.array([[1, 0, 1, 0], [2, 1, 2, 1], [1, 1, 1, 1], [1, 1.5, 1, 1.5], [0, 1, 0, 1]], np.float64)
ARCTANGENT_HIGH = np.array([0.0, 4.63647609000806093515e-01, np.pi / 4, 9.82793723247329054082e-01, np.pi / 2])
ARCTANGENT_LOW = np.array(
    [
        0.0,
        2.26987774529616870924e-17,
        3.06161699786838301793e-17,
        1.39033110312309984516e-17,
        6.12323399573676603587e-17,
    ]
)


def _elementwise(
    compute: Callable[..., Doubles | tuple[Doubles, Doubles]], *arguments: Numbers | float, results: int = 1
) -> tuple[Numbers, ...]:
    """What `compute` makes of the arguments, as float64 (N) in blocks: `results` arrays of their common shape."""
    given = [argument if isinstance(argument, int | float) else np.asarray(argument) for argument in arguments]
    single = np.result_type(*given) == np.float32
    arrays = [np.asarray(argument, np.float64) for argument in given]
    if len(arrays) > 1:
        arrays = list(np.broadcast_arrays(*arrays))
    shape = arrays[0].shape
    flat = [array.reshape(-1) for array in arrays]
    out = np.empty((results, len(flat[0])), np.float32 if single else np.float64)
    with np.errstate(all="ignore"):
        for start in range(0, out.shape[1], BLOCK):
            block = slice(start, start + BLOCK)
            out[:, block] = compute(*(array[block] for array in flat))
    return tuple(_number_or_array(row.reshape(shape)) for row in out)


def _number_or_array(values: Array) -> Any:
    """A number where there are no axes."""
    return values[()]


def _series(z: Numbers, coefficients: tuple[float, ...]) -> Numbers:
    """The polynomial in z by Horner's rule, lowest coefficient first."""
    total = coefficients[-1] * z
    for coefficient in coefficients[-2:0:-1]:
        total += coefficient
        total *= z
    total += coefficients[0]
    return total


def sin_cos(angle: Numbers) -> tuple[Numbers, Numbers]:
    """Sine and cosine of angles in radians."""
    if np.size(angle) > FEW:
        sine, cosine = _elementwise(_sin_cos, angle, results=2)
        return sine, cosine
    angles = np.asarray(angle)
    found = [_sin_cos_of_number(x) for x in angles.reshape(-1).tolist()]
    out = np.array(found, np.float32 if angles.dtype == np.float32 else np.float64).reshape(*angles.shape, 2)
    return _number_or_array(out[..., 0]), _number_or_array(out[..., 1])


def sin(angle: Numbers) -> Numbers:
    """Sine of angles in radians."""
    return sin_cos(angle)[0]


def cos(angle: Numbers) -> Numbers:
    """Cosine of angles in radians."""
    return sin_cos(angle)[1]


def tan(angle: Numbers) -> Numbers:
    """Tangent of angles in radians."""
    return _elementwise(lambda x: np.divide(*_sin_cos(x)), angle)[0]


def _sin_cos(x: Doubles) -> tuple[Doubles, Doubles]:
    if not (np.abs(x) <= LARGEST_ANGLE).all():
        x = np.where(np.abs(x) > LARGEST_ANGLE, np.fmod(x, 2 * np.pi), x)
    quarters = np.rint(x * (2 / np.pi)) + 0.0
    sine, cosine = _in_quarter(x, quarters)
    turn = quarters.astype(np.int64)
    odd = (turn & 1).astype(bool)
    return np.where(odd, cosine, sine) * (1 - (turn & 2)), np.where(odd, sine, cosine) * (1 - (turn + 1 & 2))


def _sin_cos_of_number(x: float) -> tuple[float, float]:
    """The same, without NumPy, which takes thirty times as long to be called as this to compute."""
    if not math.isfinite(x):
        return math.nan, math.nan
    if abs(x) > LARGEST_ANGLE:
        x = math.fmod(x, 2 * math.pi)
    turn = round(x * (2 / math.pi))
    sine, cosine = _in_quarter(x, float(turn))
    if turn & 1:
        sine, cosine = cosine, sine
    return sine * (1 - (turn & 2)), cosine * (1 - (turn + 1 & 2))


def _in_quarter(x: Numbers, quarters: Numbers) -> tuple[Numbers, Numbers]:
    """Sine and cosine of x less that many quarter turns: numbers or arrays."""
    first, second, rest = HALF_PI_PARTS
    before = x - quarters * first
    after = before - quarters * second
    tail = quarters * rest - ((before - after) - quarters * second)
    y = after - tail
    low = (after - y) - tail
    z = y * y
    cube = z * y
    sine = y - ((z * (0.5 * low - cube * _series(z, SINE[1:])) - low) - cube * SINE[0])
    half = 0.5 * z
    most = 1 - half
    return sine, most + (((1 - most) - half) + (z * (z * _series(z, COSINE)) - y * low))


def arctan(x: Numbers) -> Numbers:
    """Angle in radians, -pi / 2 .. pi / 2, whose tangent is x."""
    return _elementwise(lambda x: np.copysign(_arctan(np.abs(x)), x), x)[0]


def arctan2(y: Numbers | float, x: Numbers | float) -> Numbers:
    """Angle in radians, -pi .. pi, of the point (x, y) as seen from the origin; signed zeros count as in C."""
    return _elementwise(_arctan2, y, x)[0]


def arcsin(x: Numbers) -> Numbers:
    """Angle in radians, -pi / 2 .. pi / 2, whose sine is x; NaN beyond +-1."""
    return _elementwise(lambda x: _arctan2(x, np.sqrt((1 - x) * (1 + x))), x)[0]


def _arctan2(y: Doubles, x: Doubles) -> Doubles:
    ratio = np.abs(y) / np.abs(x)
    ratio = np.where((y == 0) & (x == 0), 0.0, np.where(np.isinf(x) & np.isinf(y), 1.0, ratio))
    angle = _arctan(ratio)
    signed: Doubles = np.copysign(np.where(np.signbit(x) & (ratio < np.inf), np.pi - (angle - PI_REST), angle), y)
    return signed


def _arctan(x: Doubles) -> Doubles:
    """Of x >= 0."""
    x = np.minimum(x, 1e300)
    part = np.searchsorted(ARCTANGENT_FROM, x, side="right")
    p, q, r, s = ARCTANGENT_FRACTION[part].T
    t = (p * x - q) / (r + s * x)
    z = t * t
    angle: Doubles = ARCTANGENT_HIGH[part] - ((t * (z * _series(z, ARCTANGENT)) - ARCTANGENT_LOW[part]) - t)
    return angle


def exp(x: Numbers) -> Numbers:
    """e to the power of x."""
    return _elementwise(lambda x: _exp(x, 0.0), x)[0]


def _exp(x: Doubles, rest: Doubles | float) -> Doubles:
    """e to the power of x + rest, where the rest is below the last place of x."""
    x = np.clip(x, -800, 800)
    power_of_two = np.rint(x * PER_LOG2)
    high = x - power_of_two * LOG2_HIGH
    low = power_of_two * LOG2_LOW - rest
    y = high - low
    z = y * y
    c = y - z * _series(z, EXPONENTIAL)
    result = 1 - ((low - (y * c) / (2 - c)) - high)
    return np.ldexp(result, power_of_two.astype(np.int32))


def log(x: Numbers) -> Numbers:
    """Natural logarithm: -inf of 0, NaN of less."""
    return _elementwise(_log, x)[0]


def log2(x: Numbers) -> Numbers:
    """Logarithm to base 2, exact for powers of two: -inf of 0, NaN of less."""
    return _elementwise(_log2, x)[0]


def _log(x: Doubles) -> Doubles:
    f, exponent = _split(x)
    half = 0.5 * f * f
    s = f / (2 + f)
    rest = s * (half + _log_series(s)) + exponent * LOG2_LOW
    return _log_range(x, exponent * LOG2_HIGH - ((half - rest) - f))


def _log2(x: Doubles) -> Doubles:
    f, exponent = _split(x)
    half = 0.5 * f * f
    s = f / (2 + f)
    return _log_range(x, exponent + (f - (half - s * (half + _log_series(s)))) * PER_LOG2)


def _split(x: Doubles) -> tuple[Doubles, Doubles]:
    """f in sqrt(1/2) - 1 .. sqrt(2) - 1 and an exponent with x = (1 + f) * 2 ** exponent."""
    mantissa, exponent = np.frexp(x)
    low = mantissa < ROOT_HALF
    return np.where(low, 2 * mantissa, mantissa) - 1, (exponent - low).astype(np.float64)


def _log_series(s: Doubles) -> Doubles:
    """(log(1 + f) - 2 s) / s for s = f / (2 + f)."""
    z = s * s
    return z * _series(z, LOGARITHM)


def _log_range(x: Doubles, value: Doubles) -> Doubles:
    """The logarithm where x is a positive number, and what it is elsewhere."""
    return np.where((x > 0) & (x < np.inf), value, np.where(x == 0, -np.inf, np.where(x > 0, x, np.nan)))


def power(base: Numbers | float, exponent: Numbers | float) -> Numbers:
    """base ** exponent for bases from 0; NaN for negative ones."""
    return _elementwise(_power, base, exponent)[0]


def _power(base: Doubles, exponent: Doubles) -> Doubles:
    exponent = np.clip(exponent, -1e20, 1e20)  # of any base but 1 the result is then 0 or infinite
    high, low = _long_log(base)
    product, error = _long_product(exponent, high)
    rest = error + exponent * low
    result = _exp(product, np.where(np.abs(product) < 800, rest, 0.0))
    falling = (base < 1) == (exponent > 0)
    outermost = np.where(falling, 0.0, np.inf)  # of 0 and of infinity
    result = np.where((base == 0) | (base == np.inf), outermost, np.where(base > 0, result, np.nan))
    result = np.where(np.isnan(exponent), np.nan, result)
    return np.where((exponent == 0) | (base == 1), 1.0, result)


def _long_log(x: Doubles) -> tuple[Doubles, Doubles]:
    """log x as the sum of two numbers, good to about 58 bits."""
    f, exponent = _split(x)
    divisor = 2 + f
    s = f / divisor
    product, error = _long_product(s, divisor)
    s_low = (((f - product) - error) - s * (f - (divisor - 2))) / divisor
    whole, twice = exponent * LOG2_HIGH, 2 * s
    total = whole + twice
    part = total - whole
    low = (whole - (total - part)) + (twice - part) + ((2 * s_low + s * _log_series(s)) + exponent * LOG2_LOW)
    high = total + low
    return high, low - (high - total)


def _long_product(a: Doubles, b: Doubles) -> tuple[Doubles, Doubles]:
    """a * b and its rounding error, by Dekker's halves of 26 bits."""
    product = a * b
    (a_high, a_low), (b_high, b_low) = _halves(a), _halves(b)
    return product, ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low


def _halves(a: Doubles) -> tuple[Doubles, Doubles]:
    scaled = 134217729.0 * a  # 2 ** 27 + 1
    high = scaled - (scaled - a)
    return high, a - high


def hypot(x: Numbers | float, y: Numbers | float) -> Numbers:
    """Length of (x, y)."""
    return _elementwise(lambda x, y: np.sqrt(x * x + y * y), x, y)[0]
