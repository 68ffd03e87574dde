"""Whole runs of all methods on scenes that lack what others have: casters, lights, opaque or any visible surfaces."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from shading_atlas_bench.harness.plugins import packer_names
from shading_atlas_bench.harness.run.run import run
from shading_atlas_bench.harness.workload.settings import Settings
from tests.scenes.glb_files import SQUARE, SQUARE_INDICES, Glb

LIGHTS = [
    {"type": "directional", "intensity": 3.0},
    {"type": "spot", "intensity": 20.0, "spot": {"outerConeAngle": 0.7}},
    {"type": "point", "intensity": 20.0},
]


def material(**more) -> dict:
    """Red, matt and half there."""
    pbr = {"baseColorFactor": [1.0, 0.1, 0.1, 0.5], "metallicFactor": 0.0}
    return {"pbrMetallicRoughness": pbr, "doubleSided": True, **more}


def square(look: dict, lights: tuple[list[dict], float] = ([], 2.0), indices=SQUARE_INDICES, alpha=(1.0,) * 4) -> Glb:
    """A square of 2 units facing +z around the origin, and lights at a height above its middle, shining down at it."""
    glb = Glb(nodes=[{"mesh": 0}], materials=[look])
    colours = np.ones((4, 4), np.float32)
    colours[:, 3] = alpha
    attributes = {
        "POSITION": glb.accessor(2 * SQUARE - np.array([1, 1, 0], np.float32)),
        "COLOR_0": glb.accessor(colours),
    }
    primitive = {"attributes": attributes, "indices": glb.accessor(np.array(indices, np.uint16)), "material": 0}
    glb.json["meshes"] = [{"primitives": [primitive]}]
    entries, height = lights
    for number in range(len(entries)):
        extension = {"KHR_lights_punctual": {"light": number}}
        glb.json["nodes"].append({"translation": [0, 0, height], "extensions": extension})
    glb.json["extensions"] = {"KHR_lights_punctual": {"lights": entries}}
    return glb


BLENDED, MASKED = {"alphaMode": "BLEND"}, {"alphaMode": "MASK"}
GLASS = {"extensions": {"KHR_materials_transmission": {"transmissionFactor": 1.0}}}
DARK = [{**light, "intensity": 0.0} for light in LIGHTS]
SCENES = {
    "only blended": square(material(**BLENDED)),
    "only blended by vertices": square(material(**BLENDED), alpha=(0.0, 1.0, 0.5, 0.2)),
    "only blended, nothing visible": square(material(**BLENDED), alpha=(0.0,) * 4),
    "only glass": square(material(**GLASS)),
    "only masked": square(material(**MASKED)),
    "only masked, nothing there": square(material(**MASKED, alphaCutoff=0.6)),
    "only masked by vertices": square(material(**MASKED, alphaCutoff=0.25), alpha=(0.0, 1.0, 1.0, 0.3)),
    "only masked by vertices, nothing there": square(material(**MASKED, alphaCutoff=0.25), alpha=(0.4,) * 4),
    "lights without casters": square(material(**BLENDED), (LIGHTS, 2.0)),
    "one triangle": square(material(), indices=[0, 1, 2]),
    "one blended triangle": square(material(**BLENDED), indices=[0, 1, 2]),
    "lights that are dark": square(material(), (DARK, 2.0)),
    "lights in the surface": square(material(), (LIGHTS, 0.0)),
}


@pytest.fixture(scope="module")
def path_file(tmp_path_factory):
    """A camera that stands 3 units before the square and looks at it."""
    file = tmp_path_factory.mktemp("path") / "one.path"
    file.write_text("0 0 0 3 0 0 0 1\n16 0 0 3 0 0 0 1\n", encoding="utf-8")
    return str(file)


@pytest.mark.parametrize("name", SCENES)
def test_every_method_ends_with_a_picture_like_the_reference(tmp_path, path_file, name):
    scene = SCENES[name].write(tmp_path / "scene.glb")
    small = Settings(width=64, height=48, atlas_width=256, atlas_height=256, codec="none", latency=0.0)
    settings = replace(small, scene=scene, path=path_file, frames=1, metrics=("flip", "psnr"), unit=1.0)
    assert run(settings, tmp_path / "run").well
    with open(tmp_path / "run" / "frames.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert sorted(row["method"] for row in rows) == packer_names()
    for row in rows:
        assert row["status"] == "ok", row["reason"]
        assert float(row["flip"]) < 0.05
        assert (int(row["pvs_triangles"]) == 0) == ("nothing" in name)
