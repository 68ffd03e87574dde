"""Shading Atlas Streaming on a small room: valid, deterministic, honest about its bytes, and it looks right."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shading_atlas_bench.harness.workload.reference import ForwardRenderer
from shading_atlas_bench.packers.budget import TOLERANCE
from shading_atlas_bench.packers.interface import Payload
from shading_atlas_bench.packers.sas import ShadingAtlasStreaming
from shading_atlas_bench.packers.sas.kernels.layout import unpack_location
from shading_atlas_bench.packers.sas.statistics import describe
from shading_atlas_bench.packers.sas.superblocks import choose_grid
from shading_atlas_bench.scenes.model import Scene
from tests.packers import streams
from tests.packers.rooms import changing_sets, frame_of, novel_view, room, server_of

Stream = partial(streams.Stream, ShadingAtlasStreaming)


@pytest.mark.parametrize(
    "parameters", [{}, {"reuse": True}, {"complete": True}, {"superblock": 32, "fit": 0.5}, {"bias": "picture"}]
)
def test_a_walk_is_valid(scene, parameters):
    stream = Stream(scene, **parameters)
    for step in range(4):
        frame = frame_of(scene, 1024, 512, 4 * step)
        payload = stream.send(frame)
        assert stream.violations(frame, payload) == []
        assert payload.unplaced == {}


def test_the_client_sees_what_the_reference_shows(scene):
    stream = Stream(scene)
    stream.send(frame_of(scene, 1024, 1024))
    image = stream.client.draw(novel_view())
    reference, _ = ForwardRenderer(scene).draw(novel_view(), eye=frame_of(scene, 16, 16).server.eye)
    assert reference.triangle is not None
    assert (image.triangle.get() == reference.triangle.get()).mean() > 0.995
    error = np.abs(image.rgb.get().astype(int) - reference.rgb.get())
    assert error.mean() < 2.5
    empty = reference.triangle.get() < 0
    assert (error[empty & (image.triangle.get() < 0)] == 0).all()


def test_a_client_without_triangles_says_that_it_shows_none(scene):
    stream = Stream(scene)
    stream.send(frame_of(scene, 64, 64, 0, np.zeros(0, np.int32)))
    assert (stream.client.draw(novel_view()).triangle.get() == -1).all()


def test_more_samples_bring_the_client_closer_to_the_reference(scene):
    errors = []
    reference, _ = ForwardRenderer(scene).draw(novel_view(), eye=frame_of(scene, 16, 16).server.eye)
    for side in (64, 256, 1024):
        stream = Stream(scene)
        stream.send(frame_of(scene, side, side))
        image = stream.client.draw(novel_view())
        errors.append(np.abs(image.rgb.get().astype(int) - reference.rgb.get()).mean())
    assert errors[0] > errors[1] > errors[2]


@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 1000), reuse=st.booleans(), side=st.sampled_from([16, 64, 200, 512]))
def test_any_sequence_of_sets_is_valid(scene, seed, reuse, side):
    """Sets that change a little, entirely, to nothing and back; blocks that stay keep their texels."""
    rng = np.random.default_rng(seed)
    stream = Stream(scene, reuse=reuse)
    for chosen in changing_sets(rng, scene.triangles.count, ["little", "all", "none", "one", "little"], 0.05):
        frame = frame_of(scene, side, side, 0, chosen)
        payload = stream.send(frame)
        assert stream.violations(frame, payload) == []
        assert payload.sample_count == payload.statistics["used_texels"] <= side * side
        assert (len(payload.unplaced) > 0) <= (payload.statistics["bias"] > 15)
        placed = np.setdiff1d(chosen, list(payload.unplaced))
        owners = payload.owners()
        assert owners
        without = (~np.isin(placed, owners.triangle)).sum()
        assert payload.statistics["triangles_without_texel"] == without


def test_blocks_stay_while_nothing_changes(scene):
    stream = Stream(scene)
    frame = frame_of(scene, 512, 512)
    first = stream.send(frame)
    second = stream.send(frame)
    assert second.planes["atlas"].get().tobytes() == first.planes["atlas"].get().tobytes()
    assert not any(second.blobs["locations"])
    assert len(second.geometry) < 8 < len(first.geometry)
    assert second.statistics["resets"] == 0


@pytest.mark.parametrize(("local_size", "chunks"), [(1, 3), (32, 64), (256, 1000)])
def test_work_groups_and_chunks_change_no_byte(device, scene, local_size, chunks, monkeypatch):
    frames = [frame_of(scene, 256, 256, step) for step in (0, 8)]
    plain = [Stream(scene, reuse=True)] * 2
    expected = [as_bytes(stream.send(frame)) for stream, frame in zip(plain, frames, strict=True)]
    monkeypatch.setattr(device, "local_size", local_size)
    monkeypatch.setattr(device, "chunks", chunks)
    other = [Stream(scene, reuse=True)] * 2
    found = [as_bytes(stream.send(frame)) for stream, frame in zip(other, frames, strict=True)]
    assert found == expected


def as_bytes(payload: Payload) -> tuple:
    return payload.planes["atlas"].get().tobytes(), payload.blobs["locations"], payload.geometry, payload.statistics


def test_an_atlas_too_small_for_one_texel_each_names_the_rest(scene):
    stream = Stream(scene)
    pvs = np.arange(scene.triangles.count, dtype=np.int32)
    frame = frame_of(scene, 16, 16, 0, pvs)
    payload = stream.send(frame)
    assert payload.sample_count == 256
    patches = stream.packer.patches.of_triangle
    assert len(np.unique(patches[sorted(set(pvs) - set(payload.unplaced))])) == 256
    assert stream.violations(frame, payload) == []
    image = stream.client.draw(novel_view())
    assert not np.isin(image.triangle.get(), list(payload.unplaced)).any()


def test_the_client_gets_by_with_what_was_sent(scene):
    """A client that joins with the first frame locates the triangles of every later set, and no others."""
    stream = Stream(scene)
    half = scene.triangles.count // 2
    for low, high in ((0, half), (half // 2, 2 * half), (0, 10)):
        pvs = np.arange(low, high, dtype=np.int32)
        stream.send(frame_of(scene, 512, 512, 0, pvs))
        bary = np.full((scene.triangles.count, 2), 1 / 3, np.float32)
        place = stream.client.locate(np.arange(scene.triangles.count), bary)
        np.testing.assert_array_equal(np.flatnonzero(np.isfinite(place).all(axis=1)), pvs)


def test_statistics_add_up(scene):
    stream = Stream(scene, complete=True)
    frame = frame_of(scene, 1000, 600)
    payload = stream.send(frame)
    found = payload.statistics
    patches = sum(found[f"patches_of_{k}"] for k in (1, 2, 3))
    assert patches == len(np.unique(stream.packer.patches.of_triangle[frame.pvs])) == found["blocks"]
    assert found["location_bytes"] == 4 * patches == len(payload.blobs["locations"])
    assert stream.packer.allocator
    words = stream.packer.allocator.words.get()
    _, _, w, h = unpack_location(words[words > 0])
    assert payload.sample_count == (1 << w + h).sum() <= found["reserved_texels"]


def far_scene() -> Scene:
    """Triangles below a pixel, two metres away: a room at a hundredth of its size, and in it squares of three triangles
    each, which become fans."""
    near, count = room(quads=20), 40
    corners = np.array([[0, 0, 0], [0.2, 0, 0], [0.2, -0.2, 0], [0, -0.2, 0], [0.1, 0, 0]])
    fans = (corners + np.linspace([-2, 0, 0], [2, 0, 0], count)[:, None]).reshape(-1, 3)
    fan = np.array([[4, 3, 2], [4, 2, 1], [4, 0, 3]])
    first = len(near.positions) + 5 * np.arange(count)[:, None, None]
    indices = np.concatenate([near.indices, (fan + first).reshape(-1, 3)]).astype(np.int32)
    positions = (np.concatenate([near.positions, fans.astype(np.float32)]) / 100).astype(np.float32)
    more: dict[str, Any] = {
        name: np.concatenate([array := getattr(near, name), array[: len(fans)]])
        for name in ("normals", "uvs", "colours")
    }
    ids = np.zeros(len(indices), np.int32)
    return replace(near, positions=positions, indices=indices, material_ids=ids, content_hash="far", **more)


@pytest.mark.parametrize(("make", "side"), [(far_scene, 16), (far_scene, 64), (room, 64), (room, 1024)])
@pytest.mark.parametrize("complete", [False, True])
def test_triangles_without_a_texel_are_counted_and_a_bias_is_their_reason(device, make, side, complete):
    scene = server_of(device, make())
    stream = Stream(scene, complete=complete)
    frame = frame_of(scene, side, side)
    payload = stream.send(frame)
    placed = np.setdiff1d(frame.pvs, list(payload.unplaced))
    owners = payload.owners()
    assert owners
    without = (~np.isin(placed, owners.triangle)).sum()
    assert payload.statistics["triangles_without_texel"] == without
    assert without == 0 or payload.statistics["bias"] > 0
    assert without > 0 or (make, side) != (far_scene, 16)


def test_triangles_below_a_pixel_own_a_texel_each(device):
    far = server_of(device, far_scene())
    stream = Stream(far)
    frame = frame_of(far, 256, 256, 0, np.arange(far.triangles.count, dtype=np.int32))
    payload = stream.send(frame)
    assert payload.statistics["bias"] == 0
    assert payload.unplaced == {}
    assert payload.statistics["patches_of_2"] > 100
    assert payload.statistics["patches_of_3"] > 10
    owners = payload.owners()
    assert owners
    assert set(owners.triangle.tolist()) == set(frame.pvs.tolist())
    assert stream.violations(frame, payload) == []


@pytest.mark.parametrize(
    ("size", "superblock", "side", "total"),
    [
        ((4096, 2048), 0, 256, 128),
        ((2048, 2048), 0, 128, 256),
        ((2048, 1024), 0, 128, 128),
        ((512, 512), 0, 32, 256),
        ((16, 16), 0, 1, 256),
        ((1000, 600), 128, 128, 28),
    ],
)
def test_superblocks_follow_the_atlas(size, superblock, side, total):
    grid = choose_grid(size[0], size[1], superblock)
    assert (1 << grid.top, grid.total) == (side, total)


def test_statistics_count_patches_by_triangles_and_the_sizes_of_blocks_in_use():
    """Five superblocks of 8 x 8 texels; of three sizes of blocks two are in use."""
    patches: Any = SimpleNamespace(sizes=lambda visible: np.array([3, 1, 3, 2])[visible])
    allocator: Any = SimpleNamespace(
        superblocks_in_use=lambda: 5,
        blocks_by_class=lambda: np.array([3, 0, 2]),
        resets=1,
        grid=SimpleNamespace(top=3),
    )
    assert describe(patches, np.array([0, 1, 2]), allocator) == {
        "patches_of_1": 1, "patches_of_2": 0, "patches_of_3": 2,
        "resets": 1, "superblocks": 5, "blocks": 5, "size_classes": 2, "reserved_texels": 320,
    }  # fmt: skip


def test_a_superblock_may_have_any_power_of_two_up_to_256():
    assert [choose_grid(256, 256, 1 << top).top for top in range(9)] == list(range(9))


@pytest.mark.parametrize("superblock", [-1, 3, 100, 512])
def test_a_superblock_that_is_no_power_of_two_is_refused(superblock):
    with pytest.raises(ValueError, match=f"superblock side {superblock}"):
        choose_grid(2048, 2048, superblock)


def test_a_superblock_larger_than_the_atlas_is_refused():
    with pytest.raises(ValueError, match="does not fit"):
        choose_grid(100, 2048, 128)


def test_a_bias_can_hold_the_samples_to_the_pixels_of_the_servers_view(scene):
    """As far as a bias does it: of fewer samples, and of an atlas with less room, nothing changes."""
    for complete in (False, True):
        near, usual = Stream(scene, bias="picture", complete=complete), Stream(scene, complete=complete)
        for step in range(3):
            frame = frame_of(scene, 1024, 1024, 4 * step)
            pixels = frame.server.width * frame.server.height
            payload, more = near.send(frame), usual.send(frame).sample_count
            assert near.violations(frame, payload) == []
            assert abs(payload.sample_count - min(pixels, more)) <= TOLERANCE * pixels
            assert (payload.statistics["bias"] > 0) == (more > (1 + TOLERANCE) * pixels)
    few = frame_of(scene, 1024, 1024, 0, frame.pvs[::20])
    small = frame_of(scene, 128, 128)
    for frame in (few, small):
        counts = [Stream(scene, bias=bias).send(frame).sample_count for bias in ("picture", "atlas")]
        assert abs(counts[0] - counts[1]) <= TOLERANCE * counts[1]
        assert counts[0] < frame.server.width * frame.server.height


def test_a_bias_fills_what_the_atlas_allows_and_stays(scene):
    """A bias that is a hundredth of a doubling smaller has no room; a set that hardly changes keeps it."""
    stream = Stream(scene)
    frame = frame_of(scene, 256, 256)
    bias = stream.send(frame).statistics["bias"]
    assert bias > 0
    budgeted = Stream(scene).send(replace(frame, sample_budget=10**6))
    assert abs(budgeted.statistics["bias"] - bias) <= 0.02
    one_less = frame_of(scene, 256, 256, 0, np.delete(frame.pvs, len(frame.pvs) // 2))
    assert stream.send(one_less).statistics["bias"] == bias
