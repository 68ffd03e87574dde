"""Forward rendering: what is drawn is where it should be, lit as it should be, and the same every time."""

import numpy as np
import pytest

from shading_atlas_bench.harness.workload.reference import ForwardRenderer
from shading_atlas_bench.harness.workload.upload import upload_scene
from shading_atlas_bench.harness.workload.views import Pose, projection_matrix, view_matrix
from shading_atlas_bench.kernels.raster.resolve import resolve
from shading_atlas_bench.kernels.samples import Samples
from shading_atlas_bench.kernels.shade.shade import shade_twin
from shading_atlas_bench.packers.interface import View
from shading_atlas_bench.scenes.features import find_features
from shading_atlas_bench.scenes.load import load_scene
from shading_atlas_bench.scenes.model import Light, Material, Scene, Sky, Texture
from tests.conftest import REAL_SCENES

BLACK = Sky((0, 0, 0), (0, 0, 0), (0, 0, 0))


def card(materials=None, textures=(), lights=(), sky=BLACK, normals=(0, 0, 1)):
    """A square from -1 to 1 at z = 0 that faces +z, its texture upright."""
    positions = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32)
    uvs = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32)
    return Scene(
        "card",
        positions,
        np.array([[0, 1, 2], [0, 2, 3]], np.int32),
        np.tile(np.array(normals, np.float32), (4, 1)),
        uvs,
        np.ones((4, 4), np.float32),
        np.zeros(2, np.int32),
        materials or [Material(base_colour=(1, 1, 1, 1))],
        list(textures),
        lights=list(lights),
        sky=sky,
    )


def view_from(z, size=32, turned=False):
    """A camera on the z axis that looks at the origin and sees -1..1 at a distance of 2."""
    pose = Pose(np.array([0.0, 0.0, z]), np.array([0.0, 1.0, 0.0, 0.0] if turned else [0.0, 0.0, 0.0, 1.0]))
    return View(view_matrix(pose), projection_matrix(0.5, 0.5, 0.01), size, size)


def drawn(device, scene, view):
    image, visible = ForwardRenderer(upload_scene(device, scene)).draw(view)
    return image.rgb.get(), visible.triangle.get()


def test_textures_are_upright(device):
    texels = np.zeros((2, 2, 4), np.uint8)
    texels[...] = [[[255, 0, 0, 255], [0, 255, 0, 255]], [[0, 0, 255, 255], [255, 255, 255, 255]]]
    scene = card(
        [Material(base_colour=(1, 1, 1, 1), base_texture=0)],
        [Texture("t", texels, True, "clamp", "clamp")],
        [front_light()],
    )
    rgb, _ = drawn(device, scene, view_from(2.0))
    assert (rgb[4, 4, 1:3] < 20).all()  # red above on the left
    assert (rgb[4, 27, [0, 2]] < 20).all()  # green above on the right
    assert (rgb[27, 4, :2] < 20).all()  # blue below on the left
    assert rgb[27, 27].min() > 150


def front_light(**changes):
    return Light("directional", (3.0, 3.0, 3.0), direction=(0.0, 0.0, -1.0), shadows=False, **changes)


def test_sky_is_painted_where_nothing_is_drawn(device):
    sky = Sky((0, 0, 1), (0, 0, 1), (1, 0, 0))
    rgb, triangle = drawn(device, card(sky=sky), view_from(4.0))
    empty = triangle < 0
    assert 0 < empty.sum() < empty.size
    assert (rgb[..., 3] == 255).all()
    assert (rgb[0, :, 2] > 200).all()
    assert (rgb[0, :, 0] == 0).all()
    assert (rgb[-1, :, 0] > 200).all()


def test_double_sided_surfaces_are_lit_on_the_side_that_is_seen(device):
    back = [Light("directional", (3.0, 3.0, 3.0), direction=(0.0, 0.0, 1.0), shadows=False)]
    for double_sided, seen in [(True, True), (False, False)]:
        scene = card([Material(base_colour=(1, 1, 1, 1), double_sided=double_sided)], lights=back)
        rgb, triangle = drawn(device, scene, view_from(-2.0, turned=True))
        assert (triangle[16, 16] >= 0) == seen
        assert (rgb[16, 16, 0] > 100) == seen


def test_a_normal_map_turns_the_light(device):
    """A texel that leans to the tangent (+x) is lit from the right and not from the left; up is green."""
    for texel, light_from in [((255, 128, 128), (1, 0, 0)), ((128, 255, 128), (0, 1, 0))]:
        flat = np.zeros((1, 1, 4), np.uint8)
        flat[..., :3] = texel
        brightness = []
        for sign in (1, -1):
            x, y, z = (-sign * d for d in light_from)
            sun = Light("directional", (3.0,) * 3, direction=(x, y, z), shadows=False)
            scene = card([Material(normal_texture=0)], [Texture("n", flat, srgb=False)], [sun])
            scene.tangents = np.tile(np.array([1, 0, 0, 1], np.float32), (4, 1))
            brightness.append(int(drawn(device, scene, view_from(2.0))[0][16, 16, 0]))
        assert brightness[0] > 150
        assert brightness[1] < 20


def test_blended_surfaces_cast_no_shadow(device):
    lamp = [Light("directional", (3.0,) * 3, direction=(0.0, 0.0, -1.0))]
    for mode, dark in [("opaque", True), ("blend", False)]:
        scene = card([Material(base_colour=(1,) * 4), Material(alpha_mode=mode)], lights=lamp)
        pane = scene.positions + np.array([0, 0, 5], np.float32)
        scene.positions = np.concatenate([scene.positions, pane])
        scene.indices = np.concatenate([scene.indices, scene.indices + 4])
        for name in ("normals", "uvs", "colours"):
            setattr(scene, name, np.concatenate([getattr(scene, name)] * 2))
        scene.material_ids = np.array([0, 0, 1, 1], np.int32)
        assert (drawn(device, scene, view_from(2.0))[0][16, 16, 0] < 20) == dark


@pytest.mark.parametrize(("alphas", "there"), [((0.2,) * 4, False), ((0.8,) * 4, True), ((0.0, 1.0, 1.0, 0.0), None)])
def test_the_alpha_of_vertices_cuts_a_mask_and_its_shadow(device, alphas, there):
    """A masked pane before a wall, seen from aside, and the wall behind it: all there, not there, or its right half."""
    lamp = [Light("directional", (3.0,) * 3, direction=(0.0, 0.0, -1.0))]
    scene = card([Material(base_colour=(1,) * 4), Material(alpha_mode="mask", double_sided=True)], lights=lamp)
    scene.positions = np.concatenate([scene.positions, scene.positions + np.array([0, 0, 5], np.float32)])
    scene.indices = np.concatenate([scene.indices, scene.indices + 4])
    for name in ("normals", "uvs", "colours"):
        setattr(scene, name, np.concatenate([getattr(scene, name)] * 2))
    scene.colours[4:, 3] = alphas
    scene.material_ids = np.array([0, 0, 1, 1], np.int32)
    left, right = (bool(there), bool(there)) if there is not None else (False, True)
    wall, _ = drawn(device, scene, view_from(2.0))  # between the two
    assert [bool(wall[16, column, 0] < 20) for column in (6, 26)] == [left, right]
    _, seen = drawn(device, scene, view_from(8.0))
    assert [bool(seen[16, column] >= 2) for column in (12, 20)] == [left, right]


def test_the_alpha_of_vertices_counts_for_blending_but_not_for_clear_glass(device):
    scene = card([Material(alpha_mode="blend"), Material(transmission=1.0)])
    scene.colours[:, 3] = 0.5
    scene.material_ids = np.array([0, 1], np.int32)
    scene.features = find_features(scene)
    uploaded = upload_scene(device, scene)
    assert uploaded.layers
    assert uploaded.layers.opacity.constants.tolist() == [128, 26]
    weight = np.full(2, 0.3)
    samples = Samples.upload(device, np.arange(2), weight, weight, np.full(2, 0.01), np.arange(2))
    assert uploaded.layers.opacity.of(samples, "t").get()[:2].tolist() == [128, 26]


@pytest.mark.parametrize("exposure", [1e-5, 0.7, 30.0])
def test_unlit_surfaces_show_their_colour_whatever_the_light(device, exposure):
    """Base colour times vertex colour; sRGB of linear 0.5 is 188, of 0.2 is 124."""
    look = Material(base_colour=(0.5, 0.5, 1.0, 1.0), unlit=True)
    for lights, sky in (([], BLACK), ([front_light()], Sky())):
        scene = card([look], lights=lights, sky=sky)
        scene.exposure, scene.colours[:, 1] = exposure, 0.4
        rgb, _ = drawn(device, scene, view_from(2.0))
        assert (rgb[2:30, 2:30] == [188, 124, 255, 255]).all()


def test_emission_has_its_own_uvs(device):
    """The base texture's left half is black, and the emissive one's upper half is green."""
    base, glow = np.full((1, 2, 4), 255, np.uint8), np.full((2, 1, 4), 255, np.uint8)
    base[:, 0, :3], glow[0, 0, [0, 2]], glow[1, 0, :3] = 0, 0, 0
    look = Material(base_colour=(1, 1, 1, 1), base_texture=0, emissive=(1, 1, 1), emissive_texture=1, emissive_uv=1)
    textures = [Texture("base", base, True, "clamp", "clamp"), Texture("glow", glow, True, "clamp", "clamp")]
    scene = card([look], textures, [front_light()])
    turned = np.stack([scene.uvs[:, 1], scene.uvs[:, 0]], axis=1)
    scene.further_uvs = turned[None]  # what was up is left
    rgb, _ = drawn(device, scene, view_from(2.0))
    assert (rgb[[4, 27], 27, 0] > 100).all()  # base: lit on the right
    assert (rgb[[4, 27], 4, 1] > 150).all()  # emission: what is up in the image is left by these UVs
    assert (rgb[[4, 27], 4, 0] < 20).all()
    scene.further_uvs = scene.uvs[None]
    rgb, _ = drawn(device, scene, view_from(2.0))
    assert rgb[4, 4, 1] > 150
    assert rgb[27, 4, 1] < 20


def test_occlusion_dims_the_sky_but_no_light(device):
    texels = np.zeros((1, 1, 4), np.uint8)
    pictures = {}
    for name, lights, sky in (("sky", [], Sky()), ("light", [front_light()], BLACK)):
        for strength in (0.0, 0.5, 1.0):
            look = Material(base_colour=(1, 1, 1, 1), occlusion_texture=0, occlusion_strength=strength)
            scene = card([look], [Texture("o", texels, False)], lights, sky)
            pictures[name, strength] = int(drawn(device, scene, view_from(2.0))[0][16, 16, 1])
    assert pictures["sky", 0.0] > pictures["sky", 0.5] > pictures["sky", 1.0] == 0
    assert pictures["light", 0.0] == pictures["light", 1.0] > 100


def test_a_surface_map_is_the_same_as_its_values(device):
    """Green multiplies roughness, blue metalness."""
    texels = np.array([[[9, 102, 51, 255]]], np.uint8)
    by_map = Material(roughness=0.5, metallic=0.8, surface_texture=0, base_colour=(0.9, 0.5, 0.1, 1))
    plain = Material(roughness=0.5 * 0.4, metallic=0.8 * 0.2, base_colour=(0.9, 0.5, 0.1, 1))
    textures = [Texture("m", texels, False)]
    one, other = (
        drawn(device, card([look], textures, [front_light()], Sky()), view_from(2.0))[0] for look in (by_map, plain)
    )
    assert np.abs(one.astype(int) - other).max() <= 1
    assert np.ptp(one[..., 0]) > 10


def test_the_highlight_is_seen_from_the_eye_that_is_given(device):
    scene = upload_scene(device, card([Material(roughness=0.2)], lights=[front_light()]))
    view = view_from(2.0)
    own, _ = ForwardRenderer(scene).draw(view)
    same, _ = ForwardRenderer(scene).draw(view, eye=view.eye)
    aside, _ = ForwardRenderer(scene).draw(view, eye=np.array([3.0, 0.0, 2.0]))
    np.testing.assert_array_equal(own.rgb.get(), same.rgb.get())
    assert own.rgb.get()[16, 16, 0] > aside.rgb.get()[16, 16, 0] + 20


@pytest.mark.parametrize("size", [1, 33])
def test_the_same_view_gives_the_same_bytes(device, size):
    scene = upload_scene(device, card([Material(roughness=0.3)], lights=[front_light()], sky=Sky()))
    view = view_from(3.0, size=size)
    pictures = [ForwardRenderer(scene).draw(view)[0].rgb.get().tobytes() for _ in range(2)]
    assert pictures[0] == pictures[1]


@pytest.mark.parametrize("name", ["hall", "sponza_crytek"])
def test_pictures_of_real_scenes_match_the_twin(device, name):
    """At most 1 of 255 levels on 99.9% of 4000 pixels, never more than 2."""
    file = REAL_SCENES / name / "scene.glb"
    if name != "hall" and not file.exists():
        pytest.skip(f"{file} is not here")
    host = load_scene("hall", detail=40_000) if name == "hall" else load_scene(str(file))
    scene, camera = upload_scene(device, host), host.cameras[0]
    view = looking(np.array(camera.position), np.array(camera.direction), 0.05 / host.metres_per_unit)
    image, visible = ForwardRenderer(scene).draw(view)
    samples = resolve(device, scene.triangles, visible, view.view, view.projection)
    chosen = np.random.default_rng(0).permutation(samples.count)[:4000]
    triangle, texel, footprint, b1, b2 = (
        array.get()[chosen]
        for array in (samples.triangle, samples.texel, samples.footprint, samples.bary1, samples.bary2)
    )
    shader = scene.shader
    maps, bary = shader.shadows.maps.get(), np.stack([b1, b2], axis=1)
    inputs = (shader.tables, shader.faces.get(), shader.textures, maps, triangle, bary, footprint, view.eye)
    difference = np.abs(image.rgb.get().reshape(-1, 4)[texel].astype(int) - shade_twin(*inputs)).max(axis=1)
    assert np.mean(difference <= 1) >= 0.999
    assert difference.max() <= 2


def looking(eye, forward, near):
    """A camera at `eye` that looks along `forward`, y up, 90 degrees wide and high."""
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    view = np.eye(4)
    view[:3, :3] = right, np.cross(right, forward), -forward
    view[:3, 3] = -view[:3, :3] @ eye
    return View(view, projection_matrix(1.0, 1.0, near), 300, 300)


def test_foliage_with_upright_normals_is_as_bright_from_behind(device):
    sun = [Light("directional", (3.0, 3.0, 3.0), direction=(0.0, -1.0, 0.0), shadows=False)]
    scene = card([Material(double_sided=True)], lights=sun, normals=(0, 1, 0))
    front, _ = drawn(device, scene, view_from(2.0))
    back, _ = drawn(device, scene, view_from(-2.0, turned=True))
    assert front[16, 16, 0] > 100
    np.testing.assert_array_equal(front[16, 16], back[16, 16])
