"""Per-pixel linked lists end to end: exact where nothing moved, honest about bytes, failing where the thesis does."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from shading_atlas_bench.harness.workload.frames import FrameSource
from shading_atlas_bench.harness.workload.reference import ForwardRenderer
from shading_atlas_bench.harness.workload.settings import Settings
from shading_atlas_bench.harness.workload.upload import upload_scene
from shading_atlas_bench.kernels.triangles import Triangles
from shading_atlas_bench.packers.interface import Decoded, Frame, Payload, ServerScene
from shading_atlas_bench.packers.ppll import PerPixelLinkedLists
from shading_atlas_bench.packers.ppll.statistics import describe
from shading_atlas_bench.packers.ppll.views import list_views
from shading_atlas_bench.packers.ppll.wire import decode
from shading_atlas_bench.scenes.features import find_features
from shading_atlas_bench.scenes.head_motion import HeadMotion
from shading_atlas_bench.scenes.model import Light, Material, Scene
from shading_atlas_bench.scenes.paths import make_path
from shading_atlas_bench.scenes.shells import make_shells
from tests.packers.rooms import CELL, FOV, SIZE, frame_of, novel_view, pose_at, room, server_of


@pytest.fixture(scope="module")
def opaque(device) -> ServerScene:
    return server_of(device, room())


@pytest.fixture(scope="module")
def glass(device) -> ServerScene:
    """The room with half of its triangles blended."""
    scene = room()
    rng = np.random.default_rng(1)
    scene.materials.append(Material(base_colour=(0.9, 0.8, 0.7, 0.4), alpha_mode="blend", double_sided=True))
    scene.material_ids = (rng.random(scene.triangle_count) < 0.5).astype(np.int32)
    scene.features = find_features(scene)
    scene.content_hash = "glass room"
    return server_of(device, scene)


def frame(scene: ServerScene, step: float = 0) -> Frame:
    """A frame whose predicted client view is at the server's own pose."""
    from shading_atlas_bench.harness.workload.views import client_view

    made = frame_of(scene, 64, 64, step)
    return replace(made, predicted=(client_view(pose_at(step), FOV, *SIZE, 0.02),))


class Stream:
    """A packer and its client over some frames."""

    def __init__(self, scene: ServerScene, **parameters) -> None:
        self.packer = PerPixelLinkedLists(**parameters)
        self.packer.prepare(scene)
        self.client = self.packer.client(scene.shipped)

    def send(self, frame: Frame) -> Payload:
        payload = self.packer.pack(frame)
        self.client.receive(Decoded({}, payload.blobs, payload.geometry, payload.lists))
        return payload

    def layers(self, payload: Payload) -> np.ndarray:
        """How many fragments each pixel of node 0 was sent, (h, w)."""
        return self.packer.details(payload)["header"][..., 1]


def rgb(image) -> np.ndarray:
    return image.rgb.get()[..., :3].astype(int)


@pytest.mark.parametrize("name", ["opaque", "glass"])
@pytest.mark.parametrize(
    "parameters", [{}, {"mode": "full"}, {"mode": "full", "layout": "shuffled", "nodes": 3}, {"mode": "difference"}]
)
def test_at_the_servers_pose_the_client_sees_the_reference(request, name, parameters):
    """Equal within a level but where float rounding moves an edge across a pixel's centre."""
    scene = request.getfixturevalue(name)
    made = frame(scene)
    stream = Stream(scene, **parameters)
    stream.send(made)
    client = made.predicted[0]
    reference, visibility = ForwardRenderer(scene).draw(client, eye=made.server.eye)
    known = np.isin(visibility.triangle.get(), np.append(made.pvs, -1))
    error = np.abs(rgb(stream.client.draw(client)) - rgb(reference)).max(axis=-1)
    assert (error[known] > 1).mean() < 0.002


@pytest.mark.parametrize("name", ["opaque", "glass"])
def test_a_novel_view_comes_close(request, name):
    scene = request.getfixturevalue(name)
    stream = Stream(scene, mode="full")
    made = frame(scene)
    stream.send(made)
    image = stream.client.draw(novel_view())
    reference, _ = ForwardRenderer(scene).draw(novel_view(), eye=made.server.eye)
    assert image.depth is not None
    assert reference.triangle is not None
    holes = (image.depth.get() == 0) & (reference.triangle.get() >= 0)
    assert holes.mean() < 0.005
    assert np.abs(rgb(image) - rgb(reference)).mean() < 4


def test_list_views_have_the_clients_pixels(opaque):
    made = frame(opaque)
    (view,), client = list_views(made), made.predicted[0]
    assert view.width >= made.server.width
    assert (view.width - client.width) % 2 == (view.height - client.height) % 2 == 0
    assert view.pixels_per_tangent == pytest.approx(client.pixels_per_tangent, rel=1e-12)
    assert list_views(replace(made, predicted=())) == (made.server,)


def test_payload_counts_what_the_thesis_counts(glass):
    stream = Stream(glass, mode="full")
    payload = stream.send(frame(glass))
    (message,) = decode(payload.blobs["head"], payload.lists["lists"])
    (offsets, rows), pixels = message.nodes[0], message.width * message.height
    assert payload.raw_bytes == 4 * pixels + 12 * len(rows) == len(payload.lists["lists"])
    assert payload.sample_count == payload.statistics["fragments_sent"] == len(rows)
    details = stream.packer.details(payload)
    header = details["header"]
    assert header.shape == (message.height, message.width, 2)
    np.testing.assert_array_equal(header[..., 1].ravel(), np.diff(offsets))
    np.testing.assert_array_equal(details["fragments"], rows)
    counted = sum(v for k, v in payload.statistics.items() if k.startswith("pixels_of"))
    assert counted == pixels
    depth = rows[:, 1].copy().view(np.float32)
    pixel = np.repeat(np.arange(pixels), np.diff(offsets))
    assert (np.diff(depth)[np.diff(pixel) == 0] <= 0).all()


def test_statistics_are_sums_over_views_and_nodes():
    """Two nodes with lists of up to 18 fragments, and the heads of two views."""
    layers = np.zeros(19, np.int64)
    layers[[0, 2, 18]] = 15, 4, 1
    nodes: Any = [
        SimpleNamespace(built=26, pixels_by_layers=layers, lists=SimpleNamespace(count=20)),
        SimpleNamespace(built=14, pixels_by_layers=np.array([12, 2, 6]), lists=SimpleNamespace(count=9)),
    ]
    heads: Any = [
        SimpleNamespace(counts=(5, 2), header_bytes=120, raw_bytes=204, padded_bytes=232),
        SimpleNamespace(counts=(3, 0), header_bytes=120, raw_bytes=156, padded_bytes=168),
    ]
    found = describe(nodes, heads, 4)
    counted = {name: value for name, value in found.items() if name.startswith("pixels_of") and value}
    assert counted == {"pixels_of_0_layers": 27, "pixels_of_1_layers": 2, "pixels_of_2_layers": 10,
                       "pixels_of_more_layers": 1}  # fmt: skip
    assert found["most_layers"] == 18
    names = ("built", "kept", "sent", "deleted")
    assert [found[f"fragments_{name}"] for name in names] == [40, 29, 10, 4]
    assert found["share_saved"] == 0.75
    assert [found[f"{name}_bytes"] for name in ("header", "list", "padded")] == [240, 120, 400]


def test_limits_bound_bytes_and_layers(glass):
    """Equations 3.3 and 3.4."""
    made = frame(glass)
    sizes = []
    for layers in (1, 2, 4):
        stream = Stream(glass, mode="depth-limited", layers=layers)
        payload = stream.send(made)
        assert stream.layers(payload).max() <= layers
        (view,) = list_views(made)
        pixels = view.width * view.height
        assert 4 * pixels <= payload.raw_bytes <= pixels * (4 + 12 * layers)
        sizes.append(payload.raw_bytes)
    full = Stream(glass, mode="full").send(made)
    assert sizes == sorted(sizes)
    assert sizes[-1] < full.raw_bytes


def test_opaque_scenes_send_one_fragment_when_limited(opaque, device):
    stream = Stream(opaque, mode="depth-limited")
    with device.record() as record:
        payload = stream.send(frame(opaque))
    assert stream.layers(payload).max() == 1
    assert not any("opacity" in name for name in record.launches)


def test_opaque_references_blend_nothing(opaque, glass, device):
    launched = {}
    for scene in (opaque, glass):
        with device.record() as record:
            ForwardRenderer(scene).draw(novel_view())
        launched[scene.host.content_hash] = {name for name in record.launches if "layers" in name}
    assert launched[opaque.host.content_hash] == set()
    assert len(launched["glass room"]) > 5


def test_the_blended_reference_is_that_of_sorted_lists(glass):
    """The reference's picture against a float64 blend of the packer's own lists, whose colours are the same."""
    from shading_atlas_bench.kernels.fragments.blend import blend_twin

    made = frame(glass)
    view = made.predicted[0]
    reference, visibility = ForwardRenderer(glass).draw(view, eye=made.server.eye)
    made = replace(made, server=view, pvs=np.arange(glass.triangles.count, dtype=np.int32))
    made = replace(made, pvs_device=glass.device.upload(made.pvs))
    payload = Stream(glass, mode="full").send(made)
    offsets, rows = decode(payload.blobs["head"], payload.lists["lists"])[0].nodes[0]
    sky = glass.device.empty((view.height, view.width, 4), np.uint8)
    glass.shader.sky(view.view, view.projection, sky)
    expected = blend_twin(offsets, rows[:, :1].copy().view(np.uint8), sky.get().reshape(-1, 4))
    error = np.abs(reference.rgb.get().reshape(-1, 4) - expected).max(axis=-1)
    assert (error > 1).mean() < 0.001
    assert (visibility.triangle.get() >= 0).any()


@pytest.mark.parametrize("parameters", [{"detect": "list"}, {"detect": "list", "nodes": 2, "layers": 3}])
def test_differences_keep_the_display_equal_to_full_lists(glass, parameters):
    differences, full = (
        Stream(glass, mode="difference", **parameters),
        Stream(glass, mode="full", **{k: v for k, v in parameters.items() if k != "detect"}),
    )
    for step in (0, 0, 1, 1, 5):
        made = frame(glass, step)
        sent = differences.send(made)
        full.send(made)
        pictures = [rgb(stream.client.draw(made.predicted[0])) for stream in (differences, full)]
        assert np.abs(pictures[0] - pictures[1]).max() <= 1
    assert sent.statistics["fragments_sent"] > 0


def test_a_still_camera_sends_nothing_and_deletions_are_transparent(glass):
    stream = Stream(glass, mode="difference")
    made = frame(glass)
    first = stream.send(made)
    assert first.statistics["fragments_sent"] == first.statistics["fragments_kept"]
    assert stream.send(made).statistics["fragments_sent"] == 0
    none = replace(made, pvs=made.pvs[:0], pvs_device=glass.device.upload(made.pvs[:0]))
    gone = stream.send(none)
    used = np.count_nonzero(stream.layers(first))
    assert gone.statistics["fragments_deleted"] == gone.statistics["fragments_sent"] == used
    depth = stream.client.draw(made.predicted[0]).depth
    assert depth is not None
    assert (depth.get() == 0).all()


def test_what_tolerance_omits_is_sent_when_the_camera_stands_still(glass):
    exact, loose = Stream(glass, mode="difference"), Stream(glass, mode="difference", tolerance=24)
    sent = [
        [stream.send(frame(glass, step)).statistics["fragments_sent"] for step in (0, 1)] for stream in (exact, loose)
    ]
    assert sent[1][1] < sent[0][1]
    rest = loose.send(frame(glass, 1)).statistics["fragments_sent"]
    assert rest > 0
    made = frame(glass, 1)
    (view,) = list_views(made)
    pictures = [rgb(stream.client.draw(view)) for stream in (exact, loose)]
    assert np.abs(pictures[0] - pictures[1]).max() <= 1


@pytest.mark.parametrize(
    "parameters",
    [{}, {"mode": "full"}, {"mode": "difference", "nodes": 2, "layout": "shuffled"}, {"mode": "bilateral"}],
)
def test_same_bytes_for_every_work_group_size(glass, parameters, device, monkeypatch):
    sent = []
    for local_size, chunks in ((64, 64), (1, 5), (7, 300)):
        monkeypatch.setattr(device, "local_size", local_size)
        monkeypatch.setattr(device, "chunks", chunks)
        stream = Stream(glass, **parameters)
        payloads = [stream.send(frame(glass, step)) for step in (0, 2)]
        picture = rgb(stream.client.draw(novel_view(2)))
        sent.append([*(payload.lists["lists"] for payload in payloads), picture.tobytes()])
    assert sent[0] == sent[1] == sent[2]


def same_lists(a, b) -> bool:
    return all(x.tobytes() == y.tobytes() for x, y in zip(a.host(), b.host(), strict=True))


def both_ends(stream: Stream) -> tuple[list, list]:
    """What the client holds and what the packer takes it to hold, part by part."""
    client = [part for _, lists in stream.client.held for part in lists]
    return client, [part for held in stream.packer.held for part in held.lists]


@pytest.mark.parametrize("name", ["opaque", "glass"])
@pytest.mark.parametrize("parameters", [{}, {"nodes": 2, "layers": 4, "layout": "shuffled"}])
def test_the_exact_merge_reproduces_what_the_sender_holds(request, name, parameters):
    """Bit for bit, and so its picture; both stay close to the lists sent in full."""
    scene = request.getfixturevalue(name)
    stream = Stream(scene, mode="bilateral", **parameters)
    full = Stream(scene, mode="full", layers=parameters.get("layers", 0))
    for step in [0, 0, *np.arange(0.1, 2, 0.2), 6]:
        made = frame(scene, step)
        sent = stream.send(made).statistics
        full.send(made)
        assert all(same_lists(*pair) for pair in zip(*both_ends(stream), strict=True))
        pictures = [rgb(each.client.draw(list_views(made)[0])) for each in (stream, full)]
        assert np.abs(pictures[0] - pictures[1]).mean() < 4
        assert sent["fragments_sent"] < 2 * sent["fragments_kept"]
    assert sent["fragments_deleted"] > 0


def test_bilateral_saves_fragments_and_nothing_is_sent_when_nothing_moves(glass):
    stream = Stream(glass, mode="bilateral")
    first = stream.send(frame(glass, 0)).statistics
    assert first["fragments_sent"] == first["fragments_kept"]
    assert stream.send(frame(glass, 0)).statistics["fragments_sent"] == 0
    assert stream.send(frame(glass, 0.1)).statistics["share_saved"] > 0.2


def test_the_published_merge_leaves_bad_pixels(glass):
    """Figure 5.8, which ours does not have; figure 5.9: a larger threshold leaves more."""
    bad = []
    for merge, threshold in (("exact", 0.1), ("paper", 0.02), ("paper", 0.3)):
        stream = Stream(glass, mode="bilateral", merge=merge, threshold=threshold)
        for step in range(4):
            stream.send(frame(glass, 0.5 * step))
        ends = both_ends(stream)
        held = [same_lists(*pair) for pair in zip(*ends, strict=True)]
        rows = [np.unique(parts[0].host()[1], axis=0) for parts in ends]
        shared = len(np.unique(np.concatenate(rows), axis=0))
        bad.append(0 if all(held) else 2 * shared - len(rows[0]) - len(rows[1]))
    assert bad[0] == 0 < bad[1] < bad[2]


def test_normal_fragments_take_24_bytes(glass):
    payload = Stream(glass, mode="bilateral").send(frame(glass))
    (message,) = decode(payload.blobs["head"], payload.lists["lists"])
    sent = payload.statistics["fragments_sent"]
    assert payload.raw_bytes == 4 * message.width * message.height + 24 * sent
    assert payload.statistics["padded_bytes"] == 4 * message.width * message.height + 32 * sent


def cards(*cards: tuple[float, tuple[float, float, float], float]) -> Scene:
    """Upright squares at (distance, colour, alpha), an object each, before a camera at the origin; lit by the sky."""
    corner = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32)
    positions = np.concatenate([corner * z * 0.3 - [0, 0, z] for z, _, _ in cards]).astype(np.float32)
    quads = np.array([[0, 1, 2], [0, 2, 3]])
    indices = np.concatenate([quads + 4 * k for k in range(len(cards))]).astype(np.int32)
    ids = np.repeat(np.arange(len(cards)), 2).astype(np.int32)
    look: dict[str, Any] = {"alpha_mode": "blend", "double_sided": True}
    materials = [Material(base_colour=(*colour, alpha), **look) for _, colour, alpha in cards]
    normals = np.tile(np.array([0, 0, 1], np.float32), (len(positions), 1))
    colours = np.ones((len(positions), 4), np.float32)
    scene = Scene("cards", positions, indices, normals, positions[:, :2].copy(), colours, ids, materials)
    scene.lights = [Light("directional", (2, 2, 2), direction=(0, 0, -1), shadows=False)]
    scene.features = find_features(scene)
    scene.content_hash = repr(cards)
    return scene


def cards_frame(scene: ServerScene) -> Frame:
    from shading_atlas_bench.harness.workload.views import CellFrustum, Pose, client_view

    pose = Pose(np.zeros(3), np.array([0.0, 0, 0, 1]))
    server = CellFrustum.around(CELL, FOV, *SIZE).server_view(pose, 0.02)
    pvs = np.arange(scene.triangles.count, dtype=np.int32)
    views = (client_view(pose, FOV, *SIZE, 0.02),)
    return Frame(0, scene, server, CELL.radius, CELL.fov, pvs, scene.device.upload(pvs), views, 16, 16)


RED, GREEN, BLUE = (0.9, 0.05, 0.05), (0.05, 0.9, 0.05), (0.05, 0.05, 0.9)


def centre_error(scene: ServerScene, stream: Stream) -> int:
    """The largest difference to the reference in the picture's middle."""
    made = cards_frame(scene)
    view = made.predicted[0]
    reference, _ = ForwardRenderer(scene).draw(view, eye=made.server.eye)
    error = np.abs(rgb(stream.client.draw(view)) - rgb(reference))
    return int(error[80:100, 150:170].max())


def test_figure_3_1_one_blended_fragment_per_node_is_not_enough(device):
    """Nodes 0 and 1 get the first and last, and the middle card: between node 0's two fragments lies node 1's."""
    scene = upload_scene(device, cards((2, RED, 0.5), (3, GREEN, 0.5), (4, BLUE, 0.5)))
    published, ours = Stream(scene, mode="full", nodes=2, preblend=True), Stream(scene, mode="full", nodes=2)
    for stream in (published, ours):
        stream.send(cards_frame(scene))
    assert centre_error(scene, published) > 15
    assert centre_error(scene, ours) <= 1
    alone = Stream(scene, mode="full", preblend=True)  # one node that sees everything may blend
    alone.send(cards_frame(scene))
    assert centre_error(scene, alone) <= 2


def test_figure_4_3_an_object_that_breaks_through_another(device):
    """A green card moves from behind the red one, of another node, to its front; its own node's picture stays."""
    before = upload_scene(device, cards((3, RED, 0.5), (4, GREEN, 0.5)))
    after = upload_scene(device, cards((3, RED, 0.5), (2, GREEN, 0.5)))
    errors = {}
    for detect in ("colour", "list"):
        stream = Stream(before, mode="difference", nodes=2, detect=detect)
        stream.send(cards_frame(before))
        assert centre_error(before, stream) <= 1
        stream.packer.renderer.scene = after
        stream.packer.renderer.builder = type(stream.packer.renderer.builder)(after.rasteriser)
        stream.send(cards_frame(after))
        errors[detect] = centre_error(after, stream)
    assert errors["colour"] > 15
    assert errors["list"] <= 1


def test_the_shells_at_zero_latency_are_exact(device):
    """The whole way of the work: path, visible set through all layers, server view, client view."""
    host = make_shells(4_000)
    scene = upload_scene(device, host)
    chosen = Settings(scene="shells", width=240, height=135, latency=0.0, frames=2)
    path = make_path(host, "turntable", 2, 0)
    work = FrameSource(scene, path, HeadMotion.synthetic(0), chosen).work(1)
    stream = Stream(scene)
    stream.send(work.frame)
    reference, visibility = ForwardRenderer(scene).draw(work.novel, eye=work.frame.server.eye)
    error = np.abs(rgb(stream.client.draw(work.novel)) - rgb(reference)).max(axis=-1)
    assert (visibility.triangle.get() >= 0).mean() > 0.1
    assert (error > 1).mean() < 0.005


def test_masked_triangles_have_holes_in_lists(device):
    from shading_atlas_bench.scenes.model import Texture

    scene = cards((2, RED, 1.0), (3, GREEN, 1.0))
    texels = np.full((64, 64, 4), 255, np.uint8)
    texels[::2, :, 3] = 0
    scene.textures = [Texture("stripes", texels)]
    scene.materials[0] = Material(base_texture=0, alpha_mode="mask", double_sided=True)
    scene.materials[1] = Material(double_sided=True)
    scene.features, scene.content_hash = find_features(scene), "masked cards"
    server = upload_scene(device, scene)
    assert (server.triangles.host_flags[:2] & Triangles.MASKED).all()
    stream = Stream(server)
    stream.send(cards_frame(server))
    made = cards_frame(server)
    reference, _ = ForwardRenderer(server).draw(made.predicted[0], eye=made.server.eye)
    error = np.abs(rgb(stream.client.draw(made.predicted[0])) - rgb(reference)).max(axis=-1)
    assert (error > 1).mean() < 0.002


@pytest.mark.parametrize(
    "parameters",
    [
        {"nodes": 0},
        {"nodes": 1000},
        {"layers": -1},
        {"opacity": 0.0},
        {"tolerance": -1},
        {"threshold": 2.0},
        {"drift": -1},
        {"mode": "bilateral", "preblend": True},
    ],
)
def test_parameters_out_of_range_are_refused(opaque, parameters):
    with pytest.raises(ValueError, match="ppll"):
        PerPixelLinkedLists(**parameters).prepare(opaque)
