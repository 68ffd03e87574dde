"""Information content weighted SSIM on luma, 5 scales (Wang and Li 2011).

Bands of a Laplacian pyramid (5-tap binomial of sum sqrt 2), SSIM's contrast-structure term on each, weighted by the
information of 3x3 neighbours (and, on the three finest bands, the coarser band at the same place); the coarsest plane
enters with plain SSIM. The score is the product of the scales' means to the powers of `WEIGHTS`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Bytes, Doubles, Ints
from shading_atlas_bench.arithmetic.functions import power
from shading_atlas_bench.arithmetic.matrices import eigenvectors
from shading_atlas_bench.kernels.constants import constants_of
from shading_atlas_bench.kernels.metrics.colour import luma
from shading_atlas_bench.kernels.metrics.planes import Layout, padded_taps
from shading_atlas_bench.kernels.metrics.ssim import C1, C2, ORIGIN, RADIUS, similarity_twin, window

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device

WEIGHTS = np.array([0.0448, 0.2856, 0.3001, 0.2363, 0.1333])
SCALES = len(WEIGHTS)
WITH_PARENT = 3  # bands whose neighbourhood includes the coarser band
SMALLEST_SIDE = 2 * RADIUS * 2 ** (SCALES - 1) + 1
DEFINED = constants_of(Path(__file__).with_name("iwssim.cl"))
NOISE = DEFINED.number("NOISE")
LEAST_VARIANCE = 1e-6  # of a neighbourhood, squared luma steps; smaller ones are rounding
LEAST_EIGENVALUE = 1e-6  # of the largest; the covariance of flat pictures is singular


def enlarged_positions(count: int, parent: int) -> tuple[Ints, Doubles]:
    """Where the pixels 0..count-1 of a band lie in the coarser band of `parent` pixels, as the authors' program has it.

    It enlarges to 4 parent - 3 pixels and takes every second one. Returns pixels, int32 (count), and the weights of the
    next ones, float64 (count).
    """
    at = (2 * np.arange(count) - 0.5) * parent / (4 * parent - 3) - 0.5
    at = np.clip(at, 0, parent - 1)
    first = np.minimum(at.astype(np.int32), parent - 2)
    return first, at - first


def decorrelation(covariance: Doubles) -> tuple[Doubles, Doubles]:
    """Eigenvalues (n) and the matrix (n, n) that makes neighbourhoods of this covariance (n, n) white, float64.

    Negative eigenvalues become 0 with the trace kept; directions without variance are left out of the whitening.
    """
    values, vectors = eigenvectors(covariance)
    positive = np.where(values > LEAST_EIGENVALUE * max(values[-1], 0), values, 0)
    if not positive.any():
        return positive, np.zeros_like(covariance)
    positive *= values.sum() / positive.sum()
    inverse = np.where(positive > 0, 1 / np.sqrt(np.where(positive > 0, positive, 1)), 0)
    return positive, inverse[:, None] * vectors.T


@dataclass
class _Band:
    """One scale of the reference on the device, and room for the test's."""

    layout: Layout
    plane: Array
    test: Array
    rows: Array
    moments: Array
    energy: Array
    partial: Array
    neighbours: int
    eigenvalues: Array | None = None


class IwSsim:
    """IW-SSIM of pictures of one size against a reference.

    Pictures are uint8 (h, w, 4) device arrays, sRGB. Raises ValueError if a side is below 161 pixels.
    """

    def __init__(self, device: Device, width: int, height: int) -> None:
        if min(width, height) < SMALLEST_SIDE:
            raise ValueError(f"IW-SSIM needs {SMALLEST_SIDE} pixels a side, and the picture has {width}x{height}.")
        self.device, self.kernels = device, device.build("metrics/iwssim.cl")
        self.taps = device.upload(padded_taps(window()))
        self.layouts = [Layout(-(-width // 2**k), -(-height // 2**k)) for k in range(SCALES)]
        self.levels = [layout.empty(device) for layout in self.layouts]
        self.bands = [self._band(k) for k in range(SCALES - 1)]
        self.coarsest_reference = self.layouts[-1].empty(device)
        at = self.layouts[-1]
        self.coarsest_ssim = device.empty((at.height - 2 * RADIUS, at.width - 2 * RADIUS), np.float32)

    def _band(self, k: int) -> _Band:
        layout, device = self.layouts[k], self.device
        inner = layout.row_items(layout.height - 2 * RADIUS)
        return _Band(
            layout,
            plane=layout.empty(device),
            test=layout.empty(device),
            rows=layout.empty(device, 3),
            moments=layout.empty(device, 2),
            energy=layout.empty(device),
            partial=device.empty((inner, 2), np.float32),
            neighbours=9 + (k < WITH_PARENT),
        )

    def _margins(self, k: int, skip: int) -> None:
        at = self.layouts[k]
        kernel = self.kernels.reflect_margins
        size = (at.width, at.height, at.stride)
        self.device.launch("metrics/iwssim/pyramid", kernel, at.height, *size, skip, self.levels[k])

    def _pyramid(self, image: Array, bands: list[Array]) -> None:
        """Fill `levels` with the low-pass pyramid of a picture and `bands` with its Laplacian bands."""
        first, launch, stage = self.layouts[0], self.device.launch, "metrics/iwssim/pyramid"
        luma_kernel = self.kernels.centred_luma
        launch(stage, luma_kernel, first.items, first.width, first.height, first.stride, image, self.levels[0])
        for k in range(SCALES - 1):
            fine, coarse = self.layouts[k], self.layouts[k + 1]
            self._margins(k, 1)
            reduced = (fine.height, fine.stride, coarse.width, coarse.height, coarse.stride)
            launch(stage, self.kernels.reduce, coarse.items, *reduced, self.levels[k], self.levels[k + 1])
        for k, band in enumerate(bands):
            fine, coarse = self.layouts[k], self.layouts[k + 1]
            self._margins(k + 1, fine.width % 2)
            sizes = (fine.width, fine.height, fine.stride, coarse.height, coarse.stride, fine.height % 2)
            planes = (self.levels[k], self.levels[k + 1], band)
            launch(stage, self.kernels.subtract_expanded, fine.items, *sizes, *planes)

    def _window_rows(self, band: _Band, plane: Array, against: float) -> tuple[int, int, int]:
        at = band.layout
        size = (at.width, at.height, at.stride)
        kernel = self.kernels.window_rows
        arrays = (band.plane, plane, self.taps, band.rows)
        self.device.launch("metrics/iwssim/rows", kernel, at.items, *size, against, *arrays)
        return size

    def reference(self, image: Array) -> None:
        """Take the picture that all others are compared with: uint8 (h, w, 4), sRGB.

        Waits for the device (a small eigenproblem per scale).
        """
        self._pyramid(image, [band.plane for band in self.bands])
        self.coarsest_reference, self.levels[-1] = self.levels[-1], self.coarsest_reference
        launch, kernels = self.device.launch, self.kernels
        parents = [self._enlarged(k) if k < WITH_PARENT else self.bands[k].plane for k in range(SCALES - 1)]
        products = []
        for band, parent in zip(self.bands, parents, strict=True):
            size = self._window_rows(band, band.plane, 0.0)
            moments = kernels.reference_moments
            launch("metrics/iwssim/columns", moments, len(band.partial), *size, band.rows, self.taps, band.moments)
            inner = band.layout.height - 2
            sums = self.device.empty((inner, band.neighbours * (band.neighbours + 1) // 2), np.float32)
            arguments = (*size, band.neighbours, band.plane, parent, sums)
            local = 1 if self.device.is_cpu else None
            launch("metrics/iwssim/neighbours", kernels.neighbour_products, inner, *arguments, local=local)
            products.append(sums)
        for band, parent, sums in zip(self.bands, parents, products, strict=True):
            self._decorrelate(band, parent, sums)

    def _enlarged(self, k: int) -> Array:
        """The band below band k at the size of band k."""
        at, below, upload = self.layouts[k], self.layouts[k + 1], self.device.upload
        columns, across = enlarged_positions(at.width, below.width)
        rows, down = enlarged_positions(at.height, below.height)
        axes = [upload(values) for values in (columns, across.astype(np.float32), rows, down.astype(np.float32))]
        out = at.empty(self.device)
        sizes = (at.width, at.height, at.stride, below.stride)
        kernel = self.kernels.enlarge
        self.device.launch("metrics/iwssim/neighbours", kernel, at.height, *sizes, self.bands[k + 1].plane, *axes, out)
        return out

    def _decorrelate(self, band: _Band, parent: Array, sums: Array) -> None:
        at, n = band.layout, band.neighbours
        covariance = np.zeros((n, n))
        lower = np.tril_indices(n)
        covariance[lower] = sums.get().sum(axis=0, dtype=np.float64) / ((at.height - 2) * (at.width - 2))
        covariance += np.tril(covariance, -1).T
        eigenvalues, whiten = decorrelation(covariance)
        band.eigenvalues = self.device.upload(eigenvalues.astype(np.float32))
        matrix = self.device.upload(whiten.astype(np.float32))
        arguments = (at.width, at.height, at.stride, n, band.plane, parent, matrix, band.energy)
        items = (at.height - 2) * at.pieces
        self.device.launch("metrics/iwssim/neighbours", self.kernels.whitened_energy, items, *arguments)

    def compare(self, test: Array) -> None:
        """Start comparing `test`, uint8 (h, w, 4), sRGB; `score` gives what came out."""
        self._pyramid(test, [band.test for band in self.bands])
        for band in self.bands:
            size = self._window_rows(band, band.test, 1.0)
            window_moments = (band.moments, band.rows, self.taps, C1, C2)
            weights = (band.plane, band.test, band.energy, band.eigenvalues, LEAST_VARIANCE)
            self.device.launch(
                "metrics/iwssim/columns",
                self.kernels.weighted_sums,
                len(band.partial),
                *(*size, band.neighbours, *window_moments, *weights, band.partial),
            )
        at = self.layouts[-1]
        planes = (self.coarsest_reference, self.levels[-1], self.taps)
        self.device.launch(
            "metrics/iwssim/coarsest",
            self.kernels.coarsest_similarity,
            self.coarsest_ssim.size,
            *(at.width, at.height, at.stride, *planes, ORIGIN * 2 ** (SCALES - 1), C1, C2, self.coarsest_ssim),
        )

    def score(self) -> float:
        """IW-SSIM of the last compared picture, 1 for identical ones."""
        means = []
        for band in self.bands:
            weighted, weight = band.partial.get().sum(axis=0, dtype=np.float64)
            # Without any information in either picture both are flat, and no weighting can tell pixels apart.
            means.append(weighted / weight if weight > 0 else 1.0)
        means.append(self.coarsest_ssim.get().mean(dtype=np.float64))
        return float(np.prod(power(np.abs(means), WEIGHTS)))


def _reduced(image: Doubles) -> Doubles:
    taps = np.sqrt(2) * np.array([1, 4, 6, 4, 1]) / 16
    padded = np.pad(image, 2, "reflect")
    for axis in (1, 0):
        padded = np.lib.stride_tricks.sliding_window_view(padded, 5, axis) @ taps
    return padded[::2, ::2]


def _expanded(coarse: Doubles, shape: tuple[int, int]) -> Doubles:
    taps = np.sqrt(2) * np.array([1, 4, 6, 4, 1]) / 16
    spread = np.zeros((2 * coarse.shape[0], 2 * coarse.shape[1]))
    spread[::2, ::2] = coarse
    padded = np.pad(spread[: shape[0], : shape[1]], 2, "reflect")
    for axis in (1, 0):
        padded = np.lib.stride_tricks.sliding_window_view(padded, 5, axis) @ taps
    return padded


def bands_twin(image: Doubles) -> list[Doubles]:
    """The four Laplacian bands of an image, float64 (h, w), finest first, and the coarsest low-pass plane: each half as
    wide and high as the one before, rounded up."""
    bands = []
    for _ in range(SCALES - 1):
        coarse = _reduced(image)
        bands.append(image - _expanded(coarse, image.shape))
        image = coarse
    return [*bands, image]


def _neighbours_twin(band: Doubles, parent: Doubles | None) -> Doubles:
    """Per pixel off the border its 3x3 neighbours and the parent: (h - 2, w - 2, 9 or 10)."""
    windows = np.lib.stride_tricks.sliding_window_view(band, (3, 3)).reshape(*(s - 2 for s in band.shape), 9)
    if parent is None:
        return windows
    for axis, count in enumerate(band.shape):
        first, weight = enlarged_positions(count, parent.shape[axis])
        weight = weight[:, None] if axis == 0 else weight
        parent = np.take(parent, first, axis) * (1 - weight) + np.take(parent, first + 1, axis) * weight
    return np.concatenate([windows, parent[1:-1, 1:-1, None]], axis=2)


def weights_twin(reference: Doubles, test: Doubles, parent: Doubles | None) -> Doubles:
    """Information weights, float64 (h - 2, w - 2), of a band of `reference` and `test`, (h, w).

    parent: the coarser band of the reference, None where it does not count.
    """
    y = _neighbours_twin(reference, parent)
    eigenvalues, whiten = decorrelation(np.einsum("hwi,hwj->ij", y, y) / (y.shape[0] * y.shape[1]))
    energy = np.mean((y @ whiten.T) ** 2, axis=2)
    r, t = (np.lib.stride_tricks.sliding_window_view(band, (3, 3)) for band in (reference, test))
    r, t = r - r.mean((2, 3), keepdims=True), t - t.mean((2, 3), keepdims=True)
    rr, tt, rt = ((a * b).mean((2, 3)) for a, b in ((r, r), (t, t), (r, t)))
    gain = rt / np.maximum(rr, LEAST_VARIANCE)
    variance = np.where(rr < LEAST_VARIANCE, tt, np.maximum(tt - gain * rt, 0))
    silent = tt < LEAST_VARIANCE
    gain, variance = np.where(silent | (rr < LEAST_VARIANCE), 0, gain), np.where(silent, 0, variance)
    slope = (variance + (1 + gain**2) * NOISE) * energy
    terms = 1 + (slope[..., None] * eigenvalues + NOISE * variance[..., None]) / NOISE**2
    weights: Doubles = np.log2(terms).sum(axis=2)
    return weights


def iwssim_twin(test: Bytes, reference: Bytes) -> float:
    """IW-SSIM of `test` against `reference`, uint8 (h, w, 3 or 4), sRGB, of at least 161 pixels a side."""
    bands_r, bands_t = bands_twin(luma(reference)), bands_twin(luma(test))
    means = []
    for k in range(SCALES - 1):
        parent = bands_r[k + 1] if k < WITH_PARENT else None
        inset = RADIUS - 1
        weights = weights_twin(bands_r[k], bands_t[k], parent)[inset:-inset, inset:-inset]
        contrast_structure, _ = similarity_twin(bands_r[k], bands_t[k])
        total = weights.sum()
        means.append((weights * contrast_structure).sum() / total if total > 0 else 1.0)
    means.append(np.mean(np.prod(similarity_twin(bands_r[-1], bands_t[-1]), axis=0)))
    return float(np.prod(np.abs(means) ** WEIGHTS))
