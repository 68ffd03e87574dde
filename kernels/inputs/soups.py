"""Cameras and triangle soups."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from shading_atlas_bench.arithmetic.arrays import Doubles, Floats
from shading_atlas_bench.kernels.triangles import Triangles

if TYPE_CHECKING:
    from shading_atlas_bench.kernels.device import Device

NEAR = 0.1
FAR_EYE = np.array([1000.5, -20.25, 300.125])


def look_at(eye: ArrayLike, target: ArrayLike, up: tuple[float, float, float] = (0.0, 1.0, 0.0)) -> Doubles:
    """World to camera, float64 (4, 4), for a camera at `eye` (3) that looks at `target` (3)."""
    eye = np.asarray(eye, np.float64)
    back = eye - np.asarray(target, np.float64)
    back /= np.linalg.norm(back)
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    view = np.eye(4)
    view[:3, :3] = [right, np.cross(back, right), back]
    view[:3, 3] = -view[:3, :3] @ eye
    return view


def perspective(fov_x: float = 90.0, aspect: float = 1.5, shift: tuple[float, float] = (0.0, 0.0)) -> Doubles:
    """Projection float64 (4, 4), reversed depth, infinite far plane, optionally off-centre; fov_x is in degrees."""
    projection = np.zeros((4, 4))
    projection[0, 0] = 1 / np.tan(np.radians(fov_x) / 2)
    projection[1, 1] = projection[0, 0] * aspect
    projection[:2, 2] = shift
    projection[2, 3] = NEAR
    projection[3, 2] = -1
    return projection


def orthographic(half_width: float, half_height: float, length: float) -> Doubles:
    """Projection float64 (4, 4): depth 1 at the camera, 0 at `length`."""
    projection = np.diag([1 / half_width, 1 / half_height, 1 / length, 1.0])
    projection[2, 3] = 1
    return projection


def pixel_points(pixels: ArrayLike, width: int, height: int, distance: float = 1.0) -> Doubles:
    """Points, float64 (..., 3), that an identity view with perspective(90, width / height) projects to pixel positions
    (..., 2)."""
    pixels = np.asarray(pixels, np.float64)
    tangent = np.stack([2 * pixels[..., 0] / width - 1, (1 - 2 * pixels[..., 1] / height) * height / width], axis=-1)
    points: Doubles = np.concatenate([tangent, np.full((*pixels.shape[:-1], 1), -1.0)], axis=-1) * distance
    return points


def soup(device: Device, corners: ArrayLike, flags: ArrayLike = 0) -> Triangles:
    """Triangles (T, 3, 3) that share no corners; flags: one for all, or (T)."""
    corners = np.asarray(corners, np.float32).reshape(-1, 3)
    indices = np.arange(len(corners), dtype=np.int32).reshape(-1, 3)
    return Triangles.upload(device, corners, indices, np.full(len(indices), flags, np.uint8))


def random_soup(device: Device, rng: np.random.Generator, count: int, flags: int = Triangles.DOUBLE_SIDED) -> Triangles:
    """Triangles of sizes from 1e-3 to 10 around the origin, some far away, some slivers."""
    centres = rng.normal(0, 3, (count, 1, 3)) * 10.0 ** rng.uniform(0, 1, (count, 1, 1))
    sides = rng.normal(0, 1, (count, 3, 3)) * 10.0 ** rng.uniform(-3, 1, (count, 1, 1))
    thin = rng.random(count) < 0.1
    sides[thin, 2] = sides[thin, 1] + rng.normal(0, 1e-4, (thin.sum(), 3))
    return soup(device, centres + sides, flags)


def far_soup(rng: np.random.Generator, count: int = 400) -> Floats:
    """Triangles float32 (n, 3, 3) around a camera at FAR_EYE: of all sizes, behind it, through it, slivers, points."""
    size = 10.0 ** rng.uniform(-2.5, 1.2, (count, 1, 1))
    corners = FAR_EYE + rng.normal(size=(count, 1, 3)) * 6 + size * rng.normal(size=(count, 3, 3))
    corners[::7, 2] = corners[::7, 1] + 1e-3 * corners[::7, 2] - 1e-3 * FAR_EYE
    corners[5] = corners[5, 0]
    corners[6, 2] = corners[6, 1]
    corners[8, 0] = FAR_EYE
    corners[9] = FAR_EYE + np.array([[-30, -1.5, -30], [30, -1.5, -30], [0, -1.5, 40]])  # a floor below the camera
    corners[10] = FAR_EYE + np.array([[-2, -2, -2.5], [2, -2, -2.5], [0, 2, -2.5]])  # larger than the picture
    return corners.astype(np.float32)


def mixed_soup(rng: np.random.Generator, count: int, offset: float = 0.0) -> Floats:
    """Triangles float32 (n, 3, 3) of all sizes, ahead, beside, behind; slivers, points, equilateral ones among them."""
    middle = rng.normal(size=(count, 1, 3)) * [2, 1, 4] - [0, 0, 3]
    corners = middle + rng.normal(size=(count, 3, 3)) * 10.0 ** rng.uniform(-3, 0.7, (count, 1, 1))
    corners[::7, 2] = 0.5 * (corners[::7, 0] + corners[::7, 1]) + 1e-4 * corners[::7, 2]
    corners[::31] = corners[::31, :1]
    corners[5::29] = [[-1, 0, -4], [1, 0, -4], [0, np.sqrt(3), -4]]
    return (corners + offset).astype(np.float32)
