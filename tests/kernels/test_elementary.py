"""Elementary functions: within their bounds, and the same bits on every runtime; kernels use no other ones."""

import hashlib
import re

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from shading_atlas_bench.kernels.device import kernel_files, stage_name
from shading_atlas_bench.kernels.doctor.elementary import ANGLE_ULP, EXP2_ULP, LOG2_ULP, elementary, elementary_twin

# Runtimes differ in the last places of these. Metrics may use them: their values are bounded, not equal.
NOT_DEFINED = (
    r"a?(cos|sin|tan)(h|pi)?|sincos|atan2(pi)?|exp(2|10|m1)?|log(2|10|1p)?|pow[nr]?|rootn|cbrt|rsqrt|hypot|"
    r"(fast_)?(length|distance|normalize)|dot|cross|mix|smoothstep|fma|mad|fmod|remainder|erfc?|[lt]gamma|"
    r"(native|half)_\w+"
)
# SHA-256 of what `elementary` gives for the inputs of `test_the_bits_are_the_same_everywhere`.
GOLDEN = "9879911f7084898dc4f43ae3499dc1411cb57d9e4aebf3dbc836beced2e8a1f5"


def ulps(found: np.ndarray, expected: np.ndarray, least: float = 0.0) -> float:
    """The largest distance in units of the last place of float32, of values of at least `least`."""
    place = np.spacing(np.maximum(np.abs(expected), least).astype(np.float32)).astype(np.float64)
    return float((np.abs(found - expected) / place).max())


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**31), scale=st.sampled_from([1e-3, 1.0, 30.0, 126.0]))
def test_against_the_twin(device, seed, scale):
    rng = np.random.default_rng(seed)
    x = rng.uniform(-scale, scale, 4096).astype(np.float32)
    y = (np.exp2(rng.uniform(-scale, scale, 4096)) * rng.choice([-1, 1], 4096)).astype(np.float32)
    x[:4], y[:8] = [0.0, -0.0, 1.0, -126.0], [1.0, -1.0, 2.0, 0.5, np.sqrt(0.5), np.sqrt(2), 1.0000001, 0.99999994]
    (log2_y, exp2_x, angle), expected = elementary(device, x, y), elementary_twin(x, y)
    assert ulps(log2_y, expected[0], 2.0**-10) <= LOG2_ULP
    assert ulps(exp2_x, expected[1]) <= EXP2_ULP
    assert ulps(angle, expected[2], np.pi) <= ANGLE_ULP


def test_corners(device):
    x = np.array([0, 1, -1, 0, 0, 3, -3, 0], np.float32)
    y = np.array([1, 1e-30, 1e-30, -1, 2, 3, 3, 4], np.float32)
    assert np.allclose(elementary(device, x, y)[2], np.arctan2(y, x), atol=1e-6)
    assert np.array_equal(elementary(device, x, y)[0][[0, 4, 7]], [0, 1, 2])
    below = elementary(device, np.full(8, -1e9, np.float32), y)[1]
    assert np.array_equal(below, np.full(8, 2.0**-126, np.float32))


def test_the_bits_are_the_same_everywhere(device):
    bits = np.arange(1 << 18, dtype=np.uint32) * np.uint32(0x9E3779B1)
    y = (np.uint32(0x20000000) + (bits >> np.uint32(2))).view(np.float32)  # 2^-63 .. 2^65
    x = (bits >> np.uint32(9)).astype(np.float32) * np.float32(2.0**-17) - np.float32(32)
    digest = hashlib.sha256(b"".join(values.tobytes() for values in elementary(device, x, y))).hexdigest()
    assert digest == GOLDEN


def test_kernels_use_no_function_whose_bits_depend_on_the_runtime():
    call = re.compile(rf"\b(?:{NOT_DEFINED})\s*\(")
    found = []
    for file in kernel_files():
        if file.parent.name in ("metrics", "roofline"):
            continue
        for number, line in enumerate(file.read_text(encoding="utf-8").splitlines(), 1):
            code = line.split("//")[0]
            found += [f"{stage_name(file)}:{number} {match[0]}" for match in call.finditer(code)]
    assert found == [], "Use kernels/common/elementary.cl."
