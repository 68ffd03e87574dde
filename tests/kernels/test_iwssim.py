"""IW-SSIM against its twin (1e-4) and against a program written apart from it, from the paper's equations (1e-3)."""

import numpy as np
import pytest
from scipy import ndimage

from shading_atlas_bench.kernels.device import VARIANTS, Device
from shading_atlas_bench.kernels.inputs.pictures import KINDS, damaged, flat, on_device, rendering
from shading_atlas_bench.kernels.metrics.iwssim import IwSsim, decorrelation, iwssim_twin


def compared(device, test, reference):
    """IW-SSIM by the kernels."""
    metric = IwSsim(device, reference.shape[1], reference.shape[0])
    metric.reference(on_device(device, reference))
    metric.compare(on_device(device, test))
    return metric.score()


def low_pass(plane, gain):
    taps = np.array([1, 4, 6, 4, 1]) / 16 * gain
    return ndimage.correlate1d(ndimage.correlate1d(plane, taps, axis=0, mode="mirror"), taps, axis=1, mode="mirror")


def laplacian_bands(plane):
    bands = []
    for _ in range(4):
        coarse = low_pass(plane, np.sqrt(2))[::2, ::2]
        spread = np.zeros_like(plane)
        spread[::2, ::2] = coarse
        bands.append(plane - low_pass(spread, np.sqrt(2)))
        plane = coarse
    return [*bands, plane]


def similarity(x, y):
    """Luminance and contrast-structure maps under the Gaussian window, borders cut off."""

    def mean(values):
        return ndimage.gaussian_filter(values, 1.5, truncate=5 / 1.5)[5:-5, 5:-5]

    mx, my = mean(x), mean(y)
    sxx, syy, sxy = mean(x * x) - mx**2, mean(y * y) - my**2, mean(x * y) - mx * my
    c1, c2 = 2.55**2, 7.65**2
    return (2 * mx * my + c1) / (mx**2 + my**2 + c1), (2 * sxy + c2) / (sxx + syy + c2)


def mutual_information(x, y, parent):
    """The information content weight of each pixel of the inner part, by determinants of the model's covariances.

    x is the reference's band, y the test's. Eq. of the paper: the sum over eigenvalues l of C_u of
    log2(1 + ((v + (1 + g^2) n) s l + n v) / n^2) with n = 0.4.
    """
    shifts = [np.roll(x, (-dy, -dx), axis=(0, 1)) for dy in (-1, 0, 1) for dx in (-1, 0, 1)]
    if parent is not None:
        rows, columns = (
            (2 * np.arange(n) - 0.5) * m / (4 * m - 3) - 0.5 for n, m in zip(x.shape, parent.shape, strict=True)
        )
        grid = np.meshgrid(rows, columns, indexing="ij")
        shifts.append(ndimage.map_coordinates(parent, grid, order=1, mode="nearest"))
    u = np.stack(shifts, axis=-1)[1:-1, 1:-1]
    covariance = np.tensordot(u, u, axes=([0, 1], [0, 1])) / (u.shape[0] * u.shape[1])
    s = np.einsum("hwi,ij,hwj->hw", u, np.linalg.pinv(covariance, rcond=1e-6), u) / u.shape[2]

    def box(values):
        return ndimage.uniform_filter(values, 3)[1:-1, 1:-1]

    sxx, syy = box(x * x) - box(x) ** 2, box(y * y) - box(y) ** 2
    sxy = box(x * y) - box(x) * box(y)
    tiny = 1e-9
    g = np.where((sxx > tiny) & (syy > tiny), sxy / np.maximum(sxx, tiny), 0)
    v = np.where(syy > tiny, syy - g * sxy, 0)
    n = 0.4
    eigenvalues = np.maximum(np.linalg.eigvalsh(covariance), 0)
    return sum(np.log2(1 + ((v + (1 + g * g) * n) * s * e + n * v) / n**2) for e in eigenvalues)[4:-4, 4:-4]


def published(test, reference):
    """The score, written from the paper's equations."""
    x, y = (laplacian_bands(image @ [0.299, 0.587, 0.114]) for image in (reference, test))
    means = []
    for k in range(5):
        luminance, contrast_structure = similarity(x[k], y[k])
        if k < 4:
            weight = mutual_information(x[k], y[k], x[k + 1] if k < 3 else None)
            means.append((weight * contrast_structure).sum() / weight.sum())
        else:
            means.append((luminance * contrast_structure).mean())
    return np.prod(np.abs(means) ** np.array([0.0448, 0.2856, 0.3001, 0.2363, 0.1333]))


@pytest.mark.parametrize("kind", KINDS)
def test_agrees_with_the_equations_and_the_twin(device, kind):
    reference = rendering(186, 243)
    test = damaged(reference, kind)
    score = compared(device, test, reference)
    assert score == pytest.approx(published(test, reference), abs=1e-3)
    assert score == pytest.approx(iwssim_twin(test, reference), abs=1e-4)


@pytest.mark.parametrize("size", [(161, 161), (162, 177), (175, 320)])
def test_sizes_that_halve_unevenly(device, size):
    reference = rendering(size[0], size[1], seed=4)
    test = damaged(reference, "noise", seed=1)
    score = compared(device, test, reference)
    assert score == pytest.approx(published(test, reference), abs=1e-3)
    assert score == pytest.approx(iwssim_twin(test, reference), abs=1e-4)


@pytest.mark.parametrize("variant", VARIANTS)
def test_identical_pictures_give_exactly_1(variant):
    device = Device.open(variant=variant)
    noise = np.random.default_rng(0).integers(0, 256, (165, 180, 3)).astype(np.uint8)
    for picture in (rendering(170, 190), noise, flat(161, 161, (9, 99, 200)), flat(161, 161, (255,) * 3)):
        assert compared(device, picture, picture) == 1


@pytest.mark.parametrize("colours", [((0, 0, 0), (255, 255, 255)), ((128, 0, 0), (0, 0, 128))])
def test_flat_pictures_have_a_finite_score(device, colours):
    score = compared(device, *(flat(161, 170, colour) for colour in colours))
    assert 0 <= score < 1


def test_a_flat_reference_has_a_finite_score(device):
    score = compared(device, rendering(161, 180), flat(161, 180, (128, 128, 128)))
    assert 0 <= score < 1
    assert score == pytest.approx(iwssim_twin(rendering(161, 180), flat(161, 180, (128, 128, 128))), abs=1e-3)


def test_one_wrong_pixel_costs_a_little(device):
    reference = rendering(180, 200)
    assert 0.99 < compared(device, damaged(reference, "pixel"), reference) < 1


def test_too_small_a_picture_is_refused(device):
    with pytest.raises(ValueError, match="161 pixels a side"):
        IwSsim(device, 960, 160)


def test_whitening_makes_the_covariance_the_identity():
    rng = np.random.default_rng(0)
    mix = rng.normal(size=(10, 10))
    covariance = mix @ mix.T
    eigenvalues, whiten = decorrelation(covariance)
    np.testing.assert_allclose(whiten @ covariance @ whiten.T, np.eye(10), atol=1e-8)
    assert eigenvalues.sum() == pytest.approx(np.trace(covariance))
    assert not decorrelation(np.zeros((9, 9)))[1].any()
