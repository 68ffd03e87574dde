"""Capturing an environment map: a scene drawn from one point in all directions, without the map."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Doubles, Floats, Ints
from shading_atlas_bench.arithmetic.matrices import matvec
from shading_atlas_bench.kernels.raster.resolve import resolve
from shading_atlas_bench.kernels.shade.colour import sky_radiance
from shading_atlas_bench.kernels.shade.radiance import radiance

if TYPE_CHECKING:
    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.kernels.raster.rasteriser import Rasteriser
    from shading_atlas_bench.kernels.shade.shader import Shader

SIDE = 256  # pixels of each face of the cube around the point
# Of what the exposure turns into white, a few times over. A lamp's shell, centimetres from its light, sends thousands.
BRIGHTEST = 16.0
# Right, up and backward of the cameras that look along x, -x, y, -y, z, -z.
FACES = np.array(
    [
        [[0, 0, 1], [0, 1, 0], [-1, 0, 0]],
        [[0, 0, -1], [0, 1, 0], [1, 0, 0]],
        [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
        [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
        [[-1, 0, 0], [0, 1, 0], [0, 0, -1]],
        [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    ],
    np.float64,
)

Seen = Callable[[Doubles], Doubles]


def sky_around(shader: Shader) -> Seen:
    """Radiance (n, 3) of a scene's sky and ground alone, from unit directions (n, 3)."""
    return lambda direction: sky_radiance(shader.tables.environment, direction[:, 1])


def scene_around(
    device: Device, rasteriser: Rasteriser, ids: Ints | None, shader: Shader, point: Doubles, near: float
) -> Seen:
    """Radiance (n, 3) that arrives at a point, float64 (3), from unit directions (n, 3), up to BRIGHTEST / exposure.

    Lights themselves are not in it: they shine on surfaces by their own term. What glows is.
    ids: int32, the shader's triangles that the rasteriser draws, None for all of them. near: in scene units.
    """
    brightest = BRIGHTEST / float(shader.tables.environment[9])
    sky, faces = sky_around(shader), []
    for face in FACES:
        view = np.eye(4)
        view[:3, :3], view[:3, 3] = face, -matvec(face, point)
        faces.append(_face(device, rasteriser, ids, shader, point, view, near))
    pictures = np.clip(np.nan_to_num(np.stack(faces), nan=0.0, posinf=brightest), -1, brightest)

    def arriving(direction: Doubles) -> Doubles:
        face = 2 * np.argmax(np.abs(direction), axis=1)
        face += np.take_along_axis(direction, face[:, None] // 2, axis=1)[:, 0] < 0
        x, y, z = matvec(FACES[face], direction).T
        column, row = ((np.minimum((1 + part / -z) * (SIDE / 2), SIDE - 1)).astype(int) for part in (x, -y))
        seen = pictures[face, row, column].astype(np.float64)
        return np.where(seen < 0, sky(direction), seen)

    return arriving


def _face(
    device: Device,
    rasteriser: Rasteriser,
    ids: Ints | None,
    shader: Shader,
    point: Doubles,
    view: Doubles,
    near: float,
) -> Floats:
    """Radiance float32 (SIDE, SIDE, 3) as a camera sees it that looks 45 degrees to each side; -1 where the sky is."""
    projection = np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, near], [0, 0, -1, 0]])
    visible = rasteriser.draw(view, projection, SIDE, SIDE, stage="environment map")
    samples = resolve(device, rasteriser.triangles, visible, view, projection, stage="environment map")
    if ids is not None:
        own = samples.triangle.get()
        own[: samples.count] = ids[own[: samples.count]]
        samples.triangle.set(own)
    picture = np.full((SIDE * SIDE, 3), -1, np.float32)
    if samples.count:
        # Black metal sends a little less than nothing: the fit of its reflectance goes below 0.
        seen = np.maximum(radiance(shader, samples, point, "environment map"), 0)
        picture[samples.texel.get()[: samples.count]] = seen
    return picture.reshape(SIDE, SIDE, 3)
