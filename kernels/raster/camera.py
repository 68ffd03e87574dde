"""A camera as the raster kernels take it: eye-relative, so that large coordinates keep their precision."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Array, Doubles
from shading_atlas_bench.arithmetic.matrices import inverse, matvec, product, transform
from shading_atlas_bench.kernels.constants import constants_of

if TYPE_CHECKING:
    from pyopencl.typing import KernelArg

DEFINED = constants_of(Path(__file__).with_name("camera.cl"))
SUBPIXELS = DEFINED.whole("SUBPIXELS")  # positions on screen are snapped to 1/256 pixel
LARGEST_SIZE = 8192


@dataclass(frozen=True)
class Camera:
    """A view and a projection for an image size.

    eye: float64 (3). rows: float64 (4, 4), acting on (p - eye, 1): x and y in sub-pixels right of and below the
    image's centre (times w), z and w as in clip space, so that z / w is the depth.
    """

    eye: Doubles
    rows: Doubles
    width: int
    height: int

    @classmethod
    def of(cls, view: Doubles, projection: Doubles, width: int, height: int) -> Camera:
        """The camera of a view and a projection, float64 (4, 4), for a picture of this width and height in pixels.

        Raises ValueError for matrices or sizes that cannot be drawn.
        """
        view, projection = np.asarray(view, np.float64), np.asarray(projection, np.float64)
        if view.shape != (4, 4) or projection.shape != (4, 4) or not np.isfinite([view, projection]).all():
            raise ValueError("View and projection must be finite 4 x 4 matrices.")
        if not (1 <= width <= LARGEST_SIZE and 1 <= height <= LARGEST_SIZE):
            raise ValueError(f"The image is {width} x {height} pixels; both sides must be 1 to {LARGEST_SIZE}.")
        eye = -matvec(inverse(view[:3, :3]), view[:3, 3])
        rows = np.column_stack([product(projection[:, :3], view[:3, :3]), projection[:, 3]])
        rows[0] *= width * SUBPIXELS / 2
        rows[1] *= -height * SUBPIXELS / 2
        return cls(eye, rows, width, height)

    def arguments(self) -> tuple[KernelArg, KernelArg]:
        """The kernels' `eye` (float4) and `rows` (float16) arguments; see camera.cl."""
        from pyopencl import cltypes

        eye = self.eye.astype(np.float32)
        constants = self.rows[:, 3] - matvec(self.rows[:, :3], self.eye - eye)
        rows = np.column_stack([self.rows[:, :3], constants]).astype(np.float32)
        return np.array((*eye, 0), cltypes.float4), np.array(tuple(rows.ravel()), cltypes.float16)

    def project(self, points: Array) -> Doubles:
        """Float64 (..., 4) of points (..., 3): x and y in sub-pixels from the centre times w, z, w."""
        points = np.asarray(points, np.float64) - self.eye
        return transform(self.rows, points.reshape(-1, 3)).reshape(*points.shape[:-1], 4)
