"""Set-up and drawing against their twins, one stage at a time."""

import numpy as np
import pytest

from shading_atlas_bench.kernels.inputs.soups import look_at, perspective, pixel_points, random_soup, soup
from shading_atlas_bench.kernels.raster.camera import Camera
from shading_atlas_bench.kernels.raster.clusters import EVER
from shading_atlas_bench.kernels.raster.rasteriser import TILE, Rasteriser
from shading_atlas_bench.kernels.raster.render_target import RenderTarget
from shading_atlas_bench.kernels.raster.setup import MASK_BIT, RECORD, Scratch, set_up, set_up_twin
from shading_atlas_bench.kernels.raster.tiles import draw_tiles, draw_tiles_twin
from shading_atlas_bench.kernels.triangles import Triangles

SIZE = (256, 128)


def stages(device, triangles, camera):
    """Records int32 (n, RECORD), and triangle and depth images, of the kernels."""
    picture, scratch = RenderTarget.allocate(device, camera, TILE), Scratch(device, 4096, 16384)
    clusters = Rasteriser(device, triangles, cull=False).clusters
    chosen, _ = clusters.cull_frustum(camera, 0, EVER, "raster/cull")
    bins = set_up(device, clusters, chosen, picture, False, scratch, "raster")
    draw_tiles(device, bins, picture, False, triangles, None, "raster/draw")
    assert scratch.fits(bins.needed)
    records = bins.records.get()[: device.chunks * scratch.records * RECORD]
    chunks = records.reshape(device.chunks, scratch.records, RECORD)
    parts = [chunk[:count] for chunk, count in zip(chunks, bins.needed.get()[:, 0], strict=True)]
    return np.concatenate(parts), picture.triangle.get(), picture.depth.get()


def exact_corners(rng, count):
    """Pixel positions (count, 3, 2) whose projection float32 holds exactly, in steps of half a sub-pixel."""
    centres = rng.integers(-20, 276, (count, 1, 2)) * [1, 0.5]
    reach = 2.0 ** rng.integers(-9, 7, (count, 1, 1))
    return centres + np.round(rng.uniform(-1, 1, (count, 3, 2)) * reach * 512) / 512


@pytest.mark.parametrize("flags", [0, Triangles.DOUBLE_SIDED])
def test_records_of_exact_corners_are_the_twins(device, flags):
    pixels = exact_corners(np.random.default_rng(flags), 1500)
    distances = 2.0 ** np.random.default_rng(2).integers(-2, 5, (1500, 1, 1))
    triangles = soup(device, pixel_points(pixels, *SIZE) * distances, flags)
    projection = perspective(90, 2)
    projection[[0, 1], [0, 1]] = 1, 2  # without the tangent's rounding
    camera = Camera.of(np.eye(4), projection, *SIZE)
    records, _, _ = stages(device, triangles, camera)
    expected = set_up_twin(triangles, camera)
    assert len(expected) > 150
    np.testing.assert_array_equal(records[:, [0, 1, 2, 3, 4, 5, 9, 10, 11]], expected[:, [0, 1, 2, 3, 4, 5, 9, 10, 11]])
    np.testing.assert_allclose(records[:, 6:9].view(np.float32), expected[:, 6:9].view(np.float32), rtol=2e-7)


def test_records_of_random_triangles_are_within_a_subpixel_of_the_twins(device):
    triangles = random_soup(device, np.random.default_rng(5), 900, Triangles.DOUBLE_SIDED)
    camera = Camera.of(look_at((1, 2, 5), (0, 0, 0)), perspective(90, 2), *SIZE)
    records, _, _ = stages(device, triangles, camera)
    expected = set_up_twin(triangles, camera)
    in_both = np.intersect1d(records[:, 9], expected[:, 9])
    assert len(in_both) > 100
    assert len(np.setxor1d(records[:, 9], expected[:, 9])) <= 0.01 * len(in_both)
    compared = 0
    for number in in_both:
        mine, twins = records[records[:, 9] == number], expected[expected[:, 9] == number]
        if len(mine) == len(twins):
            difference = abs(mine[:, :6] - twins[:, :6])
            assert (difference <= 1 + 2e-5 * abs(twins[:, :6])).all()  # the part of clipping at the near plane
            compared += 1
    assert compared >= 0.98 * len(in_both)


def test_corners_far_outside_are_clipped_as_the_twins_are(device):
    """Up to where their positions in sub-pixels no longer fit whole numbers."""
    rng = np.random.default_rng(11)
    pixels = rng.uniform(0, 1, (900, 3, 2)) * SIZE
    far = rng.random((900, 3, 1)) < 0.5
    pixels = np.where(far, rng.choice([-1, 1], (900, 3, 2)) * 2.0 ** rng.uniform(13, 60, (900, 3, 2)), pixels)
    triangles = soup(device, pixel_points(pixels, *SIZE), Triangles.DOUBLE_SIDED)
    camera = Camera.of(np.eye(4), perspective(90, 2), *SIZE)
    records, _, _ = stages(device, triangles, camera)
    expected = set_up_twin(triangles, camera)
    assert len(np.unique(expected[:, 9])) > 500
    assert len(np.setxor1d(records[:, 9], expected[:, 9])) <= 5
    whole = ~np.any(far, axis=(1, 2))[records[:, 9]]
    assert 50 < whole.sum() < len(records) / 2
    alike = [np.isin(one[:, 9], other[:, 9]) for one, other in ((records, expected), (expected, records))]
    boxes = [rows[kept][:, 10:] for rows, kept in zip((records, expected), alike, strict=True)]
    assert (boxes[0] == boxes[1]).all(axis=1).mean() > 0.99


@pytest.mark.parametrize("seed", range(3))
def test_tiles_show_what_the_twin_draws_from_the_same_records(device, seed):
    rng = np.random.default_rng(seed)
    triangles = random_soup(device, rng, 400, Triangles.DOUBLE_SIDED)
    camera = Camera.of(look_at(rng.normal(0, 4, 3), (0, 0, 0)), perspective(90, 2), *SIZE)
    records, ids, depths = stages(device, triangles, camera)
    expected, nearest = draw_tiles_twin(records, *SIZE)
    np.testing.assert_array_equal(ids >= 0, expected >= 0)
    # Float32 along a row of 8 pixels: at its block's corner a steep plane may be far beyond the triangle's depths.
    wrong = abs(depths - nearest) > 2**-21 * nearest
    assert wrong.mean() < 0.001
    assert (ids != expected).mean() < 0.001
    assert abs(depths - nearest).max() < 1e-4


def test_of_equal_depths_the_twin_too_takes_the_lowest_triangle():
    depth = np.full(3, 0.5, np.float32).view(np.int32)
    shared = [0, 0, 4096, 0, 0, 4096, *depth]
    records = np.array([[*shared, 7, 0, 15 | 15 << 16], [*shared, 3 | MASK_BIT, 0, 15 | 15 << 16]], np.int32)
    triangle, nearest = draw_tiles_twin(records, 20, 20)
    assert set(np.unique(triangle)) == {-1, 3}
    assert nearest[0, 0] == 0.5
    assert triangle[0, 15] == -1  # its centre lies on the long edge, which is neither a top nor a left one
