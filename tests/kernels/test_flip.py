"""FLIP against its twin (per pixel within 1e-3) and against the authors' own program (mean 1e-3, per pixel 1e-2)."""

import numpy as np
import pytest

from shading_atlas_bench.kernels.inputs.pictures import KINDS, damaged, flat, on_device, rendering
from shading_atlas_bench.kernels.metrics.flip import Flip, flip_twin, magma


def compared(device, test, reference):
    """The mean and the map by the kernel."""
    flip = Flip(device, reference.shape[1], reference.shape[0])
    flip.reference(on_device(device, reference))
    flip.compare(on_device(device, test))
    return flip.mean(), flip.error_map()


def published(test, reference):
    """The map of the authors' program."""
    evaluator = pytest.importorskip("flip_evaluator")
    pictures = [(image / 255).astype(np.float32) for image in (reference, test)]
    error, _, _ = evaluator.evaluate(*pictures, "LDR", applyMagma=False)
    return error.reshape(reference.shape[:2])


@pytest.mark.parametrize("kind", KINDS)
def test_agrees_with_the_published_program_and_the_twin(device, kind):
    reference = rendering(150, 203)
    test = damaged(reference, kind)
    mean, error = compared(device, test, reference)
    oracle = published(test, reference)
    assert mean == pytest.approx(oracle.mean(), abs=1e-3)
    np.testing.assert_allclose(error, oracle, atol=1e-2)
    np.testing.assert_allclose(error, flip_twin(test, reference), atol=1e-3)
    assert mean == pytest.approx(error.mean(dtype=np.float64), abs=1e-6)


@pytest.mark.parametrize("size", [(1, 1), (3, 40), (33, 2), (17, 16), (64, 65)])
def test_tiny_pictures(device, size):
    rng = np.random.default_rng(0)
    reference, test = rng.integers(0, 256, (2, *size, 3)).astype(np.uint8)
    _, error = compared(device, test, reference)
    np.testing.assert_allclose(error, flip_twin(test, reference), atol=1e-3)
    np.testing.assert_allclose(error, published(test, reference), atol=1e-2)


@pytest.mark.parametrize("colours", [((0, 0, 0), (255, 255, 255)), ((0, 255, 0), (0, 0, 255)), ((90, 90, 90),) * 2])
def test_flat_pictures(device, colours):
    test, reference = (flat(40, 50, colour) for colour in colours)
    mean, error = compared(device, test, reference)
    np.testing.assert_allclose(error, published(test, reference), atol=1e-2)
    assert 0 <= mean <= 1


def test_identical_pictures_differ_by_exactly_0(device):
    picture = rendering(90, 70, seed=3)
    mean, error = compared(device, picture, picture)
    assert mean == 0
    assert not error.any()


def test_red_and_blue_are_not_swapped(device):
    reference, test = flat(40, 40, (200, 40, 40)), flat(40, 40, (200, 60, 40))
    swapped, _ = compared(device, test[..., ::-1], reference[..., ::-1])
    mean, _ = compared(device, test, reference)
    assert mean == pytest.approx(published(test, reference).mean(), abs=1e-3)
    assert abs(mean - swapped) > 1e-2


def test_a_resolution_whose_filters_have_no_room_is_refused(device):
    with pytest.raises(ValueError, match="pixels per degree"):
        Flip(device, 32, 32, pixels_per_degree=300)


def test_the_colour_map_grows_brighter():
    colours = magma(np.linspace(0, 1, 256)).astype(np.int64)
    assert colours.shape == (256, 3)
    luma = colours @ [299, 587, 114]
    assert np.all(np.diff(luma) >= -1000)
    assert luma[0] < 5000
    assert luma[-1] > 230_000
