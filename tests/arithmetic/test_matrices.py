"""Small matrices, the Fourier transform and random draws against NumPy's own."""

import numpy as np
import pytest

from shading_atlas_bench.arithmetic import draws
from shading_atlas_bench.arithmetic.fourier import inverse_real
from shading_atlas_bench.arithmetic.matrices import (
    cofactors,
    determinant,
    dot,
    eigenvectors,
    inverse,
    matvec,
    product,
    transform,
)

RNG = np.random.default_rng(0)


def test_products_are_those_of_numpy():
    a, b = RNG.normal(size=(7, 4, 3)), RNG.normal(size=(3, 5))
    np.testing.assert_allclose(product(a, b), a @ b, rtol=1e-13)
    np.testing.assert_allclose(product(a, b, b.T), a @ b @ b.T, rtol=1e-12)
    np.testing.assert_allclose(dot(a, b.T[:1]), (a * b.T[:1]).sum(axis=-1), rtol=1e-13)
    np.testing.assert_allclose(matvec(a, b.T[0]), a @ b.T[0], rtol=1e-13)


def test_what_has_no_answer_is_refused():
    with pytest.raises(ValueError, match="no product"):
        product(np.ones((3, 4)), np.eye(3))
    with pytest.raises(ValueError, match="not finite"):
        eigenvectors(np.full((3, 3), np.nan))


def test_points_are_transformed_in_every_broadcast():
    matrices, points = RNG.normal(size=(6, 3, 4)), RNG.normal(size=(9, 3)).astype(np.float32)
    expected = points @ matrices[:, :, :3].transpose(0, 2, 1) + matrices[:, None, :, 3]
    np.testing.assert_allclose(transform(matrices, points), expected, rtol=1e-12)
    np.testing.assert_allclose(transform(matrices[0, :, :3], points), points @ matrices[0, :, :3].T, rtol=1e-12)
    assert transform(matrices[:0], points).shape == (0, 9, 3)


def test_inverses_determinants_and_cofactors():
    for size in (2, 3, 4):
        matrices = RNG.normal(size=(40, size, size))
        np.testing.assert_allclose(product(inverse(matrices), matrices), np.tile(np.eye(size), (40, 1, 1)), atol=1e-11)
    matrices = RNG.normal(size=(40, 3, 3))
    np.testing.assert_allclose(determinant(matrices), np.linalg.det(matrices), rtol=1e-11)
    found = cofactors(matrices) / determinant(matrices)[:, None, None]
    np.testing.assert_allclose(found.transpose(0, 2, 1), np.linalg.inv(matrices), rtol=1e-9)
    np.testing.assert_array_equal(inverse([[0.0, 2.0], [1.0, 0.0]]), [[0, 1], [0.5, 0]])
    assert inverse(np.zeros((0, 2, 2))).shape == (0, 2, 2)
    with pytest.raises(ValueError, match="no inverse"):
        inverse(np.ones((3, 3)))


@pytest.mark.parametrize("size", [2, 3, 11])
def test_eigenvectors_are_those_of_numpy(size):
    half = RNG.normal(size=(size, size + 3))
    matrix = half @ half.T
    values, vectors = eigenvectors(matrix)
    np.testing.assert_allclose(values, np.linalg.eigvalsh(matrix), rtol=1e-12)
    np.testing.assert_allclose(matrix @ vectors, vectors * values, atol=1e-12 * values[-1])
    np.testing.assert_allclose(vectors.T @ vectors, np.eye(size), atol=1e-14)
    assert (vectors[np.abs(vectors).argmax(axis=0), np.arange(size)] > 0).all()


@pytest.mark.parametrize("matrix", [np.zeros((3, 3)), np.eye(2), np.ones((2, 2)), np.diag([4.0, 1.0, 0.0])])
def test_eigenvectors_of_singular_matrices(matrix):
    values, vectors = eigenvectors(matrix)
    np.testing.assert_allclose(matrix @ vectors, vectors * values, atol=1e-15)
    assert (np.diff(values) >= 0).all()


@pytest.mark.parametrize("side", [2, 4, 8, 64, 256])
def test_the_transform_is_that_of_numpy(side):
    real, imaginary = spectrum = RNG.normal(size=(2, side, side // 2 + 1))
    expected = np.fft.irfft2(real + 1j * imaginary, (side, side))
    for dtype, error in (("float64", 1e-14), ("float32", 1e-6)):
        found = inverse_real(spectrum.astype(dtype))
        assert found.dtype == dtype
        np.testing.assert_allclose(found, expected, atol=error * np.abs(expected).max())


def test_draws_are_those_of_numpy_but_for_the_ends():
    mine, numpys = draws.generator([5, 7]), np.random.default_rng([5, 7])
    np.testing.assert_array_equal(mine.uniform(-2, 3, 100), numpys.uniform(-2, 3, 100))
    np.testing.assert_array_equal(mine.uniform([0, 1], [2, 5], 2), numpys.uniform([0, 1], [2, 5]))
    assert mine.uniform(1, 2) == numpys.uniform(1, 2)
    np.testing.assert_array_equal(mine.integers(0, 99, 50), numpys.integers(0, 99, 50))
    for name, arguments, least, most in (
        ("normal", (1.5, 2.0), 1.5 - 2 * draws.NORMAL_END, 1.5 + 2 * draws.NORMAL_END),
        ("exponential", (3.0,), 0, 3 * draws.EXPONENTIAL_END),
        ("gamma", (1.6, 3.0), 0, 40),
    ):
        one, other = (getattr(generator, name)(*arguments, 100_000) for generator in (mine, numpys))
        apart = one != other
        assert 0 < apart.sum() < 100
        assert ((other[apart] > one[apart]) | (other[apart] < least)).all()
        assert (least <= one).all()
        assert (one <= most).all()
    np.testing.assert_allclose(mine.lognormal(1, 0.4, 50), numpys.lognormal(1, 0.4, 50), rtol=1e-15)
    assert mine.normal(0, 1, 2).shape == mine.normal(size=2).shape == (2,)
