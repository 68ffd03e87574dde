"""The exclusive prefix sum against its twin; integers, so the error bound is 0."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shading_atlas_bench.kernels.common.scan import exclusive_scan, exclusive_scan_twin


@settings(max_examples=20, deadline=None)
@given(count=st.integers(0, 3000), chunks=st.integers(1, 200), seed=st.integers(0, 1000))
def test_matches_its_twin_for_every_chunk_count(device, count, chunks, seed):
    values = np.random.default_rng(seed).integers(-5, 100, count).astype(np.int32)
    before, device.chunks = device.chunks, chunks
    try:
        offsets, total = exclusive_scan(device, device.upload(values), count)
    finally:
        device.chunks = before
    expected, expected_total = exclusive_scan_twin(values)
    assert total == expected_total
    np.testing.assert_array_equal(offsets.get()[:count], expected)


def test_uses_only_the_first_count_values(device):
    values = device.upload(np.arange(100, dtype=np.int32))
    offsets, total = exclusive_scan(device, values, 10)
    assert total == 45
    assert offsets.shape == (10,)


def test_sums_beyond_32_bits_are_refused(device):
    with pytest.raises(ValueError, match="beyond 32 bits"):
        exclusive_scan(device, device.upload(np.full(3, 2**30, np.int32)), 3)
