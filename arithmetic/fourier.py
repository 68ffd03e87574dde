"""A Fourier transform that is the same on every processor, without NumPy's complex products, which may be fused."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from typing import Any, TypeVar

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Array, Doubles, Floats
from shading_atlas_bench.arithmetic.functions import sin_cos

Samples = TypeVar("Samples", Floats, Doubles)
BLOCK = 64  # rows or columns that are transformed together: their samples stay in a processor's cache


def inverse_real(spectrum: Samples) -> Samples:
    """The real picture (N, N) of its half spectrum (2, N, N / 2 + 1), real and imaginary parts, rows first.

    float32 or float64, as the spectrum is. N: a power of two. As `np.fft.irfft2(spectrum[0] + 1j * spectrum[1])`.
    """
    count = spectrum.shape[1]
    columns, out = np.empty_like(spectrum), np.empty((count, count), spectrum.dtype)
    for block in _blocks(spectrum.shape[2]):
        columns[:, :, block] = _inverse(spectrum[:, :, block])
    columns /= count * count
    for block in _blocks(count):
        out[block] = _real_rows(columns[:, block])
    return out


def _blocks(count: int) -> Iterator[slice]:
    return (slice(start, start + BLOCK) for start in range(0, count, BLOCK))


@functools.cache
def _turns(length: int, dtype: np.dtype[np.floating[Any]]) -> tuple[Array, Array]:
    """Sines and cosines (length, 1) of the angles from 0 up to half a turn."""
    sine, cosine = (part.astype(dtype) for part in sin_cos(np.arange(length) * (np.pi / length)))
    return sine[:, None], cosine[:, None]


def _real_rows(rows: Samples) -> Samples:
    """Real samples (R, N) of half spectra (2, R, N / 2 + 1): as complex numbers of an even and an odd sample each."""
    columns = np.ascontiguousarray(rows.transpose(0, 2, 1))
    half = columns.shape[1] - 1
    columns[1, [0, half]] = 0  # of a real row's mean and of its fastest wave
    head, tail = columns[:, :half], columns[:, half:0:-1]
    sine, cosine = _turns(half, rows.dtype)
    real, imaginary = head[0] - tail[0], head[1] + tail[1]
    packed = np.empty_like(head)
    packed[0] = head[0] + tail[0] - (cosine * imaginary + sine * real)
    packed[1] = head[1] - tail[1] + (cosine * real - sine * imaginary)
    pairs = _inverse(packed)
    return pairs.transpose(2, 1, 0).reshape(-1, 2 * half)


def _inverse(z: Samples) -> Samples:
    """Sums of z[k] e^(2 pi i k n / N) over the middle axis of (2, N, M), by Stockham's way, which reorders nothing."""
    shape = z.shape
    length = shape[1]
    while length > 1:
        length //= 2
        z = z.reshape(2, 2, length, -1)
        sine, cosine = _turns(length, z.dtype)
        out = np.empty((2, length, 2, z.shape[-1]), z.dtype)
        np.add(z[:, 0], z[:, 1], out=out[:, :, 0])
        real, imaginary = z[:, 0] - z[:, 1]
        np.subtract(real * cosine, imaginary * sine, out=out[0, :, 1])
        np.add(imaginary * cosine, real * sine, out=out[1, :, 1])
        z = out
    return z.reshape(shape)
