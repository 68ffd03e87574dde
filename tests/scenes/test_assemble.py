"""What is not a number in a scene is dropped or replaced, counted, and stops nothing else."""

from __future__ import annotations

import numpy as np

from shading_atlas_bench.scenes.assemble import assemble
from shading_atlas_bench.scenes.model import Light, Material
from shading_atlas_bench.scenes.raw import Part, RawScene

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float64)
FACES = np.array([[0, 1, 2], [0, 2, 3]])


def test_lights_materials_and_placements_that_are_not_numbers():
    there, nowhere = np.eye(4), np.eye(4)
    nowhere[0, 3] = np.nan
    part = Part(SQUARE, FACES, 0, transforms=np.stack([there, nowhere]))
    glowing = Material(emissive=(np.inf, 0.0, 0.0), roughness=float("nan"), metallic=0.5)
    lights = [Light("point", (1.0, 1.0, 1.0)), Light("point", (np.nan, 1.0, 1.0)), Light("spot", (1,) * 3, cone=np.inf)]
    scene = assemble("s", RawScene([part], [glowing], lights=lights))
    assert scene.triangle_count == 2
    assert [light.kind for light in scene.lights] == ["point"]
    assert scene.materials == [Material(metallic=0.5)]
    assert scene.notes == [
        "Instances whose placement is infinite or not a number, dropped: 1.",
        "Lights whose numbers are infinite or none, dropped: 2.",
        "Properties of materials that are infinite or not a number, replaced: 2.",
    ]


def test_colours_that_are_not_numbers_are_white():
    colours = np.array([[np.nan, 0.5, 0.5, 1], [np.inf, 0.5, 0.5, 1], [-np.inf, 0.5, 0.5, 1], [0.5, 0.5, 0.5, 1]])
    scene = assemble("s", RawScene([Part(SQUARE, FACES, 0, colours=colours)], [Material()]))
    assert sorted(scene.colours[:, 0].tolist()) == [0.5, 1, 1, 1]


def test_what_a_float32_cannot_hold_is_not_a_number():
    raw = RawScene([Part(SQUARE, FACES, 0)], [Material(base_colour=(1e39, 0.0, 0.0, 1.0), emissive=(0.0, 1e39, 0.0))])
    raw.lights = [Light("point", (1e39, 0.0, 0.0))]
    scene = assemble("s", raw)
    assert scene.materials == [Material()]
    assert not scene.lights
    assert "Properties of materials that are infinite or not a number, replaced: 2." in scene.notes


def test_properties_out_of_range_are_clamped_and_named():
    wild = Material(
        name="steel",
        base_colour=(2.0, 0.5, -1.0, -0.5),
        roughness=-3.0,
        metallic=7.0,
        transmission=3.0,
        emissive=(-1.0, 50.0, 0.0),
        occlusion_strength=1.5,
    )
    lights = [Light("spot", (1.0, -1.0, 0.0), cone=170.0), Light("point", (500.0, 0.0, 0.0))]
    scene = assemble("s", RawScene([Part(SQUARE, FACES, 0)], [wild, Material()], lights=lights))
    assert scene.materials[0] == Material(
        name="steel",
        base_colour=(1.0, 0.5, 0.0, 0.0),
        roughness=0.0,
        metallic=1.0,
        transmission=1.0,
        emissive=(0.0, 50.0, 0.0),
        occlusion_strength=1.0,
    )
    assert scene.materials[1] == Material()
    assert [(light.colour, light.cone) for light in scene.lights] == [((1, 0, 0), 90), ((500, 0, 0), 60)]
    assert scene.notes == [
        "Lights of less than no light or with cones wider than 90 degrees, clamped: 1.",
        "Properties of materials outside their range, clamped: base_colour (2 0.5 -1 -0.5) of steel, roughness -3 of "
        "steel, metallic 7 of steel, occlusion_strength 1.5 of steel, transmission 3 of steel and 1 more.",
    ]
