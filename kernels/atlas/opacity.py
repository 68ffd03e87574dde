"""How much a client's fragments cover: what was sent of their materials, or the alpha plane."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Bytes, Ints
from shading_atlas_bench.kernels.fragments.opacity import VARIES

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device


def fragment_opacity(
    device: Device, count: int, triangle: Array, drawn: Array, constants: Array, alphas: Array | None, stage: str
) -> Array:
    """int32 (n), 0..255; 0 where a fragment's triangle has no place (`drawn`, int32 (n), is negative).

    triangle: int32 (n), into constants, int32: the opacity of each triangle, or VARIES where that is in `alphas`, uint8
    (n, 4), grey; without these such triangles are opaque.
    """
    opacity = device.recycled(count, np.int32)
    plane = () if alphas is None else (alphas,)
    kernel = device.build("atlas/opacity.cl", PLANE=len(plane), VARIES=VARIES).fragment_opacity
    device.launch(stage, kernel, count, count, triangle, drawn, constants, opacity, *plane)
    return opacity


def fragment_opacity_twin(triangle: Ints, drawn: Ints, constants: Ints, alphas: Bytes | None) -> Ints:
    """The same; alphas uint8 (n)."""
    opaque = np.full(len(triangle), 255)
    covered = np.where(constants[triangle] == VARIES, opaque if alphas is None else alphas, constants[triangle])
    return np.where(drawn < 0, 0, covered).astype(np.int32)
