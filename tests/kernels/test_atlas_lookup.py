"""Bilinear lookups against their twin: within half a step of rounding, plus 1e-2 for float32 coordinates."""

import numpy as np
import pytest

from shading_atlas_bench.kernels.atlas.locate import locate, locate_twin
from shading_atlas_bench.kernels.atlas.lookup import look_up, look_up_twin
from shading_atlas_bench.kernels.atlas.opacity import fragment_opacity, fragment_opacity_twin
from shading_atlas_bench.kernels.fragments.opacity import VARIES
from shading_atlas_bench.kernels.samples import Samples


def samples_of(device, triangle: np.ndarray, bary: np.ndarray) -> Samples:
    samples = Samples.allocate(device, len(triangle))
    room = len(samples.triangle)
    for name, values in (("triangle", triangle), ("bary1", bary[:, 0]), ("bary2", bary[:, 1])):
        array = getattr(samples, name)
        padded = np.zeros(room, array.dtype)
        padded[: len(values)] = values
        array.set(padded)
    samples.texel.set(np.arange(room, dtype=np.int32)[::-1].copy())
    return samples


@pytest.mark.parametrize(("size", "count"), [(64, 1000), (64, 1003), (1, 9), (2, 1)])
def test_matches_its_twin(device, size, count):
    rng = np.random.default_rng(size + count)
    plane = rng.integers(0, 256, (size, size, 4), dtype=np.uint8)
    corners = rng.uniform(0.5, size - 0.5, (20, 3, 2)).astype(np.float32)
    corners[::2] = np.round(corners[::2] - 0.5) + 0.5  # texel centres
    corners[3] = np.nan
    triangle, bary = rng.integers(0, 20, count), rng.dirichlet(np.ones(3), count)[:, 1:].astype(np.float32)
    bary[::5] = 0
    samples = samples_of(device, triangle, bary)
    room = len(samples.triangle)
    rgb, drawn = device.zeros((1, room, 4), np.uint8), device.zeros((1, room), np.int32)
    ids = rng.permutation(20).astype(np.int32) + 100
    places = locate(device, samples, device.upload(corners), "client/test")
    look_up(device, samples, places, device.upload(ids), device.upload(plane), rgb, drawn, "client/test")
    found, drawn = rgb.get()[0][::-1][:count], drawn.get()[0][::-1][:count]
    expected = look_up_twin(locate_twin(corners, triangle, bary), plane)
    placed = np.isfinite(expected[:, 0])
    assert placed.sum() + (triangle == 3).sum() == count
    # A whole number of texels away from a centre, float32 errs by 1e-5 texels of up to 255 steps each.
    np.testing.assert_allclose(found[placed, :3], expected[placed], atol=0.5 + 1e-2)
    assert (found[placed, 3] == 255).all()
    np.testing.assert_array_equal(drawn, np.where(placed, ids[triangle], 0))
    assert (found[~placed] == 0).all()


def test_beyond_the_plane_its_border_goes_on(device):
    """As far as float32 reaches, also where no int does."""
    plane = np.random.default_rng(1).integers(0, 256, (8, 16, 4), dtype=np.uint8)
    far = [-3e38, -1e9, -(2.0**24), -(2.0**22), -1.0, 3.25, 16.0, 2.0**22, 2.0**24, 1e9, 3e38]
    places = np.stack(np.meshgrid(far, far), axis=-1).reshape(-1, 2).astype(np.float32)
    count, room = len(places), -(-len(places) // 8) * 8
    padded = np.full((2, room), np.nan, np.float32)
    padded[:, :count] = places.T
    samples = samples_of(device, np.zeros(count), np.zeros((count, 2), np.float32))
    rgb, drawn = device.zeros((1, len(samples.texel)), np.uint32), device.zeros((1, len(samples.texel)), np.int32)
    ids = device.upload(np.zeros(1, np.int32))
    look_up(device, samples, device.upload(padded), ids, device.upload(plane), rgb, drawn, "client/test")
    found = rgb.get().view(np.uint8).reshape(-1, 4)[::-1][:count, :3]
    near = np.clip(places.astype(np.float64), -1, [16, 8])
    np.testing.assert_allclose(found, look_up_twin(near, plane), atol=0.5 + 1e-2)


@pytest.mark.parametrize("room", [8, 20])
def test_places_with_no_room_for_whole_steps_are_refused(device, room):
    samples = samples_of(device, np.zeros(17), np.zeros((17, 2), np.float32))
    places, other = device.zeros((2, room), np.float32), device.zeros((1, 32), np.int32)
    with pytest.raises(ValueError, match=f"room for {room} samples: give it a multiple of 8, at least 17"):
        look_up(device, samples, places, other, device.zeros((4, 4, 4), np.uint8), other, other, "client/test")


def test_texel_centres_give_the_texels_themselves(device):
    plane = np.random.default_rng(0).integers(0, 256, (8, 8, 4), dtype=np.uint8)
    corners = np.zeros((64, 3, 2), np.float32)
    corners[:] = (np.stack(np.meshgrid(np.arange(8), np.arange(8)), axis=-1).reshape(64, 1, 2)) + 0.5
    samples = samples_of(device, np.arange(64), np.zeros((64, 2), np.float32))
    rgb, drawn = device.zeros((8, 8, 4), np.uint8), device.zeros((8, 8), np.int32)
    ids = device.upload(np.arange(64, dtype=np.int32))
    places = locate(device, samples, device.upload(corners), "client/test")
    look_up(device, samples, places, ids, device.upload(plane), rgb, drawn, "client/test")
    np.testing.assert_array_equal(rgb.get().reshape(64, 4)[::-1, :3], plane.reshape(64, 4)[:, :3])


@pytest.mark.parametrize("width", [2, 3])
def test_places_are_those_of_their_twin(device, width):
    rng = np.random.default_rng(width)
    corners = rng.uniform(0.5, 2000, (20, 1, 2)) + rng.uniform(-8, 8, (20, 3, 2))
    weight = rng.uniform(0.1, 1, (20, 3, 1))
    points = (corners if width == 2 else np.concatenate([corners * weight, weight], axis=2)).astype(np.float32)
    points[3] = np.nan
    triangle, bary = rng.integers(0, 20, 1003), rng.dirichlet(np.ones(3), 1003)[:, 1:].astype(np.float32)
    found = locate(device, samples_of(device, triangle, bary), device.upload(points), "client/test").get()[:, :1003].T
    np.testing.assert_allclose(found, locate_twin(points, triangle, bary), atol=2e-3)  # float32 at 2000: 1.2e-4
    np.testing.assert_array_equal(np.isnan(found[:, 0]), triangle == 3)


@pytest.mark.parametrize("has_plane", [False, True])
def test_opacity_of_fragments_equals_its_twin(device, has_plane):
    rng = np.random.default_rng(3)
    triangle, drawn = rng.integers(0, 40, 1003).astype(np.int32), rng.integers(-1, 5, 1003).astype(np.int32)
    constants = rng.choice([0, 100, 255, VARIES], 40).astype(np.int32)
    alphas = rng.integers(0, 256, (1003, 4), np.uint8)
    plane = device.upload(alphas) if has_plane else None
    inputs = (device.upload(triangle), device.upload(drawn), device.upload(constants), plane)
    found = fragment_opacity(device, 1003, *inputs, "opacity").get()
    expected = fragment_opacity_twin(triangle, drawn, constants, alphas[:, 0] if has_plane else None)
    np.testing.assert_array_equal(found, expected)
    assert len(np.unique(found)) > (100 if has_plane else 2)
