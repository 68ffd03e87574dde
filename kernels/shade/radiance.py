"""What samples send towards an eye, linear and before exposure: the kernel's launcher and its twin."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Doubles, Floats
from shading_atlas_bench.kernels.shade.shade import shaded_twin

if TYPE_CHECKING:
    from shading_atlas_bench.kernels.samples import Samples
    from shading_atlas_bench.kernels.shade.shader import Shader

STEP = 8  # samples shaded at once, by the narrowest kernel


def radiance(shader: Shader, samples: Samples, eye: Doubles, stage: str = "radiance") -> Floats:
    """Float32 (count, 3): radiance of the samples of a shader's scene, in their order. eye: float64 (3)."""
    device = shader.device
    found = device.empty((samples.triangle.size, 3), np.float32)
    kernel = device.build("shade/radiance.cl", **shader.defines).shade_radiance
    listed = (samples.triangle, samples.bary1, samples.bary2, samples.footprint, found)
    steps, place = -(-samples.count // STEP), (float(x) for x in eye)
    device.launch(stage, kernel, steps, samples.count, *listed, *place, *shader.arguments)
    return found.get()[: samples.count]


def radiance_twin(shader: Shader, samples: Samples, eye: Doubles) -> Doubles:
    """Float64 (count, 3): the same."""
    n = samples.count
    bary = np.stack([samples.bary1.get(), samples.bary2.get()], axis=1)[:n]
    known = (shader.tables, shader.faces.get(), shader.textures, shader.shadows.maps.get())
    with np.errstate(invalid="ignore"):
        return shaded_twin(*known, samples.triangle.get()[:n], bary, samples.footprint.get()[:n], eye)
