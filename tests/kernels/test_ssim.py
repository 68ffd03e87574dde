"""SSIM against its twin and scikit-image (both within 1e-5; flat and saturated 2e-4), and the squared error exactly."""

import numpy as np
import pytest

from shading_atlas_bench.kernels.device import VARIANTS, Device
from shading_atlas_bench.kernels.inputs.pictures import KINDS, damaged, flat, on_device, rendering
from shading_atlas_bench.kernels.metrics.colour import luma
from shading_atlas_bench.kernels.metrics.mse import SquaredError, mse_twin, psnr
from shading_atlas_bench.kernels.metrics.ssim import Ssim, ssim_twin


def compared(device, test, reference):
    """Mean SSIM by the kernel."""
    ssim = Ssim(device, reference.shape[1], reference.shape[0])
    ssim.reference(on_device(device, reference))
    ssim.compare(on_device(device, test))
    return 1 - ssim.loss()


def published(test, reference):
    """Mean SSIM by scikit-image, with the settings of Wang et al. 2004."""
    metrics = pytest.importorskip("skimage.metrics")
    options = {"gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False, "data_range": 255}
    return metrics.structural_similarity(luma(reference), luma(test), **options)


@pytest.mark.parametrize("kind", KINDS)
def test_agrees_with_scikit_image_and_the_twin(device, kind):
    reference = rendering(150, 203)
    test = damaged(reference, kind)
    mean = compared(device, test, reference)
    assert mean == pytest.approx(published(test, reference), abs=1e-5)
    assert mean == pytest.approx(ssim_twin(test, reference), abs=1e-5)


@pytest.mark.parametrize("size", [(11, 11), (11, 40), (50, 12), (14, 33)])
def test_the_smallest_pictures(device, size):
    rng = np.random.default_rng(1)
    reference, test = rng.integers(0, 256, (2, *size, 3)).astype(np.uint8)
    assert compared(device, test, reference) == pytest.approx(published(test, reference), abs=1e-5)


def test_too_small_a_picture_is_refused(device):
    with pytest.raises(ValueError, match="11 pixels a side"):
        Ssim(device, 10, 400)


def checker(height, width):
    """Black and white pixels in turn."""
    return np.repeat((np.indices((height, width)).sum(axis=0) % 2 * 255).astype(np.uint8)[..., None], 3, axis=2)


IDENTICAL = {
    "rendering": rendering(80, 95),
    "noise": np.random.default_rng(0).integers(0, 256, (97, 131, 3)).astype(np.uint8),
    "grey": flat(20, 20, (7, 7, 7)),
    "coloured": flat(96, 96, (201, 57, 13)),
    "black": flat(64, 64, (0, 0, 0)),
    "white": flat(64, 64, (255, 255, 255)),
    "checker": checker(45, 70),
}


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("name", IDENTICAL)
def test_identical_pictures_lack_exactly_nothing(name, variant):
    """However freely the compiler may round: the formulas see to it, not the rounding."""
    picture, device = IDENTICAL[name], Device.open(variant=variant)
    ssim = Ssim(device, picture.shape[1], picture.shape[0])
    ssim.reference(on_device(device, picture))
    ssim.compare(on_device(device, picture))
    assert ssim.loss() == 0
    assert ssim_twin(picture, picture) == 1


@pytest.mark.parametrize("pair", [(0, 255), (254, 255), (0, 1)])
def test_flat_pictures(device, pair):
    test, reference = (flat(30, 30, (value,) * 3) for value in pair)
    assert compared(device, test, reference) == pytest.approx(published(test, reference), abs=2e-4)


@pytest.mark.parametrize("size", [(1, 1), (5, 16), (40, 33)])
def test_the_squared_error_is_exact(device, size):
    rng = np.random.default_rng(2)
    reference, test = rng.integers(0, 256, (2, *size, 3)).astype(np.uint8)
    error = SquaredError(device, size[1], size[0])
    error.compare(on_device(device, test), on_device(device, reference))
    assert error.mean() == pytest.approx(mse_twin(test, reference), rel=1e-12)


def test_black_against_white_is_0_db_and_identical_has_no_ratio():
    assert psnr(255.0**2) == 0
    assert psnr(0.0) is None
    assert psnr(1.0) == pytest.approx(48.1308, abs=1e-4)
