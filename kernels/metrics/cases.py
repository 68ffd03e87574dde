"""Cases of the picture metrics: a rendering with noise, and pictures of noise or of extremes."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol, TypeVar

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Bytes
from shading_atlas_bench.kernels.case import EXACT, Bound, Cost, Result, Trial, case, seeded
from shading_atlas_bench.kernels.inputs.pictures import damaged, on_device, rendering
from shading_atlas_bench.kernels.metrics.ciede2000 import Ciede2000, ciede2000, ciede2000_twin
from shading_atlas_bench.kernels.metrics.colour import lab_from_srgb, luma
from shading_atlas_bench.kernels.metrics.flip import PIXELS_PER_DEGREE, Filters, Flip, flip_twin
from shading_atlas_bench.kernels.metrics.iwssim import IwSsim, bands_twin, iwssim_twin
from shading_atlas_bench.kernels.metrics.mse import SquaredError, mse_twin
from shading_atlas_bench.kernels.metrics.ssim import RADIUS, Ssim, similarity_twin
from shading_atlas_bench.kernels.metrics.stretch import stretch, stretch_twin

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device

WHOLE = Filters.at(PIXELS_PER_DEGREE)
SHARP, BLUR, FEATURE = (len(taps) for taps in (WHOLE.luminance, WHOLE.yellow_1, WHOLE.smooth))


def _pictures(kind: str, size: int) -> tuple[Bytes, Bytes]:
    """Reference and test, 16:9 and `size` wide. Adversarial: black and white at random, and its opposite in places."""
    height, width = size * 9 // 16, size
    if kind == "typical":
        reference = rendering(height, width)
        return reference, damaged(reference, "noise")
    rng = seeded(kind)
    reference = 255 * rng.integers(0, 2, (height, width, 1), dtype=np.uint8).repeat(3, axis=2)
    return reference, np.where(rng.random((height, width, 1)) < 0.3, 255 - reference, reference)


class Metric(Protocol):
    """What the metrics have that compare pictures with a reference."""

    def reference(self, image: Array) -> None: ...

    def compare(self, test: Array) -> None: ...


AnyMetric = TypeVar("AnyMetric", bound=Metric)


def _trial(
    device: Device,
    kind: str,
    size: int,
    metric: Callable[[Device, int, int], AnyMetric],
    results: Callable[[AnyMetric, Bytes, Bytes], list[Result]],
) -> Trial:
    """Both halves of a metric: the reference's and the comparison's. results: of the metric and the host's pictures."""
    reference, test = _pictures(kind, size)
    height, width = reference.shape[:2]
    ours, uploaded = metric(device, width, height), [on_device(device, image) for image in (reference, test)]

    def run() -> None:
        ours.reference(uploaded[0])
        ours.compare(uploaded[1])

    def compared() -> list[Result]:
        run()
        return results(ours, reference, test)

    return Trial({"n": height * width, "rows": height}, run, compared)


@case({"mse.squared_error": Cost("n", "8*n", "6*n")}, 960)
def mse(device: Device, kind: str, size: int) -> Trial:
    reference, test = _pictures(kind, size)
    height, width = reference.shape[:2]
    error = SquaredError(device, width, height)
    uploaded = on_device(device, test), on_device(device, reference)

    def results() -> list[Result]:
        error.compare(*uploaded)
        return [Result(np.array([error.mean()]), np.array([mse_twin(test, reference)]))]

    return Trial({"n": height * width}, lambda: error.compare(*uploaded), results)


# Both pictures' luma and rows, one picture's moments, one comparison.
SSIM = {
    "ssim.centred_luma": Cost("2*n", "16*n", "10*n"),
    "ssim.window_rows": Cost("2*n", "40*n", f"{2 * (3 * 2 * 11 + 3)}*n"),
    "ssim.reference_moments": Cost("n", "20*n", f"{2 * 2 * 11}*n"),
    "ssim.dissimilarity_sums": Cost("n", "20*n", f"{3 * 2 * 11 + 18}*n"),
}


# Variances in flat windows are differences of almost equal sums.
@case(SSIM, 960, typical=Bound(300), adversarial=Bound(3))
def ssim(device: Device, kind: str, size: int) -> Trial:
    """Compares the sums of rows of 16 pixels: the error of single pixels, which the mean hides, shows."""

    def results(ours: Ssim, reference: Bytes, test: Bytes) -> list[Result]:
        expected = 1 - np.prod(similarity_twin(luma(reference), luma(test)), axis=0)
        pieces = ours.layout.pieces
        padded = np.pad(expected, ((0, -len(expected) % 4), (RADIUS, 16 * pieces - expected.shape[1] - RADIUS)))
        sums = padded.reshape(-1, 4, pieces, 16).sum(axis=(1, 3)).ravel()
        return [Result(ours.partial.get(), sums)]

    return _trial(device, kind, size, Ssim, results)


FLIP = {
    "flip.opponents": Cost("2*n", "32*n", "40*n"),
    "flip.filter_rows": Cost("2*n", "80*n", f"{2 * 2 * (2 * SHARP + 2 * BLUR + 3 * FEATURE)}*n"),
    "flip.colour_columns": Cost("2*n", "56*n", f"{2 * (2 * (2 * SHARP + 2 * BLUR) + 60)}*n"),
    "flip.feature_columns": Cost("2*n", "40*n", f"{2 * 2 * 4 * FEATURE}*n"),
    "flip.difference": Cost("n", "44*n", "40*n"),
}


# Powers of 0.7 of colour differences near 0 enlarge them.
@case(FLIP, 960, 480, typical=Bound(1000), adversarial=Bound(15_000))
def flip(device: Device, kind: str, size: int) -> Trial:
    def results(ours: Flip, reference: Bytes, test: Bytes) -> list[Result]:
        return [Result(ours.error_map(), flip_twin(test, reference))]

    return _trial(device, kind, size, Flip, results)


@case(
    {"ciede2000.lab_planes": Cost("n", "16*n", "30*n"), "ciede2000.difference_sums": Cost("n", "16*n", "180*n")},
    960,
    typical=Bound(100, spared=2e-3),  # pieces where hues are half a turn apart, as below
    adversarial=EXACT,
)
def delta_e(device: Device, kind: str, size: int) -> Trial:
    """Compares the sums of pieces of 16 pixels."""

    def results(ours: Ciede2000, reference: Bytes, test: Bytes) -> list[Result]:
        expected = ciede2000_twin(lab_from_srgb(reference), lab_from_srgb(test))
        pieces = ours.layout.pieces
        padded = np.pad(expected, ((0, 0), (0, 16 * pieces - expected.shape[1])))
        return [Result(ours.partial.get(), padded.reshape(-1, 16).sum(axis=1))]

    return _trial(device, kind, size, Ciede2000, results)


@case(
    {"ciede2000.differences": Cost("n", "28*n", "150*n")},
    1 << 20,
    typical=Bound(25),
    adversarial=Bound(25, spared=0.35),  # a last digit decides on which side of half a turn a hue is
)
def lab_differences(device: Device, kind: str, size: int) -> Trial:
    """Adversarial: greys and hues half a turn apart, where the standard's formula jumps."""
    rng = seeded(kind)
    a, b = rng.uniform([0, -100, -100], [100, 100, 100], (2, size, 3)).astype(np.float32)
    if kind == "adversarial":
        b[:, 1:] = -a[:, 1:] * (1 + 1e-5 * rng.normal(size=(size, 1)))
        a[::5, 1:] *= 1e-6

    def results() -> list[Result]:
        return [Result(ciede2000(device, a, b), ciede2000_twin(a.astype(np.float64), b.astype(np.float64)))]

    return Trial({"n": size}, lambda: ciede2000(device, a, b), results)


# A pyramid has 4/3 of the picture's pixels; both pictures have one, the comparison is of one.
IWSSIM = {
    "iwssim.reflect_margins": Cost("2*2*rows", "2*2*256*rows"),
    "iwssim.reduce": Cost("2*n/3", "2*(4*4/3 + 4/3)*n", "2*2*(5 + 5*2)*n/3"),
    "iwssim.subtract_expanded": Cost("2*4*n/3", "2*(8 + 2)*n*4/3", "2*14*n*4/3"),
    "iwssim.enlarge": Cost("n*5/4", "(4 + 1)*n*5/4", "6*n*5/4"),
    "iwssim.neighbour_products": Cost("n*4/3", "8*n*4/3", "2*55*n*4/3"),
    "iwssim.whitened_energy": Cost("n*4/3", "12*n*4/3", "2*110*n*4/3"),
    "iwssim.weighted_sums": Cost("n*4/3", "32*n*4/3", "200*n*4/3"),
    "iwssim.coarsest_similarity": Cost("n/256", "12*n/256", f"{2 * 5 * 121}*n/256"),
}


@case(IWSSIM, 960, typical=Bound(10))
def iwssim(device: Device, kind: str, size: int) -> Trial:
    """Compares the bands of the reference and the score."""

    def results(ours: IwSsim, reference: Bytes, test: Bytes) -> list[Result]:
        bands = bands_twin(luma(reference))[:-1]
        found = [band.layout.image(band.plane)[0] for band in ours.bands]
        score = Result(np.array([ours.score()]), np.array([iwssim_twin(test, reference)]))
        return [score, *(Result(*pair) for pair in zip(found, bands, strict=True))]

    return _trial(device, kind, size, IwSsim, results)


# Maps that almost collapse have determinants which float32 does not resolve.
@case({"stretch.stretch": Cost("n", "12*n", "60*n")}, 960, typical=Bound(1), adversarial=Bound(150, wrong=7e-4))
def stretching(device: Device, kind: str, size: int) -> Trial:
    """Adversarial: maps that almost collapse, and triangles of a few pixels."""
    rng, hard = seeded(kind), kind == "adversarial"
    height, width = size * 9 // 16, size
    y, x = np.mgrid[:height, :width]
    part = 3 if hard else 60
    triangle = (y // part * (width // part + 1) + x // part).astype(np.int32)
    triangle[rng.random((height, width)) < 0.05] = -1
    grid = np.stack([x, y], axis=-1)
    maps = rng.normal(size=(triangle.max() + 2, 2, 2))
    if hard:
        maps[::3, 1] = maps[::3, 0] * (1 + 10.0 ** rng.uniform(-7, -3, (len(maps[::3]), 1)))
    texels = (np.einsum("hwij,hwj->hwi", maps[triangle], grid % 1000) + 500).astype(np.float32)
    uploaded = device.upload(triangle), device.upload(texels)

    def results() -> list[Result]:
        found, expected = stretch(device, *uploaded), stretch_twin(triangle, texels)
        measures = Result(np.array(found[:2], np.float64), np.array(expected[:2], np.float64))
        pixels = np.arange(height * width)  # of two counts, as many differ as they are apart
        return [measures, Result(pixels < found[2], pixels < expected[2])]

    return Trial({"n": height * width}, lambda: stretch(device, *uploaded), results)
