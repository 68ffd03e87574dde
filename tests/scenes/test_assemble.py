"""What is not a number in a scene is dropped or replaced, counted, and stops nothing else."""

from __future__ import annotations

import numpy as np

from scenes.assemble import assemble
from scenes.model import Light, Material
from scenes.raw import Part, RawScene

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
