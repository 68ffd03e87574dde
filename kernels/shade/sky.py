"""The sky behind a picture: rays of its pixels, and the twin of the kernel that paints them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Bytes, Doubles, Floats
from shading_atlas_bench.arithmetic.matrices import product
from shading_atlas_bench.kernels.shade.colour import encode, sky_radiance

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device

STEP = 8  # pixels painted at once, by the narrowest kernel


@dataclass(frozen=True)
class Sky:
    """The sky of a scene; environment: float32 (10) on the device, see tables.environment_row."""

    device: Device
    environment: Array

    def __call__(self, view: Doubles, projection: Doubles, target: Array, stage: str = "shade/sky") -> None:
        """Paint the sky over all of `target`, uint8 (H, W, 4), as a camera (float64 4x4 each) sees it; alpha 255."""
        height, width = target.shape[:2]
        rays = self.device.upload(pixel_rays(view, projection, width, height).astype(np.float32))
        kernel = self.device.build("shade/sky.cl").paint_sky
        groups = -(-width // STEP) * height
        self.device.launch(stage, kernel, groups, width, height, rays, self.environment, target)


def pixel_rays(view: Doubles, projection: Doubles, width: int, height: int) -> Doubles:
    """float64 (9): the direction through the centre of pixel (0, 0), and its steps per column and per row.

    view, projection: float64 (4, 4), a perspective with the conventions of the packer interface.
    """
    x, y = 1 / width - 1 + projection[0, 2], 1 - 1 / height + projection[1, 2]
    right, up = 1 / projection[0, 0], 1 / projection[1, 1]
    rays = np.array([[x * right, y * up, -1.0], [2 / width * right, 0, 0], [0, -2 / height * up, 0]])
    return product(rays, view[:3, :3]).ravel()


def paint_sky_twin(view: Doubles, projection: Doubles, width: int, height: int, environment: Floats) -> Bytes:
    """uint8 (height, width, 4): the sky as a camera sees it.

    view, projection: float64 (4, 4). environment: float (10), see tables.environment_row.
    """
    origin, right, down = pixel_rays(view, projection, width, height).reshape(3, 3)
    rows, columns = np.mgrid[:height, :width]
    rays = origin + columns[..., None] * right + rows[..., None] * down
    up = rays[..., 1] / np.linalg.norm(rays, axis=-1)
    return encode(sky_radiance(environment, up) * environment[9])
