"""SnakeBinning on a small room: valid with every switch, coherent, deterministic, and it looks right."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from shading_atlas_bench.harness.conformance.catalogue import CATALOGUE
from shading_atlas_bench.harness.conformance.trial import Stage, try_method, try_rasteriser
from shading_atlas_bench.harness.measure.validity import Gaps, check
from shading_atlas_bench.harness.workload.pvs import potentially_visible
from shading_atlas_bench.harness.workload.reference import ForwardRenderer
from shading_atlas_bench.harness.workload.session import open_session
from shading_atlas_bench.harness.workload.settings import Settings
from shading_atlas_bench.harness.workload.views import CellFrustum, Pose, client_view
from shading_atlas_bench.packers.interface import Frame, Payload, ServerScene, View
from shading_atlas_bench.packers.snakebinning import SnakeBinning
from shading_atlas_bench.packers.snakebinning.filling import STEPS, Filling, first_with_room
from shading_atlas_bench.packers.snakebinning.footprint import reference_views
from shading_atlas_bench.packers.snakebinning.freezing import Freezing
from shading_atlas_bench.packers.snakebinning.kernels.bins import HeightBins
from shading_atlas_bench.packers.snakebinning.kernels.footprint import Fit, Footprints, measure_triangles, pack_views
from shading_atlas_bench.packers.snakebinning.kernels.pieces import SlicedScene, TriangleList
from shading_atlas_bench.packers.snakebinning.kernels.slices import Slices
from shading_atlas_bench.packers.snakebinning.kernels.superblocks import STRIP, SUPERBLOCK, superblock_height
from shading_atlas_bench.packers.snakebinning.mapping import BinMapping
from shading_atlas_bench.packers.snakebinning.parameters import PARAMETERS, Parameters
from shading_atlas_bench.packers.snakebinning.records import decode_records, encode_records
from shading_atlas_bench.packers.snakebinning.statistics import _wasted
from shading_atlas_bench.scenes.model import Scene
from tests.packers import streams
from tests.packers.rooms import CELL, FOV, NEAR, SIZE, changing_sets, frame_of, novel_view, room, server_of, wall

Stream = partial(streams.Stream, SnakeBinning)


SWITCHES = [
    {},
    {"full_footprint": False},
    {"perspective": False},
    {"mapping": "hierarchical", "average_clear": True},
    {"mapping": "exact", "capacity": 0.0},
    {"logarithmic": False, "prediction_frames": 0},
    {"hysteresis": False, "freeze": 0.0},
    {"freeze": 0.5, "freeze_frames": 2, "remap_interval": 2},
    {"superblock_height": 128, "collapse": 0.9, "shrink": 0.9},
    {"assignment": "first", "shading_rate": 1.0},
    {"assignment": "next", "orphans": "found"},
]


@pytest.mark.parametrize("parameters", SWITCHES)
def test_a_walk_is_valid(scene, parameters):
    stream = Stream(scene, **parameters)
    for step in range(4):
        frame = frame_of(scene, 1024, 512, 3 * step)
        payload = stream.send(frame)
        assert stream.violations(frame, payload) == []
        assert payload.unplaced == {}
        found = payload.statistics
        wasted = [found[n] for n in ("wasted_in_slots", "wasted_row_ends", "wasted_in_superblocks", "unallocated")]
        assert payload.sample_count + sum(wasted) == 1024 * 512
        assert min(wasted[1:]) >= 0


def test_the_enlargement_of_the_paper_leaves_texels_unwritten(scene):
    stream = Stream(scene, enlarge="paper")
    frame = frame_of(scene, 1024, 512)
    rules = {violation.rule for violation in stream.violations(frame, stream.send(frame))}
    assert "written" in rules
    assert not rules & {"single owner", "inside", "placed", "alpha", "barycentrics"}


def test_the_client_sees_what_the_reference_shows(scene):
    stream = Stream(scene, shading_rate=1.0)
    stream.send(frame_of(scene, 2048, 1024))
    image = stream.client.draw(novel_view())
    reference, _ = ForwardRenderer(scene).draw(novel_view(), eye=frame_of(scene, 16, 16).server.eye)
    assert reference.triangle is not None
    assert (image.triangle.get() == reference.triangle.get()).mean() > 0.995
    error = np.abs(image.rgb.get().astype(int) - reference.rgb.get())
    assert error.mean() < 0.5
    empty = reference.triangle.get() < 0
    assert (error[empty & (image.triangle.get() < 0)] == 0).all()


def test_samples_follow_the_shading_rate_and_the_picture_follows_the_samples(scene):
    counts, errors = [], []
    reference, _ = ForwardRenderer(scene).draw(novel_view(), eye=frame_of(scene, 16, 16).server.eye)
    for rate in (0.2, 0.5, 1.0):
        stream = Stream(scene, shading_rate=rate, full_footprint=False)
        payload = stream.send(frame_of(scene, 2048, 1024))
        assert payload.statistics["shading_rate"] == rate
        counts.append(payload.sample_count)
        image = stream.client.draw(novel_view())
        errors.append(np.abs(image.rgb.get().astype(int) - reference.rgb.get()).mean())
    assert counts[0] < counts[1] < counts[2]
    assert errors[0] > errors[1] > errors[2]


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 1000), freeze=st.sampled_from([0.0, 0.05, 0.9]), side=st.sampled_from([16, 64, 200, 512]))
def test_any_sequence_of_sets_is_valid(scene, seed, freeze, side):
    """Sets that change a little, entirely, to nothing, to one triangle and back, in atlases that may be too small."""
    rng = np.random.default_rng(seed)
    stream = Stream(scene, freeze=freeze)
    for chosen in changing_sets(rng, scene.triangles.count, ["little", "all", "none", "one", "little", "little"], 0.03):
        frame = frame_of(scene, side, side, 0, chosen)
        payload = stream.send(frame)
        assert stream.violations(frame, payload) == []
        assert payload.sample_count <= side * side
        assert (len(payload.unplaced) > 0) <= (payload.statistics["shading_rate"] < 0.003)


def test_what_does_not_change_stays(scene):
    stream = Stream(scene)
    frame = frame_of(scene, 512, 512)
    first = stream.send(frame)
    second = stream.send(frame)
    assert second.planes["atlas"].get().tobytes() == first.planes["atlas"].get().tobytes()
    assert not any(second.blobs["places"])
    assert second.statistics["frozen_frames"] == 1
    assert second.statistics["triangles_moved"] == 0


def test_a_layout_stays_for_so_many_frames_and_while_less_than_its_share_is_new():
    freezing = Freezing(0.05, 8)
    over = []
    for freezing.frozen_frames in (0, 7, 8):
        over.append(freezing.is_over)
    assert over == [False, False, True]
    assert Freezing(0.0, 8).is_over
    for _ in range(2):
        freezing.restart(1000.0)
        assert not freezing.is_exceeded_by(49.0)
    assert freezing.is_exceeded_by(1.0)  # together 5 % of it
    freezing.restart(1000.0)
    assert not freezing.is_over


def test_bins_are_due_for_a_new_mapping_after_the_interval():
    mapping: Any = SimpleNamespace(interval=60, mapped_at=3)
    due = [BinMapping.is_due(mapping, frame) for frame in (3, 62, 63, 64)]
    assert due == [False, False, True, True]
    mapping.interval = 0
    assert not BinMapping.is_due(mapping, 1000)


def test_what_is_wasted_is_what_samples_slots_rows_and_superblocks_leave_over():
    """A superblock of 100 x 20 texels holds two rows of six slots of 50 texels, 4 lines high, with 550 samples."""
    strips, blocks = np.zeros(2, STRIP), np.zeros(1, SUPERBLOCK)
    strips[["superblock", "rows", "lines", "per_row", "texels"]] = [(0, 2, 4, 6, 50), (-1, 9, 9, 9, 9)]
    blocks[["width", "height"]] = [(100, 20)]
    assert _wasted(strips, blocks, 2500, 550) == {
        "wasted_in_slots": 2 * 6 * 50 - 550,
        "wasted_row_ends": 2 * 4 * 100 - 2 * 6 * 50,
        "wasted_in_superblocks": 100 * 20 - 2 * 4 * 100,
        "unallocated": 2500 - 100 * 20,
    }


@pytest.mark.parametrize("width", [512, 1024])
def test_rare_costs_come_within_the_frames_they_are_promised_for(scene, width):
    stream = Stream(scene, freeze=0.9, freeze_frames=1, remap_interval=4, mapping="exact")
    promised = {cost.counter: cost.frames for cost in stream.packer.rare_costs()}
    assert promised == {"resets": None, "remappings": 5, "rebuilds": 3}
    found = [stream.send(frame_of(scene, width, 512)).statistics for _ in range(5)]
    for counter, frames in promised.items():
        assert found[0][counter] == 0
        assert frames is None or found[frames - 1][counter] > 0
    if width == 1024:  # all has room at once, so nothing comes earlier
        assert [each["rebuilds"] for each in found] == [0, 0, 1, 1, 2]
        assert [each["remappings"] for each in found] == [0, 0, 0, 0, 1]


def test_the_published_enlargement_leaves_texels_unwritten_and_breaks_no_other_rule(scene):
    stream, frame = Stream(scene, enlarge="paper"), frame_of(scene, 1024, 512)
    owners = (payload := stream.send(frame)).owners()
    assert stream.packer.leaves_unwritten
    assert not SnakeBinning().leaves_unwritten
    gaps = Gaps()
    assert check(frame, payload, owners, stream.client, budget=None, gaps=gaps) == []
    assert gaps.share is not None
    assert 0.01 < gaps.share < 0.1
    assert "written" in {v.rule for v in stream.violations(frame, payload)}


def test_frozen_frames_move_nothing_and_add_what_is_new(scene):
    """The paper's freeze: all earlier triangles stay exactly in place, those of strips without spare slots too."""
    stream = Stream(scene, freeze=0.9, capacity=0.0)
    everything = frame_of(scene, 1024, 1024).pvs
    before, after = everything[np.arange(len(everything)) % 40 > 0], everything[np.arange(len(everything)) % 40 < 39]
    owners = stream.send(frame_of(scene, 1024, 1024, 0, before)).owners()
    payload = stream.send(frame_of(scene, 1024, 1024, 1, after))
    assert payload.statistics["frozen_frames"] == 1
    assert payload.statistics["outgrown"] > 0
    assert payload.statistics["triangles_moved"] == 0
    later = payload.owners()
    assert owners
    assert later
    for t in np.intersect1d(before, after):
        texels = [np.sort(found.texel[found.triangle == t]) for found in (owners, later)]
        np.testing.assert_array_equal(texels[0], texels[1])
    assert set(after) == set(later.triangle)


@pytest.mark.parametrize("name", ["hall", "village"])
def test_on_a_walk_nothing_moves_while_frozen(device, name):
    """Neither what stays in the set nor what leaves it and returns, although strips outgrow their room."""
    settings = Settings(methods=("sas",), scene=name, frames=12, width=320, height=180)
    session = open_session(settings, device)
    stream, seen = Stream(session.scene), np.empty(0, np.int32)
    placed: dict[int, int] = {}
    before = outgrown = 0.0
    frozen = returned = 0
    for step in range(session.frames):
        frame = session.source.work(step).frame
        payload = stream.send(frame)
        places = dict(zip(frame.pvs.tolist(), stream.client.records.words[frame.pvs, 0].tolist(), strict=True))
        if payload.statistics["frozen_frames"]:
            frozen += 1
            outgrown += payload.statistics["outgrown"] - before
            returned += len(set(places) & set(placed) - set(seen.tolist()))
            assert [t for t, place in places.items() if placed.get(t, place) != place] == []
            assert payload.statistics["triangles_moved"] == 0
        else:
            placed = {}
        placed |= places
        seen, before = frame.pvs, payload.statistics["outgrown"]
    assert frozen > 5
    assert outgrown > 0
    assert returned > 0


def test_a_rebuilt_frame_puts_triangles_in_primitive_order(scene):
    stream = Stream(scene, slicing=0.0)
    frame = frame_of(scene, 1024, 1024)
    stream.send(frame)
    slots = stream.packer.places.slots.get()[frame.pvs]
    for strip in np.unique(slots[:, 0]):
        np.testing.assert_array_equal(slots[slots[:, 0] == strip, 1], np.arange((slots[:, 0] == strip).sum()))


@pytest.mark.parametrize("side", [256, 96, 24])  # at full rate, at a lower one, and not all of it
@pytest.mark.parametrize(("local_size", "chunks"), [(1, 3), (7, 64), (256, 1000)])
def test_work_groups_and_chunks_change_no_byte(device, scene, side, local_size, chunks, monkeypatch):
    frames = [frame_of(scene, side, side, step) for step in (0, 1, 8)]

    def send_all() -> list[tuple]:
        stream = Stream(scene, mapping="hierarchical", average_clear=True)
        return [as_bytes(stream.send(frame)) for frame in frames]

    expected = send_all()
    monkeypatch.setattr(device, "local_size", local_size)
    monkeypatch.setattr(device, "chunks", chunks)
    assert send_all() == expected


def as_bytes(payload: Payload) -> tuple:
    return payload.planes["atlas"].get().tobytes(), payload.blobs["places"], payload.geometry, payload.statistics


def test_an_atlas_too_small_lowers_the_rate_to_the_largest_that_fits(scene):
    rates = []
    for side in (256, 128, 96):
        stream = Stream(scene)
        frame = frame_of(scene, side, side)
        payload = stream.send(frame)
        assert stream.violations(frame, payload) == []
        assert payload.unplaced == {}
        rates.append(payload.statistics["shading_rate"])
    assert 0.7 > rates[0] > rates[1] > rates[2]


def test_an_atlas_too_small_for_four_texels_each_names_the_rest(scene):
    stream = Stream(scene)
    pvs = np.arange(scene.triangles.count, dtype=np.int32)
    frame = frame_of(scene, 24, 24, 0, pvs)
    payload = stream.send(frame)
    assert 0 < payload.sample_count <= 576
    assert 0 < len(payload.unplaced) < len(pvs)
    assert stream.violations(frame, payload) == []
    image = stream.client.draw(novel_view())
    assert not np.isin(image.triangle.get(), list(payload.unplaced)).any()


def test_more_equal_triangles_than_a_superblock_holds_lie_in_parts(device):
    """Everything is in one strip, and that larger than a superblock."""
    positions, indices = wall((-1, -0.5, -2), (2, 0, 0), (0, 1, 0), 70, 70, 0)
    surface = surface_of(positions.astype(np.float32), indices.astype(np.int32))
    scene = server_of(device, replace(room(), **surface))
    everything = np.arange(scene.triangles.count, dtype=np.int32)
    for height in (0, 128):
        stream = Stream(scene, shading_rate=0.05, superblock_height=height)
        for step in range(2):
            frame = frame_of(scene, 96, 1024, step, everything)
            payload = stream.send(frame)
            assert stream.violations(frame, payload) == []
            assert payload.unplaced == {}
            assert stream.packer.filling
            strips = stream.packer.filling.slots.superblocks.live_strips()
            assert len(strips) > len(np.unique(strips["bin"]))


def spheres(rows: int, rings: int) -> Scene:
    """rows^2 spheres of 4 rings^2 triangles each, all alike, in a wall two units before the camera."""
    polar, around = np.meshgrid(
        np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, 2 * rings + 1), indexing="ij"
    )
    ball = np.stack([np.sin(polar) * np.cos(around), np.cos(polar), np.sin(polar) * np.sin(around)], axis=2).reshape(
        -1, 3
    )
    corner = (np.arange(rings)[:, None] * (2 * rings + 1) + np.arange(2 * rings)).reshape(-1, 1)
    faces = (corner + np.array([[0, 1, 2 * rings + 1, 1, 2 * rings + 2, 2 * rings + 1]])).reshape(-1, 3)
    middles = np.stack(np.meshgrid(*2 * [(np.arange(rows) - (rows - 1) / 2) / rows]), axis=2).reshape(-1, 1, 2)
    positions = np.concatenate([middles, np.zeros((rows * rows, 1, 1))], axis=2) * 2 + 0.9 / rows * ball
    indices = np.arange(rows * rows).reshape(-1, 1, 1) * len(ball) + faces
    return replace(
        room(), **surface_of(positions.reshape(-1, 3).astype(np.float32), indices.reshape(-1, 3).astype(np.int32))
    )


@pytest.fixture(scope="module")
def alike(device) -> ServerScene:
    """73 984 triangles, more than the texels of an atlas of 256 x 256."""
    return server_of(device, spheres(17, 8))


def screen_areas(frame: Frame) -> np.ndarray:
    """Of the triangles of a frame's set, in pixels of the server's view, each seen by a camera turned to it."""
    device, scene, count = frame.scene.device, frame.scene.triangles, len(frame.pvs)
    view, fit = frame.server, Fit(HeightBins(511.0), 1e4, near_height=-1, point=1e9)
    sliced = SlicedScene(scene, Slices().upload(device, scene.count))
    views = pack_views([(view.view, view.projection, view.width)], 1.0)
    fresh = Footprints.allocate(device, scene.count)
    return measure_triangles(device, TriangleList(frame.pvs_device, count), sliced, views, fit, fresh)[1]


@settings(max_examples=5, deadline=None)
@given(width=st.integers(256, 1024), height=st.integers(256, 1024), seed=st.integers(0, 100))
@example(width=256, height=256, seed=0)
def test_nothing_is_lost_in_a_full_atlas_and_the_largest_come_first(alike, width, height, seed):
    """A set of any size, and then one that has changed a little."""
    rng, stream = np.random.default_rng(seed), Stream(alike)
    chosen = rng.random(alike.triangles.count) < (1.0 if seed == 0 else rng.uniform(0.3, 1))
    for step in range(2):
        frame = frame_of(alike, width, height, step, np.flatnonzero(chosen).astype(np.int32))
        payload = stream.send(frame)
        assert stream.violations(frame, payload) == []
        owners = payload.owners()
        assert owners
        placed, left = np.unique(owners.triangle), np.array(sorted(payload.unplaced), np.int32)
        np.testing.assert_array_equal(np.sort(np.concatenate([placed, left])), frame.pvs)
        assert len(left) == max(0, len(frame.pvs) - width * height) or step > 0
        if step == 0 and len(left):
            areas = screen_areas(frame)
            lost = np.isin(frame.pvs, left)
            assert areas[~lost].min() >= 0.999 * areas[lost].max()
            assert areas[lost].max() < 0.5
        chosen ^= rng.random(len(chosen)) < 0.01


def test_triangles_below_two_texels_get_one_before_the_rate_falls(alike):
    everything = np.arange(alike.triangles.count, dtype=np.int32)
    texels, found = alike.triangles.count, []
    for side in (2048, 800, 300):
        stream, frame = Stream(alike), frame_of(alike, side, side, 0, everything)
        payload = stream.send(frame)
        assert stream.violations(frame, payload) == []
        assert payload.unplaced == {}
        found.append((payload.statistics["shading_rate"], payload.statistics["points"]))
    assert found[0] == (0.7, 0)
    assert found[1][0] == 0.7
    assert found[2][0] < 0.7
    assert 0.3 * texels < found[1][1] < found[2][1] <= texels


def test_a_full_atlas_is_searched_once_and_then_stays(alike, monkeypatch):
    """Filled so often: when it is new, in frames that are frozen, in one that is not, and with 1% of the set new."""
    filled = []
    settle = Filling._settle

    def counted(*known):
        filled.append(known)
        return settle(*known)

    monkeypatch.setattr(Filling, "_settle", counted)
    stream, few = Stream(alike, freeze_frames=2), np.arange(alike.triangles.count) % 100
    numbers = []
    for step, kept in enumerate((few < 99, few < 99, few > 0, few > 0)):
        filled.clear()
        payload = stream.send(frame_of(alike, 256, 256, 0, np.flatnonzero(kept).astype(np.int32)))
        numbers.append(len(filled))
        assert payload.statistics["frozen_frames"] == (0, 1, 2, 0)[step]
        assert step not in (1, 2) or payload.statistics["triangles_moved"] == 0
        assert len(payload.unplaced) == (len(few[kept]) - 256 * 256 if step in (0, 3) else len(payload.unplaced))
    assert numbers[0] < 14
    assert numbers[1:] == [0, 0, 2]


@given(first=st.integers(0, STEPS), too_full=st.integers(-1, STEPS - 2), start=st.integers(0, STEPS - 1))
def test_the_first_step_with_room_is_found_and_each_step_tried_once(first, too_full, start):
    tried = []

    def has_room(step: int) -> bool:
        tried.append(step)
        return step >= first

    found = first_with_room(has_room, too_full, start)
    assert found == max(first, too_full + 1)
    assert len(tried) == len(set(tried)) <= 14
    assert found in [*tried, STEPS]


def test_parameters_have_types():
    assert list(Parameters.__annotations__) == list(PARAMETERS)


def test_an_atlas_that_is_full_again_soon_gets_a_step_with_more_room(scene):
    """At the first step that holds each set by itself this walk, which turns by 4 degrees a frame, has 8 resets."""
    stream = Stream(scene)
    found = [stream.send(frame_of(scene, 512, 250, 2 * step)).statistics for step in range(14)]
    assert found[-1]["resets"] <= 4
    assert found[-1]["shading_rate"] > 0.4


def test_searching_a_rate_brings_no_mapping_earlier(scene):
    stream, frame = Stream(scene, freeze=0.0, remap_interval=5), frame_of(scene, 96, 96)
    found = [stream.send(frame).statistics["remappings"] for _ in range(7)]
    assert found == [0, 0, 0, 0, 0, 1, 1]


def test_a_smaller_set_gets_the_full_rate_back(scene):
    stream = Stream(scene, remap_interval=2)
    pvs = frame_of(scene, 128, 128).pvs
    assert stream.send(frame_of(scene, 128, 128, 0, pvs)).statistics["shading_rate"] < 0.7
    few = pvs[-3:]
    rates = [stream.send(frame_of(scene, 128, 128, 0, few)).statistics["shading_rate"] for _ in range(4)]
    assert rates[-1] > 0.7 * 2**-2


@given(st.integers(0, 2**32 - 1), st.integers(1, 50))
def test_records_survive_coding(seed, count):
    rng = np.random.default_rng(seed)
    mask = np.array([2**32 - 1, 2**32 - 1, 2**16 - 1, 2**32 - 1], np.uint32)
    before, now = (rng.integers(0, 2**32, (count, 4), dtype=np.uint32) & mask for _ in range(2))
    data = encode_records(now, before)
    assert len(data) == 14 * count
    np.testing.assert_array_equal(decode_records(data, count) ^ before, now)


def low_frame(scene: ServerScene, step: int, width: int = 1024) -> tuple[Frame, View]:
    """Close above the floor of the room, which is two triangles; and the client's view."""
    pose = Pose(np.array([0.02 * step, -1.2, 1.5]), np.array([np.sin(-0.3), 0, 0, np.cos(-0.3)]))
    frustum, client = CellFrustum.around(CELL, FOV, *SIZE), client_view(pose, FOV, *SIZE, NEAR)
    pvs = potentially_visible(scene, pose, CELL.radius, frustum, NEAR, 2.0).ids
    server = frustum.server_view(pose, NEAR)
    known = (CELL.radius, CELL.fov, pvs, scene.device.upload(pvs), (client,), width, width)
    return Frame(step, scene, server, *known), client


def test_a_triangle_that_fills_the_screen_is_sliced(scene):
    """Valid, no holes, and closer to the reference than the same triangle whole."""
    errors = {}
    for share in (0.25, 0.0):
        stream = Stream(scene, slicing=share)
        for step in range(3):
            frame, client = low_frame(scene, step)
            payload = stream.send(frame)
            assert stream.violations(frame, payload) == []
            assert (payload.statistics["pieces"] > 3 * payload.statistics["sliced"] > 0) == (share > 0)
        image = stream.client.draw(client)
        reference, _ = ForwardRenderer(scene).draw(client, eye=frame.server.eye)
        assert reference.triangle is not None
        assert (image.triangle.get() == reference.triangle.get()).mean() > 0.999
        errors[share] = np.abs(image.rgb.get().astype(int) - reference.rgb.get()).mean()
    assert errors[0.25] < errors[0.0]


def test_slivers_along_the_view_are_sampled_where_they_are_looked_up(device):
    """Hundreds of texels long, one high, and several times further away at one end."""
    near, far = (values.ravel() for values in np.mgrid[-0.8:0.8:12j, -4.0:4.0:12j])
    ends = np.stack([near, np.full_like(near, -0.3), np.full_like(near, 0.6)], axis=1)
    tips = np.stack([far, np.full_like(far, 2.0), np.full_like(far, -4.0)], axis=1)
    positions = np.stack([ends, ends + np.array([3e-4, 1.5e-4, 0]), tips], axis=1).reshape(-1, 3).astype(np.float32)
    indices = np.arange(len(positions), dtype=np.int32).reshape(-1, 3)
    slivers = server_of(device, replace(room(), **surface_of(positions, indices)))
    stream = Stream(slivers, prediction_frames=0)
    frame = frame_of(slivers, 2048, 1024, 0, np.arange(len(indices), dtype=np.int32))
    payload = stream.send(frame)
    assert stream.violations(frame, payload) == []


def surface_of(positions: np.ndarray, indices: np.ndarray) -> dict[str, Any]:
    """The arrays of a scene that is only these triangles."""
    count = len(positions)
    return {
        "positions": positions,
        "indices": indices,
        "normals": np.tile(np.array([0, 1, 0], np.float32), (count, 1)),
        "uvs": np.zeros((count, 2), np.float32),
        "colours": np.ones((count, 4), np.float32),
        "material_ids": np.zeros(len(indices), np.int32),
        "content_hash": "slivers",
    }


@pytest.mark.parametrize("screens", [1e5, 3e5])  # of more, the last bits of a camera decide what either shows
def test_a_triangle_of_many_screens_is_as_good_as_its_barycentrics(device, screens):
    """The client's picture is little worse than the rasteriser's, which has the same float32 barycentrics."""
    stage = Stage.of(device, CATALOGUE["screen-filling"].make(screens))
    found = try_method(stage, SnakeBinning, again=0)
    assert found.good, found.sentence
    rasterised = try_rasteriser(stage)
    assert found.error is not None
    assert rasterised.error is not None
    assert found.error < rasterised.error + 0.02


def test_slices_in_a_tiny_atlas(scene):
    stream = Stream(scene)
    for step, side in ((0, 48), (1, 48)):
        frame, _ = low_frame(scene, step, side)
        payload = stream.send(frame)
        assert stream.violations(frame, payload) == []
        assert payload.statistics["sliced"] > 0


def test_slices_that_an_atlas_has_no_room_for_are_left_out(scene):
    """A triangle of which a piece is left out is there as a whole, or not at all."""
    stream = Stream(scene)
    frame, _ = low_frame(scene, 0, 4)
    payload = stream.send(frame)
    assert stream.violations(frame, payload) == []
    filling = stream.packer.filling
    assert filling
    slicing, left_out = filling.footprints.slicing, filling.left_out
    pieces = slicing.first + np.arange(len(slicing.slices.parents))
    parents = slicing.slices.parents[left_out[pieces]]
    assert len(parents)
    assert set(parents) <= set(payload.unplaced)


def test_steps_of_a_full_atlas_spare_a_tenth_then_nothing(scene, monkeypatch):
    stream, frame, seen = Stream(scene, capacity=0.5), frame_of(scene, 2048, 2048), []
    stream.send(frame)
    filling = stream.packer.filling
    assert filling
    empty = filling.slots.empty

    def noted(atlas):
        seen.append(atlas.capacity)
        empty(atlas)

    monkeypatch.setattr(filling.slots, "empty", noted)
    assert all(filling.fill(frame, step) for step in (0, 1, STEPS - 2, STEPS - 1))
    assert seen == [1.5, 1.1, 1.1, 1.0]


def test_a_budget_is_met_by_the_rate_not_by_a_lowered_layout(scene):
    """Also where what a full atlas holds at a lowered step happens to be the budget."""
    side = 48
    full = Stream(scene, shading_rate=4.0)
    count = full.send(frame_of(scene, side, side)).sample_count
    assert full.packer.filling
    assert full.packer.filling.step > 1
    stream = Stream(scene, shading_rate=4.0)
    frame = replace(frame_of(scene, side, side), sample_budget=count)
    payload = stream.send(frame)
    assert stream.packer.filling
    assert stream.packer.filling.step <= 1
    assert payload.statistics["shading_rate"] == pytest.approx(stream.packer.filling.budgeted.rate)


def test_the_picture_of_the_packing_shows_every_texel_once(scene):
    stream = Stream(scene)
    payload = stream.send(frame_of(scene, 512, 256))
    picture = stream.packer.pictures(payload)["packing"]
    assert picture.shape == (256, 512, 3)
    owned = payload.planes["atlas"].get()[..., 3] > 0
    assert (picture[owned].min(axis=1) >= 40).all()
    assert stream.packer.filling
    live = stream.packer.filling.slots.superblocks.live_superblocks()
    outside = np.ones((256, 512), bool)
    for block in live:
        outside[block["y"] : block["y"] + 256, block["x"] : block["x"] + block["width"]] = False
    assert (picture[outside] == 0).all()


def test_predicted_views_are_evenly_spaced(scene):
    frame = frame_of(scene, 64, 64)
    assert reference_views(frame, 3)[0] is frame.server
    views = tuple(novel_view(k) for k in range(3))
    frame = Frame(**{**frame.__dict__, "predicted": views})
    for count, expected in ((1, [2]), (2, [1, 2]), (9, [0, 1, 2])):
        chosen = reference_views(frame, count)
        assert [[view is other for other in views].index(True) for view in chosen] == expected
    assert reference_views(frame, 0)[0] is frame.server


@pytest.mark.parametrize(
    ("size", "height", "chosen"), [((2048, 2048), 0, 512), ((512, 256), 0, 256), ((64, 64), 32, 32)]
)
def test_superblocks_follow_the_atlas(size, height, chosen):
    assert superblock_height(size[0], size[1], height) == chosen


@pytest.mark.parametrize(("size", "height"), [((9000, 100), 0), ((100, 100), 101), ((100, 1), 0), ((64, 64), 1)])
def test_sizes_that_cannot_be_used_are_refused(size, height):
    with pytest.raises(ValueError, match=r"outside 2 to"):
        superblock_height(size[0], size[1], height)
