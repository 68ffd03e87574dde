"""The mip levels of samples are a parameter of every method, which no method needs to know of."""

import re
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from shading_atlas_bench.harness.conformance.trial import Stage, try_method
from shading_atlas_bench.harness.measure.pipeline import Pipeline
from shading_atlas_bench.harness.measure.returned import CheckedPacker
from shading_atlas_bench.harness.measure.verification.truth import LEVELS, Truth
from shading_atlas_bench.harness.plugins import load_packer
from shading_atlas_bench.harness.workload.settings import Settings
from shading_atlas_bench.harness.workload.upload import upload_scene
from shading_atlas_bench.kernels.fragments.opacity import opacity_twin
from shading_atlas_bench.kernels.shade.shade import shade_twin
from shading_atlas_bench.packers.interface import ALPHA, Packer
from shading_atlas_bench.scenes.features import find_features
from shading_atlas_bench.scenes.model import Material, Texture
from tests.packers.rooms import frame_of, novel_view, room

ATLASES = ["sas", "snakebinning", "tss", "packers/example/grid.py:Grid"]
ROUNDED = 1e-3  # share of opacities that rounding may take to another level of 255


@pytest.fixture(scope="module")
def scene(device):
    """The room, half of it see-through, under a texture of noise that is finer than any sample."""
    made = room(quads=5)
    noise = np.random.default_rng(3).integers(0, 256, (256, 256, 4), np.uint8)
    made.textures = [Texture("noise", noise)]
    solid = Material(double_sided=True, base_texture=0)
    made.materials = [solid, replace(solid, alpha_mode="blend")]
    made.material_ids = (np.arange(len(made.indices)) % 2).astype(np.int32)
    made.features, made.content_hash = find_features(made), "noise"
    return upload_scene(device, made)


def one(spec: str) -> Packer:
    (packer,) = load_packer(spec)
    return packer


def packed(spec: str, scene):
    """What a pipeline of this method packs."""
    pipeline = Pipeline(one(spec), scene, Settings())
    pipeline.prepare()
    return pipeline.pack(frame_of(scene, 256, 256)).payload


class Aliased:
    """Shades at the finest level, whatever its parameter says."""

    def prepare(self, scene):
        super().prepare(scene.finest)  # type: ignore[misc]  # of the method's class, which comes behind this one

    def pack(self, frame):
        return super().pack(replace(frame, scene=frame.scene.finest))  # type: ignore[misc]  # the same


@pytest.mark.parametrize("spec", ATLASES)
def test_colours_and_opacities_are_those_of_the_finest_level(scene, spec):
    with_levels, payload = packed(spec, scene), packed(f"{spec}[mipmaps=false]", scene)
    n, samples, shader = payload.sample_count, payload.samples, scene.shader
    triangle, texel = samples.triangle.get()[:n], samples.texel.get()[:n]
    bary = np.stack([samples.bary1.get()[:n], samples.bary2.get()[:n]], axis=1).astype(np.float64)
    points = (triangle, bary, np.zeros(n))
    known = (shader.tables, shader.faces.get(), shader.textures, shader.shadows.maps.get())
    eye = frame_of(scene, 16, 16).server.eye
    shaded = payload.planes["atlas"].get().reshape(-1, 4)[texel, :3].astype(int)
    assert np.percentile(np.abs(shaded - shade_twin(*known, *points, eye)[:, :3]), 99.9) <= LEVELS
    alpha = payload.planes[ALPHA].get().reshape(-1, 4)[texel, 0]
    assert (np.abs(alpha - opacity_twin(scene.layers.opacity, *points)) > 1).mean() < ROUNDED
    assert payload.blobs == with_levels.blobs
    assert payload.geometry == with_levels.geometry
    before = with_levels.planes["atlas"].get().reshape(-1, 4)[texel, :3].astype(int)
    assert np.abs(shaded - before).mean() > 20


@pytest.mark.parametrize("spec", [*ATLASES, "ppll"])
def test_checks_know_of_which_level_colours_are(scene, spec):
    """They hold with and without mip levels, and find those of the other kind wrong."""
    frame = frame_of(scene, 256, 256)
    stage = Stage(scene, [frame], [novel_view()], exact=False)
    for values in ("", "[mipmaps=false]"):
        found = try_method(stage, partial(one, f"{spec}{values}"), again=0)
        assert found.good, found.sentence
    (packer,) = load_packer(spec)
    found = try_method(stage, type("Aliased", (Aliased, type(packer)), {}), again=0)
    assert found.status == "invalid"
    assert re.search("levels|colour or cover", found.sentence)


def test_with_levels_nothing_is_another_scene(scene):
    truth = Truth(scene)
    for spec in [*ATLASES, "ppll"]:
        (packer,) = load_packer(spec)
        assert packer.scene_shaded(scene) is scene
        assert truth.of(CheckedPacker(packer)) is truth
        assert packer.parameters["mipmaps"].default is True
