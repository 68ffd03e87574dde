"""Samples and marks of what a picture shows, against their twins."""

import numpy as np
import pytest

from shading_atlas_bench.kernels.inputs.soups import look_at, orthographic, perspective, random_soup, soup
from shading_atlas_bench.kernels.raster.mark import mark_visible, mark_visible_twin
from shading_atlas_bench.kernels.raster.rasteriser import Rasteriser
from shading_atlas_bench.kernels.raster.resolve import resolve, resolve_twin

SIZE = (120, 80)


@pytest.mark.parametrize(
    "projection",
    [perspective(), perspective(100, 1.5, (0.2, -0.3)), orthographic(6, 4, 30)],
    ids=["plain", "off", "flat"],
)
def test_samples_match_the_twin(device, projection):
    triangles = random_soup(device, np.random.default_rng(1), 400)
    view = look_at((1, 2, 9), (0, 0, 0))
    seen = Rasteriser(device, triangles).draw(view, projection, *SIZE)
    samples = resolve(device, triangles, seen, view, projection)
    twin = resolve_twin(triangles, seen.triangle.get(), view, projection)
    count = samples.count
    assert count == len(twin["texel"])
    for name in ("triangle", "texel"):
        np.testing.assert_array_equal(getattr(samples, name).get()[:count], twin[name])
    # Weights err by float32's rounding of the distance over the triangle's size on screen; slivers are the worst.
    for name in ("bary1", "bary2"):
        error = abs(getattr(samples, name).get()[:count] - twin[name])
        assert np.quantile(error, 0.99) < 1e-3
    error = abs(samples.footprint.get()[:count] / twin["footprint"] - 1)
    assert np.quantile(error, 0.99) < 1e-3
    inside = samples.bary1.get()[:count], samples.bary2.get()[:count]
    assert min(inside[0].min(), inside[1].min()) >= 0
    assert (inside[0] + inside[1]).max() <= 1 + 1e-6


def test_a_square_seen_head_on(device):
    triangles = soup(device, [[[-50, -50, -2], [50, -50, -2], [0, 70, -2]]])
    seen = Rasteriser(device, triangles).draw(np.eye(4), perspective(90), *SIZE)
    samples = resolve(device, triangles, seen, np.eye(4), perspective(90))
    assert samples.count == SIZE[0] * SIZE[1]
    np.testing.assert_allclose(samples.footprint.get()[: samples.count], 2 * 2 / SIZE[0], rtol=1e-4)


def test_an_empty_picture_has_no_samples(device):
    triangles = soup(device, np.zeros((1, 3, 3)))
    seen = Rasteriser(device, triangles).draw(np.eye(4), perspective(), *SIZE)
    assert resolve(device, triangles, seen, np.eye(4), perspective()).count == 0


def test_marks_match_the_twin(device):
    triangles = random_soup(device, np.random.default_rng(2), 500)
    seen = Rasteriser(device, triangles).draw(look_at((1, 2, 9), (0, 0, 0)), perspective(), *SIZE)
    before = np.zeros(500, np.uint8)
    before[[3, 499]] = 1
    flags = device.upload(before)
    mark_visible(device, seen, flags)
    np.testing.assert_array_equal(flags.get(), mark_visible_twin(seen.triangle.get(), before))
