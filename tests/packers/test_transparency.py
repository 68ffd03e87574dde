"""What is see-through, drawn by the clients of every method with an atlas, and by one that knows nothing of it."""

from dataclasses import replace

import numpy as np
import pytest

from shading_atlas_bench.harness.measure.validity import check
from shading_atlas_bench.harness.plugins import load_packer
from shading_atlas_bench.harness.workload.reference import ForwardRenderer
from shading_atlas_bench.harness.workload.skips import skipped_stages
from shading_atlas_bench.harness.workload.upload import upload_scene
from shading_atlas_bench.kernels.fragments.layered import LayeredRasteriser
from shading_atlas_bench.kernels.fragments.layers import Layers
from shading_atlas_bench.kernels.fragments.opacity import Opacity
from shading_atlas_bench.packers.interface import ALPHA, Decoded
from shading_atlas_bench.scenes.features import find_features
from shading_atlas_bench.scenes.hall import make_hall
from shading_atlas_bench.scenes.model import Material, Texture
from shading_atlas_bench.scenes.opaque import opaque_version
from tests.packers.rooms import frame_of, novel_view, room, wall

METHODS = ["sas", "snakebinning", "tss", "packers/example/grid.py:Grid"]
SIDE = 1024
TRANSPARENT = ("layers", "blend", "opacity", "alpha")


def glazed(textured: bool):
    """The room behind two panes that cross each other, one of them half as wide: of constant alpha, and, if textured,
    one with a texture of alpha from nothing to opaque. The second one transmits light."""
    scene = room(quads=6)
    x, y = np.array([2.4, 0.0, 0]), np.array([0, 1.8, 0.0])
    panes = [
        wall(np.array([-1.4, -0.9, 0.4]), x, y, 4, 3, 0.05),
        wall(np.array([-0.2, -0.7, 0.8]), x * 0.5 + [0, 0, -0.6], y * 0.8, 3, 3, 0),
    ]
    for number, (positions, indices) in enumerate(panes):
        scene.indices = np.concatenate([scene.indices, indices + len(scene.positions)]).astype(np.int32)
        scene.positions = np.concatenate([scene.positions, positions]).astype(np.float32)
        scene.material_ids = np.append(scene.material_ids, np.full(len(indices), 1 + number, np.int32))
        corner = positions - positions[0]
        uvs = np.stack([np.hypot(corner[:, 0], corner[:, 2]), corner[:, 1]], axis=1) / [2.4, 1.8]
        scene.uvs = np.concatenate([scene.uvs, uvs]).astype(np.float32)
        scene.colours = np.concatenate([scene.colours, np.ones((len(positions), 4), np.float32)])
        scene.normals = np.concatenate([scene.normals, np.tile(np.array([0, 0, 1], np.float32), (len(positions), 1))])
    texels = np.full((16, 64, 4), 200, np.uint8)
    texels[..., 3] = np.linspace(0, 255, 64)
    scene.textures = [Texture("ramp", texels, wrap_s="clamp", wrap_t="clamp")]
    ramp = {"base_colour": (1, 1, 1, 1.0), "base_texture": 0} if textured else {"base_colour": (0.2, 0.4, 0.9, 0.4)}
    scene.materials += [
        Material(alpha_mode="blend", double_sided=True, **ramp),
        Material(base_colour=(0.9, 0.3, 0.2, 1), transmission=0.6, double_sided=True),
    ]
    scene.features, scene.content_hash = find_features(scene), f"glazed-{textured}"
    return scene


@pytest.fixture(scope="module", params=[False, True], ids=["constant", "textured"])
def scenes(request, device):
    """A scene with panes on the device, and its opaque version."""
    scene = glazed(request.param)
    return upload_scene(device, scene), upload_scene(device, opaque_version(scene))


@pytest.fixture(scope="module")
def hall(device):
    scene = make_hall(detail=40_000)
    scene.features, scene.content_hash = find_features(scene), "a small hall"
    return upload_scene(device, scene)


def sent(spec: str, scene, frame):
    """A method's packer, its payload for a frame, and a client that has received it."""
    (packer,) = load_packer(spec)
    packer.prepare(scene)
    payload, client = packer.pack(frame), packer.client(scene.shipped)
    planes = {name: plane.get()[..., :3] for name, plane in payload.planes.items()}
    client.receive(Decoded(planes, payload.blobs, payload.geometry))
    return packer, payload, client


def error(scene, client, frame):
    """Mean difference of the client's novel view from the reference, and both ids."""
    image = client.draw(novel_view())
    reference, _ = ForwardRenderer(scene).draw(novel_view(), eye=frame.server.eye)
    difference = np.abs(image.rgb.get().astype(int) - reference.rgb.get())
    assert reference.triangle is not None
    return difference.mean(), image.triangle.get(), reference.triangle.get()


@pytest.mark.parametrize("spec", METHODS)
def test_the_client_blends_as_the_reference_does(scenes, spec):
    """At most six tenths more error than with opaque panes; the nearest visible triangles are the same; valid."""
    errors = []
    for scene in scenes:
        frame = frame_of(scene, SIDE, SIDE)
        _, payload, client = sent(spec, scene, frame)
        found, drawn, wanted = error(scene, client, frame)
        errors.append(found)
        assert (drawn == wanted).mean() > 0.995
        assert check(frame, payload, payload.owners(), client, budget=20_000) == []
        assert (ALPHA in payload.planes) == (scene.host.content_hash == "glazed-True")
    assert errors[0] < 1.6 * errors[1] < 4


def test_the_panes_matter(scenes):
    """What the test above compares are different pictures, and fewer triangles are seen where panes are opaque."""
    pictures = [ForwardRenderer(scene).draw(novel_view())[0].rgb.get().astype(int) for scene in scenes]
    assert (np.abs(pictures[0] - pictures[1]).max(axis=-1) > 8).mean() > 0.1
    through, covered = (frame_of(scene, SIDE, SIDE).pvs for scene in scenes)
    assert len(through) > len(covered)


def test_the_visible_set_holds_what_contributes_in_views_from_the_cell(scenes):
    """Of what makes up 1/255 of a pixel of the novel view, at most 1 % is not in the set; opaque things behind panes
    are, and panes that nothing of is seen are not."""
    scene, _ = scenes
    frame, view = frame_of(scene, SIDE, SIDE), novel_view()
    flags = scene.device.zeros(scene.triangles.count, np.uint8)
    scene.layers.mark(view.view, view.projection, view.width, view.height, flags, "t")
    seen = np.flatnonzero(flags.get())
    assert np.isin(seen, frame.pvs, invert=True).mean() < 0.01
    shown = ForwardRenderer(scene).draw(view)[0].triangle
    assert shown is not None
    nearest = np.unique(shown.get())
    assert np.isin(nearest[nearest >= 0], seen).all()
    assert len(seen) > len(nearest) + 5


def test_what_is_skipped_is_what_a_scene_does_not_need(scenes, hall):
    skipped, opaque = (skipped_stages(scene.host.features) for scene in scenes)
    assert "blending" not in skipped
    assert ("alpha plane" not in skipped) == scenes[0].layers.opacity.varies
    for nothing in (opaque, skipped_stages(hall.host.features)):
        assert "no material is blended" in nothing["blending"]
        assert "no blended material" in nothing["alpha plane"]


def test_the_opaque_version_is_another_scene_and_says_so(hall):
    scene = glazed(False)
    opaque = opaque_version(scene)
    assert opaque.content_hash != scene.content_hash
    assert not opaque.features.blend
    assert "made opaque (--opaque): 42." in opaque.notes[-1]
    assert scene.features.blend
    assert opaque_version(hall.host) is hall.host


def test_the_plane_holds_the_opacity_of_every_sample(scenes):
    """Colours are not multiplied by it: they are those that opaque panes have."""
    scene, _ = scenes
    _, payload, _ = sent("sas", scene, frame_of(scene, SIDE, SIDE))
    if ALPHA not in payload.planes:
        assert not scene.layers.opacity.varies
        return
    n, texel = payload.sample_count, payload.samples.texel.get()[: payload.sample_count]
    plane = payload.planes[ALPHA].get().reshape(-1, 4)
    expected = scene.layers.opacity.of(payload.samples, "t").get()[:n]
    np.testing.assert_array_equal(plane[texel], np.stack([expected] * 3 + [0 * expected + 255], axis=1))
    assert np.count_nonzero(plane[:, 3]) == n
    see_through = expected < 20
    colours = payload.planes["atlas"].get().reshape(-1, 4)[texel][see_through]
    assert see_through.sum() > 100
    assert colours[:, :3].mean() > 40


def test_a_client_without_the_plane_draws_such_panes_opaque(scenes):
    """A packer may leave it out: nothing fails, and constant opacities still count."""
    scene, _ = scenes
    frame = frame_of(scene, SIDE, SIDE)
    _, payload, complete = sent("sas", scene, frame)
    (packer,) = load_packer("sas")
    packer.prepare(scene)
    packer.pack(frame)
    client = packer.client(scene.shipped)
    client.receive(Decoded({"atlas": payload.planes["atlas"].get()[..., :3]}, payload.blobs, payload.geometry))
    same = np.array_equal(client.draw(novel_view()).rgb.get(), complete.draw(novel_view()).rgb.get())
    assert same == (ALPHA not in payload.planes)


def test_same_bytes_for_every_work_group_size_and_chunk_count(scenes, monkeypatch):
    scene, _ = scenes
    frame, device = frame_of(scene, SIDE, SIDE), scene.device

    def picture() -> list[bytes]:
        _, payload, client = sent("sas", scene, frame)
        image = client.draw(novel_view())
        planes = [plane.get().tobytes() for plane in payload.planes.values()]
        return [image.rgb.get().tobytes(), image.triangle.get().tobytes(), *planes]

    expected = picture()
    for local_size, chunks in ((1, 64), (256, 7)):
        monkeypatch.setattr(device, "local_size", local_size)
        monkeypatch.setattr(device, "chunks", chunks)
        assert picture() == expected


@pytest.mark.parametrize("spec", METHODS)
def test_an_opaque_scene_runs_no_kernel_of_transparency(hall, spec):
    """Nor does the reference; and with that code at hand, but nothing to do, all bytes are the same."""
    device, frame = hall.device, frame_of(hall, 512, 512, pvs=np.arange(0, hall.triangles.count, 9, dtype=np.int32))
    with device.record() as record:
        _, payload, client = sent(spec, hall, frame)
        plain = client.draw(novel_view())
        ForwardRenderer(hall).draw(novel_view())
    assert len(record.launches) > 5
    assert {name: n for name, n in record.launches.items() if any(word in name for word in TRANSPARENT)} == {}
    opacity = Opacity.of_scene(hall.triangles, hall.shader, hall.host)
    ready = replace(hall, layers=Layers(LayeredRasteriser(device, hall.triangles, hall.mask), opacity))
    _, again, other = sent(spec, ready, replace(frame, scene=ready))
    other.layered, other.opacities = LayeredRasteriser(device, other.triangles), None
    layered = other.draw(novel_view())
    assert again.geometry == payload.geometry
    assert again.blobs == payload.blobs
    assert list(again.planes) == ["atlas"]
    for one, two in (
        (again.planes["atlas"], payload.planes["atlas"]),
        (layered.rgb, plain.rgb),
        (layered.triangle, plain.triangle),
    ):
        assert one.get().tobytes() == two.get().tobytes()
