"""Tessellated Shading Streaming on a small room: valid, deterministic, honest about its bytes, and it looks right."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shading_atlas_bench.harness.workload.reference import ForwardRenderer
from shading_atlas_bench.packers.interface import Payload
from shading_atlas_bench.packers.tss import TessellatedShadingStreaming
from shading_atlas_bench.packers.tss.kernels.forms import OVERSAMPLED
from shading_atlas_bench.packers.tss.placement import find_lost
from tests.packers import streams
from tests.packers.rooms import frame_of, novel_view

Stream = partial(streams.Stream, TessellatedShadingStreaming, budget=None)


@pytest.mark.parametrize("strategy", ["combined", "lpacking", "oversampling"])
@pytest.mark.parametrize("side", [1024, 300])
def test_a_walk_is_valid(scene, strategy, side):
    stream = Stream(scene, strategy=strategy)
    for step in (0, 7):
        frame = frame_of(scene, side, side // 2, step)
        payload = stream.send(frame)
        assert stream.violations(frame, payload) == []
        assert payload.unplaced == {}
        assert payload.statistics["scale"] <= 1


def test_strategies_use_what_they_say(scene):
    frame = frame_of(scene, 1024, 1024)
    found = {name: Stream(scene, strategy=name).send(frame).statistics for name in ("lpacking", "oversampling")}
    assert found["lpacking"]["oversampling_primitives"] == found["oversampling"]["lpacking_primitives"] == 0
    both = Stream(scene).send(frame).statistics
    assert min(both["lpacking_primitives"], both["oversampling_primitives"]) > 50
    fewer = Stream(scene, slanted=30.0).send(frame).statistics
    assert fewer["oversampling_primitives"] < both["oversampling_primitives"]


@pytest.mark.parametrize("strategy", ["combined", "lpacking", "oversampling"])
def test_the_client_sees_what_the_reference_shows(scene, strategy):
    stream = Stream(scene, strategy=strategy)
    stream.send(frame_of(scene, 1024, 1024))
    image = stream.client.draw(novel_view())
    reference, _ = ForwardRenderer(scene).draw(novel_view(), eye=frame_of(scene, 16, 16).server.eye)
    assert reference.triangle is not None
    assert (image.triangle.get() == reference.triangle.get()).mean() > 0.995
    assert np.abs(image.rgb.get().astype(int) - reference.rgb.get()).mean() < 2.0


def test_the_client_draws_where_it_locates(scene):
    """Colours drawn (float32, on the device) are those of the atlas at `locate` (float64)."""
    stream = Stream(scene)
    payload = stream.send(frame_of(scene, 1024, 1024))
    plane = payload.planes["atlas"].get().astype(float)
    triangles = np.repeat(stream.client.geometry.pvs, 4)
    bary = np.random.default_rng(0).dirichlet([1, 1, 1], len(triangles))[:, 1:].astype(np.float32)
    place = stream.client.locate(triangles, bary) - 0.5
    base, fraction = np.floor(place).astype(int), place - np.floor(place)
    colour = sum(
        np.where([dx, dy], fraction, 1 - fraction).prod(axis=1)[:, None] * plane[base[:, 1] + dy, base[:, 0] + dx]
        for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1))
    )
    assert (np.abs(colour[:, 3] - 255) < 1).all()


@settings(max_examples=4, deadline=None)
@given(
    seed=st.integers(0, 1000),
    side=st.sampled_from([16, 64, 200, 512]),
    strategy=st.sampled_from(["combined", "oversampling"]),
)
def test_any_sequence_of_sets_is_valid(scene, seed, side, strategy):
    rng = np.random.default_rng(seed)
    stream = Stream(scene, strategy=strategy)
    count = scene.triangles.count
    for share in rng.permutation([0.0, 0.02, 0.4, 1.0]):
        frame = frame_of(scene, side, side, 0, np.flatnonzero(rng.random(count) < share).astype(np.int32))
        payload = stream.send(frame)
        assert stream.violations(frame, payload) == []
        assert (len(payload.unplaced) > 0) <= (payload.statistics["scale"] < 1e-3)


def test_an_atlas_too_small_for_one_texel_each_names_the_rest(scene):
    stream = Stream(scene)
    pvs = np.arange(scene.triangles.count, dtype=np.int32)
    frame = frame_of(scene, 16, 16, 0, pvs)
    payload = stream.send(frame)
    assert len(pvs) > 256 >= payload.sample_count > 200
    assert len(payload.unplaced) >= len(pvs) - 256
    assert stream.violations(frame, payload) == []
    assert not np.isin(stream.client.draw(novel_view()).triangle.get(), list(payload.unplaced)).any()


def test_statistics_add_up(scene):
    payload = Stream(scene).send(frame_of(scene, 1024, 1024))
    found = payload.statistics
    by_kind = ("single_texels", "lpacking_samples", "oversampling_inside", "oversampling_outside")
    assert sum(found[name] for name in by_kind) == payload.sample_count
    kinds = ("single_texels", "lpacking_primitives", "oversampling_primitives")
    assert sum(found[name] for name in kinds) == found["primitives"]
    assert sum(found[f"level_{1 << k}"] for k in range(7)) == found["lpacking_primitives"]
    assert found["lpacking_bytes"] == 4 * (found["single_texels"] + found["lpacking_primitives"])
    assert found["oversampling_bytes"] == 16 * found["oversampling_primitives"]
    assert 0.15 < found["oversampling_outside_share"] < 0.45
    assert found["split_triangles"] < found["pieces"]


def test_a_triangle_is_there_as_a_whole_or_not_at_all():
    """Rows: form, height, texels before and behind the foot; places of the parts; whose primitive it is."""
    placed_l, lost_l = ((9, 0, 0, 0), (5, -1), 0), ((9, 0, 0, 0), (-1, -1), 1)
    both, first, second = (((OVERSAMPLED, 3, 4, 4), (3, 4), 2), ((OVERSAMPLED, 3, 4, 0), (7, -1), 3),
                           ((OVERSAMPLED, 3, 0, 4), (-1, 8), 4))  # fmt: skip
    lacking = [((OVERSAMPLED, 3, 4, 4), (7, -1), 5), ((OVERSAMPLED, 3, 4, 4), (-1, 7), 6)]
    sibling = ((9, 0, 0, 0), (6, -1), 5)
    rows = [placed_l, lost_l, both, first, second, *lacking, sibling]
    forms, places, parents = (np.array(part, np.int32) for part in zip(*rows, strict=True))
    kept = places.copy()
    placement: Any = SimpleNamespace(forms=forms, places=places)
    assert find_lost(placement, parents).tolist() == [1, 5, 6]
    kept[[1, 5, 6, 7]] = -1
    np.testing.assert_array_equal(places, kept)


def as_bytes(payload: Payload) -> tuple:
    return payload.planes["atlas"].get().tobytes(), payload.blobs, payload.geometry, payload.statistics


@pytest.mark.parametrize("order", ["primitive", "arrival"])
@pytest.mark.parametrize(("local_size", "chunks"), [(7, 3), (256, 1000)])
def test_work_groups_and_chunks_change_no_byte(device, scene, order, local_size, chunks, monkeypatch):
    frame = frame_of(scene, 256, 256)
    expected = as_bytes(Stream(scene, order=order).send(frame))
    monkeypatch.setattr(device, "local_size", local_size)
    monkeypatch.setattr(device, "chunks", chunks)
    assert as_bytes(Stream(scene, order=order).send(frame)) == expected


def test_arrival_shuffles_every_frame_and_changes_no_sample(scene):
    frames = [frame_of(scene, 512, 512), frame_of(scene, 512, 512, 1)]
    stream, ordered = Stream(scene, order="arrival"), Stream(scene)
    first, plain = stream.send(frames[0]), ordered.send(frames[0])
    assert stream.violations(frames[0], first) == []
    assert first.statistics | {"metadata_bytes": 0} == plain.statistics | {"metadata_bytes": 0}
    count = first.sample_count
    assert first.samples
    assert plain.samples
    np.testing.assert_array_equal(first.samples.bary1.get()[:count], plain.samples.bary1.get()[:count])
    assert (first.samples.texel.get() != plain.samples.texel.get()).mean() > 0.5


def test_a_picture_shows_every_sample_in_its_strategy(scene):
    stream = Stream(scene)
    payload = stream.send(frame_of(scene, 512, 256))
    picture = stream.packer.pictures(payload)["strategies"]
    assert picture.shape == (256, 512, 3)
    assert picture.any(axis=2).sum() == payload.sample_count
    blue = (picture[..., 2] > picture[..., 1]).sum()
    found = payload.statistics
    assert blue == found["oversampling_inside"] + found["oversampling_outside"]
    yellow = (picture[..., 0] > picture[..., 1]).sum()
    assert yellow == found["single_texels"]


@pytest.mark.parametrize("values", [{"strategy": "none"}, {"order": "random"}])
def test_unknown_values_are_refused(values):
    with pytest.raises(ValueError, match="is not known"):
        TessellatedShadingStreaming(**values)


def test_the_scale_hardly_depends_on_earlier_frames(scene):
    """Small changes of the set leave it as it is, with as many samples as another one would give within 5 %."""
    stream = Stream(scene)
    sets = [frame_of(scene, 200, 200).pvs[::k] for k in (1, 40, 2, 1)]
    scales = [stream.send(frame_of(scene, 200, 200, 0, pvs)).statistics["scale"] for pvs in sets]
    alone = [Stream(scene).send(frame_of(scene, 200, 200, 0, pvs)).statistics["scale"] for pvs in sets]
    np.testing.assert_allclose(scales, alone, rtol=0.05)
    one_less = frame_of(scene, 200, 200, 0, np.delete(sets[0], len(sets[0]) // 2))
    assert stream.send(one_less).statistics["scale"] == scales[-1]


@pytest.mark.parametrize("side", [200, 300])
def test_the_scale_is_the_largest_that_fits(scene, side):
    """A budget of two hundredths more samples has no room."""
    frame = frame_of(scene, side, side)
    stream = Stream(scene)
    found = stream.send(frame)
    assert found.statistics["scale"] < 1
    more = replace(frame, sample_budget=round(1.06 * found.sample_count))
    assert Stream(scene).send(more).sample_count < 1.05 * found.sample_count


def test_a_picture_of_the_clients_size_has_fewer_texels_per_pixel(scene):
    frame = frame_of(scene, 1024, 1024)
    server = frame.server
    frame = replace(frame, predicted=(replace(server, width=server.width // 2, height=server.height // 2),))
    dense, sized = Stream(scene).send(frame), Stream(scene, picture="size").send(frame)
    assert (dense.statistics["scale"], sized.statistics["scale"]) == (1, 0.5)
    assert sized.sample_count < dense.sample_count / 2
