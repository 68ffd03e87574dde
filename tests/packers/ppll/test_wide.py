"""Lists of a view cell that takes several views: nothing is twice or lost where they meet, in all modes."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from shading_atlas_bench.harness.workload.frames import FrameSource
from shading_atlas_bench.harness.workload.reference import ForwardRenderer
from shading_atlas_bench.harness.workload.settings import Settings
from shading_atlas_bench.harness.workload.upload import upload_scene
from shading_atlas_bench.harness.workload.views import (
    CellFrustum,
    Pose,
    ViewCell,
    client_view,
    from_rotation_vector,
)
from shading_atlas_bench.packers.cell_views import owned_pixels
from shading_atlas_bench.packers.interface import Decoded, Frame, ServerScene, View
from shading_atlas_bench.packers.ppll.wire import WireError, decode
from shading_atlas_bench.scenes.features import find_features
from shading_atlas_bench.scenes.head_motion import HeadMotion
from shading_atlas_bench.scenes.model import Light, Material, Scene
from shading_atlas_bench.scenes.paths import make_path
from shading_atlas_bench.scenes.quaternions import multiply
from tests.packers.ppll.test_packer import Stream, both_ends, rgb, same_lists
from tests.packers.rooms import FOV, NEAR, frame_of, pose_at, room, server_of

SIZE = (128, 72)
FRUSTUM = CellFrustum.around(ViewCell(0.3, 160), FOV, *SIZE)


def widened(frame: Frame, pose: Pose) -> Frame:
    """The frame with a view cell of 160 degrees at a pose, and all triangles in its set."""
    pvs = np.arange(frame.scene.triangles.count, dtype=np.int32)
    wide = replace(frame, pvs=pvs, pvs_device=frame.scene.device.upload(pvs), cell_radius=0.3, cell_fov=160)
    return replace(wide, server=FRUSTUM.server_view(pose, NEAR), frusta=FRUSTUM.split(pose, NEAR))


@pytest.fixture(scope="module")
def glass(device) -> ServerScene:
    """The room with half of its triangles blended."""
    scene = room(quads=6)
    scene.materials.append(Material(base_colour=(0.9, 0.8, 0.7, 0.4), alpha_mode="blend", double_sided=True))
    scene.material_ids = (np.random.default_rng(1).random(scene.triangle_count) < 0.5).astype(np.int32)
    scene.features, scene.content_hash = find_features(scene), "wide glass room"
    return server_of(device, scene)


def frame(scene: ServerScene, step: float = 0) -> Frame:
    return widened(frame_of(scene, 64, 64, step, pvs=np.zeros(0, np.int32)), pose_at(step))


def clients(pose: Pose, size: tuple[int, int] = SIZE) -> list[View]:
    """Inside the cell: straight ahead, where four views meet, and turned to where one or two of them are seen."""
    turns = [(0, 0), (0, 20), (15, -10), (0, -50), (-15, 45)]
    turned = [from_rotation_vector(np.radians([up, right, 0])) for up, right in turns]
    moved = np.array([0.1, 0.05, -0.1])
    poses = [pose, *(Pose(pose.position + moved, multiply(pose.orientation, turn)) for turn in turned)]
    return [client_view(at, FOV, *size, NEAR) for at in poses]


def panes() -> Scene:
    """Two half transparent upright squares before the origin, so large that they end outside of all clients' views."""
    corner = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32)
    positions = np.concatenate([corner * 40 - [0, 0, z] for z in (3, 5)]).astype(np.float32)
    quads = np.array([[0, 1, 2], [0, 2, 3]])
    indices = np.concatenate([quads, quads + 4]).astype(np.int32)
    look: dict[str, Any] = {"alpha_mode": "blend", "double_sided": True, "roughness": 1.0}
    materials = [Material(base_colour=(*rgb, 0.5), **look) for rgb in ((0.9, 0.1, 0.1), (0.1, 0.1, 0.9))]
    normals = np.tile(np.array([0, 0, 1], np.float32), (8, 1))
    colours, ids = np.ones((8, 4), np.float32), np.repeat(np.arange(2), 2).astype(np.int32)
    scene = Scene("panes", positions, indices, normals, positions[:, :2].copy(), colours, ids, materials)
    scene.lights = [Light("directional", (2, 2, 2), direction=(0, 0, -1), shadows=False)]
    scene.features, scene.content_hash = find_features(scene), "wide panes"
    return scene


@pytest.mark.parametrize("parameters", [{}, {"mode": "full", "nodes": 2, "layout": "shuffled"}, {"mode": "bilateral"}])
def test_panes_across_the_seams_blend_once_and_have_no_gap(device, parameters):
    """A pane twice or not at all is off by more than 30 levels."""
    scene, pose = upload_scene(device, panes()), Pose(np.zeros(3), np.array([0.0, 0, 0, 1]))
    made = widened(frame_of(scene, 64, 64, pvs=np.zeros(0, np.int32)), pose)
    assert len(made.cell_views) == 4
    stream = Stream(scene, **parameters)
    stream.send(made)
    for client in clients(pose, (320, 180))[:-2]:  # where a pane is seen so slantingly that neighbours are far apart
        reference, visibility = ForwardRenderer(scene).draw(client, eye=made.server.eye)
        shown = stream.client.draw(client)
        assert (visibility.triangle.get() >= 0).all()
        assert shown.depth is not None
        assert (shown.depth.get() > 0).all()
        assert np.abs(rgb(shown) - rgb(reference)).max() <= 4


def test_every_fragment_is_on_a_ray_of_its_own_view(glass):
    made = frame(glass)
    payload = (stream := Stream(glass, mode="full")).send(made)
    messages = decode(payload.blobs["head"], payload.lists["lists"])
    assert len(messages) == len(made.cell_views) == 4
    pixels = 0
    for number, (message, view) in enumerate(zip(messages, made.cell_views, strict=True)):
        np.testing.assert_array_equal(message.view, view.view)
        owned = owned_pixels(made.cell_views, number).ravel()
        counts = np.diff(message.nodes[0][0])
        assert not counts[~owned].any()
        assert (counts[owned] > 0).mean() > 0.5
        pixels += owned.sum()
    statistics = payload.statistics
    assert sum(value for name, value in statistics.items() if name.startswith("pixels_of")) == pixels
    assert statistics["fragments_built"] >= statistics["fragments_sent"] == payload.sample_count
    assert payload.raw_bytes == len(payload.lists["lists"]) == statistics["header_bytes"] + statistics["list_bytes"]
    details = stream.packer.details(payload)
    assert sum(len(details[f"fragments{behind}"]) for behind in ("", "_view1", "_view2", "_view3")) == len(
        np.concatenate([message.nodes[0][1] for message in messages])
    )
    np.testing.assert_array_equal(details["list_projection_view3"], made.cell_views[3].projection)


def test_clients_anywhere_in_the_cell_see_few_holes(glass):
    made = frame(glass)
    stream = Stream(glass, mode="full")
    stream.send(made)
    for client in clients(pose_at(0)):
        image = stream.client.draw(client)
        reference, visibility = ForwardRenderer(glass).draw(client, eye=made.server.eye)
        assert image.depth is not None
        assert ((image.depth.get() == 0) & (visibility.triangle.get() >= 0)).mean() < 0.005
        assert np.abs(rgb(image) - rgb(reference)).mean() < 8


@pytest.mark.parametrize("parameters", [{"detect": "list"}, {"detect": "list", "nodes": 2, "layers": 3}])
def test_differences_keep_the_display_equal_to_full_lists(glass, parameters):
    limits = {name: value for name, value in parameters.items() if name != "detect"}
    differences, full = Stream(glass, mode="difference", **parameters), Stream(glass, mode="full", **limits)
    for step in (0, 0, 1, 5):
        made = frame(glass, step)
        sent = differences.send(made).statistics
        full.send(made)
        pictures = [rgb(stream.client.draw(clients(pose_at(step))[1])) for stream in (differences, full)]
        assert np.abs(pictures[0] - pictures[1]).max() <= 1
    assert sent["fragments_sent"] > 0


@pytest.mark.parametrize("parameters", [{}, {"nodes": 2, "layers": 4}])
def test_the_exact_merge_reproduces_what_the_sender_holds(glass, parameters):
    """While the camera turns, so that fragments move from view to view: those are sent anew."""
    stream = Stream(glass, mode="bilateral", **parameters)
    for step in (0, 0.1, 0.2, 2, 9):
        made = frame(glass, step)
        sent = stream.send(made).statistics
        assert all(same_lists(*pair) for pair in zip(*both_ends(stream), strict=True))
        for number in range(4):
            owned = owned_pixels(made.cell_views, number).ravel()
            for part in stream.client.held[number][1]:
                assert not np.diff(part.host()[0])[~owned].any()
        if step == 0.1:
            assert sent["share_saved"] > 0.2
    assert sent["fragments_deleted"] > 0


@pytest.mark.parametrize("parameters", [{}, {"mode": "difference", "nodes": 2}, {"mode": "bilateral"}])
def test_same_bytes_for_every_work_group_size(glass, parameters, device, monkeypatch):
    sent = []
    for local_size, chunks in ((64, 64), (7, 300)):
        monkeypatch.setattr(device, "local_size", local_size)
        monkeypatch.setattr(device, "chunks", chunks)
        stream = Stream(glass, **parameters)
        payloads = [stream.send(frame(glass, step)) for step in (0, 2)]
        picture = rgb(stream.client.draw(clients(pose_at(2))[1]))
        sent.append([*(payload.lists["lists"] for payload in payloads), picture.tobytes()])
    assert sent[0] == sent[1]


def test_differences_to_other_views_are_refused(glass):
    stream = Stream(glass, mode="difference")
    stream.send(frame(glass))
    other = Stream(glass, mode="difference").send(replace(frame(glass), frusta=frame(glass).frusta[:2]))
    with pytest.raises(WireError, match="another size, views or nodes"):
        stream.client.receive(Decoded({}, other.blobs, other.geometry, other.lists))


def test_the_path_of_a_wide_cell_has_its_frusta(device):
    """From the settings to the frame: the cell's views have the server's eye and the client's density."""
    scene = upload_scene(device, host := room(quads=4))
    path, head = make_path(host, "orbit", 1, 0), HeadMotion.synthetic(0)
    for cell_fov, count in ((90.0, 1), (160.0, 4)):
        chosen = Settings(width=160, height=90, frames=1, cell_radius=0.3, cell_fov=cell_fov)
        made = FrameSource(scene, path, head, chosen).work(0).frame
        assert len(made.cell_views) == count
        for view in made.cell_views:
            np.testing.assert_allclose(view.eye, made.server.eye, atol=1e-9)
            assert view.pixels_per_tangent >= made.predicted[0].pixels_per_tangent * (1 - 1e-9)
    assert replace(made, frusta=()).cell_views == (made.server,)
