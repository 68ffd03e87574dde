"""Pictures for the metrics: something like a rendering, kinds of damage, and the cases that break metrics."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Bytes, Doubles

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device


def rendering(height: int, width: int, seed: int = 0) -> Bytes:
    """Uint8 (h, w, 3): smooth shading, hard edges, fine texture, saturated and flat parts."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0:height, 0:width] / 64
    waves = np.stack([np.sin(x * (k + 1) + y * (2 - k) + rng.uniform(0, 6)) for k in range(3)], axis=-1)
    image = 128 + 60 * waves + 25 * np.sin(9 * x * y)[..., None]
    cells = rng.integers(0, 256, (height // 24 + 1, width // 24 + 1, 3)).repeat(24, axis=0).repeat(24, axis=1)
    blocky = rng.random((height // 48 + 1, width // 48 + 1)) < 0.4
    blocky = blocky.repeat(48, axis=0).repeat(48, axis=1)[:height, :width]
    image[blocky] = cells[:height, :width][blocky]
    image[: height // 5, : width // 4] = [255, 0, 0]
    image[: height // 8, -width // 3 :] = 17
    grainy: Doubles = image + rng.normal(0, 3, image.shape)
    return np.clip(grainy, 0, 255).astype(np.uint8)


def damaged(image: Bytes, kind: str, seed: int = 0) -> Bytes:
    """The picture, uint8 (h, w, 3), with noise, blur, a shift, a wrong brightness, blocks of one colour, or one wrong
    pixel."""
    rng = np.random.default_rng(seed)
    values: Doubles = image.astype(np.float64)
    if kind == "noise":
        values += rng.normal(0, 12, image.shape)
    elif kind == "blur":
        rolled = (np.roll(values, s, axis=a) for a in (0, 1) for s in (-2, -1, 0, 1, 2))
        values = sum(rolled, np.zeros(image.shape)) / 10
    elif kind == "shift":
        values = np.roll(values, (1, 2), axis=(0, 1))
    elif kind == "bright":
        values = values * 1.15 + 8
    elif kind == "blocks":
        values[::8] = values[4:5]
    elif kind == "pixel":
        values[image.shape[0] // 2, image.shape[1] // 3] = 255 - values[image.shape[0] // 2, image.shape[1] // 3]
    return np.clip(values, 0, 255).astype(np.uint8)


KINDS = ("noise", "blur", "shift", "bright", "blocks", "pixel")


def flat(height: int, width: int, colour: tuple[int, int, int]) -> Bytes:
    """One colour everywhere: uint8 (height, width, 3)."""
    return np.broadcast_to(np.array(colour, np.uint8), (height, width, 3)).copy()


def on_device(device: Device, image: Bytes) -> Array:
    """The picture as the metrics take it: uint8 (h, w, 4), with an alpha that must not matter."""
    height, width = image.shape[:2]
    alpha = np.random.default_rng(5).integers(0, 256, (height, width, 1)).astype(np.uint8)
    return device.upload(np.concatenate([image, alpha], axis=2))
