"""Cases of shading: everything a material can have, and what breaks it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Bytes
from shading_atlas_bench.kernels.case import Bound, Cost, Result, Trial, case, seeded
from shading_atlas_bench.kernels.samples import Samples
from shading_atlas_bench.kernels.shade.colour import encode
from shading_atlas_bench.kernels.shade.faces import face_rows, uv_scale_twin
from shading_atlas_bench.kernels.shade.inputs import (
    CASES,
    EYE,
    FULL,
    LIGHTS,
    PLAIN,
    TRIANGLES,
    make_samples,
    make_shader,
)
from shading_atlas_bench.kernels.shade.radiance import radiance as shaded_radiance
from shading_atlas_bench.kernels.shade.radiance import radiance_twin
from shading_atlas_bench.kernels.shade.shader import Shader
from shading_atlas_bench.kernels.shade.sky import paint_sky_twin

if TYPE_CHECKING:
    from shading_atlas_bench.kernels.device import Device


def colours_twin(shader: Shader, samples: Samples) -> Bytes:
    """The twin's colours, uint8 (count, 4), of the samples of a shader's own scene, in list order."""
    with np.errstate(invalid="ignore"):
        return encode(radiance_twin(shader, samples, EYE) * shader.tables.environment[9])


# Three lights with highlights, two shadow maps, five trilinear lookups and one in the environment map; 4 x 4 taps of a
# shadow's penumbra.
@case(
    {"shade.shade_samples": Cost("n", "(16 + 4 + 3*96 + 5*8*4 + 2*16*4 + 4*32)*n", "1200*n")},
    1 << 18,
    1 << 14,
    typical=Bound(wrong=2e-3),  # colours close to the middle between two levels
)
def shading(device: Device, kind: str, size: int) -> Trial:
    """Compares the colours of samples of everything a material can have. Adversarial: degenerate triangles, samples
    beyond them."""
    materials, lights, features = CASES["everything"]
    hard = kind == "adversarial"
    shader = make_shader(device, materials, lights, degenerate=hard, **features)
    samples = make_samples(device, count=size, adversarial=hard)
    target = device.zeros((1, samples.triangle.size, 4), np.uint8)

    def results() -> list[Result]:
        shader.shade(samples, EYE, target)
        found = target.get()[0, samples.texel.get()[:size]]
        return [Result(found, colours_twin(shader, samples))]

    return Trial({"n": size}, lambda: shader.shade(samples, EYE, target), results)


# One light, and the environment map. Directions are good to 5e-6, and neighbouring texels of the map are not alike.
@case(
    {"radiance.shade_radiance": Cost("n", "(16 + 12 + 3*32 + 4*32)*n", "300*n")},
    1 << 18,
    1 << 14,
    typical=Bound(1500),
    adversarial=Bound(1300),
)
def radiance(device: Device, kind: str, size: int) -> Trial:
    """Adversarial: triangles without area, normals without length, samples beyond their triangles."""
    materials, lights, features = CASES["environment map"]
    hard = kind == "adversarial"
    shader = make_shader(device, materials, lights, degenerate=hard, **features)
    samples = make_samples(device, count=size, adversarial=hard)

    def results() -> list[Result]:
        return [Result(shaded_radiance(shader, samples, EYE), radiance_twin(shader, samples, EYE))]

    return Trial({"n": size}, lambda: shaded_radiance(shader, samples, EYE), results)


# Colours close to the middle between two levels.
@case({"sky.paint_sky": Cost("n", "4*n", "60*n")}, 960, typical=Bound(wrong=1.5e-3))
def sky(device: Device, kind: str, size: int) -> Trial:
    """Adversarial: a horizon across a field of view of 170 degrees."""
    shader = make_shader(device, PLAIN, LIGHTS[:1])
    height, focal = size * 9 // 16, 0.09 if kind == "adversarial" else 0.8
    projection = np.array([[focal, 0, 0.1, 0], [0, focal * 16 / 9, -0.1, 0], [0, 0, 0, 0.1], [0, 0, -1, 0]])
    target = device.zeros((height, size, 4), np.uint8)

    def results() -> list[Result]:
        shader.sky(np.eye(4), projection, target)
        return [Result(target.get(), paint_sky_twin(np.eye(4), projection, size, height, shader.tables.environment))]

    return Trial({"n": size * height}, lambda: shader.sky(np.eye(4), projection, target), results)


@case(
    {"faces.uv_scales": Cost("n", "(12 + 3*32 + 8)*n", "30*n")},
    1 << 18,
    1 << 12,
    typical=Bound(25),
    adversarial=Bound(15),
)
def faces(device: Device, kind: str, size: int) -> Trial:
    """Adversarial: triangles with almost no area on the surface or in the texture."""
    shader, rng = make_shader(device, FULL, []), seeded(kind)
    vertices = shader.tables.vertices[rng.integers(0, 3 * TRIANGLES, 3 * size)]
    if kind == "adversarial":
        vertices[1::3, :3] = vertices[::3, :3] * (1 + 1e-4 * rng.normal(size=(size, 3)))
    indices = np.arange(3 * size, dtype=np.int32).reshape(-1, 3)
    uploaded, ids = (device.upload(vertices), device.upload(indices)), np.zeros(size, np.int32)

    def results() -> list[Result]:
        found = face_rows(device, *uploaded, ids).get()[:, 1].copy().view(np.float32)
        return [Result(found, uv_scale_twin(vertices, indices))]

    return Trial({"n": size}, lambda: face_rows(device, *uploaded, ids), results)
