"""Twins of the functions of colour.cl: sky radiance, tone mapping and encoding, in float64."""

from __future__ import annotations

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Bytes, Doubles, Floats


def sky_radiance(environment: Floats, height: Doubles) -> Doubles:
    """Radiance (..., 3) from directions whose unit vectors have this y, height (...): a linear gradient, fading to the
    ground. environment: float (10), see tables.environment_row."""
    zenith, horizon, ground = np.asarray(environment[:9], np.float64).reshape(3, 3)
    up = np.clip(height, 0, 1)[..., None]
    down = np.clip(-20 * height, 0, 1)[..., None]
    sky = horizon + (zenith - horizon) * up
    return sky + (ground - sky) * down


def sky_irradiance(environment: Floats, height: Doubles) -> Doubles:
    """Irradiance / pi (..., 3) on surfaces whose unit normals have this y, height (...); exact at -1, 0 and 1.

    environment: float (10), see tables.environment_row.
    """
    zenith, horizon, ground = np.asarray(environment[:9], np.float64).reshape(3, 3)
    height = height[..., None]
    level = 2 / (3 * np.pi)
    ground_share = (1 - height) / 2
    zenith_share = level + height / 3 + (1 / 3 - level) * height**2
    return ground * ground_share + zenith * zenith_share + horizon * (1 - ground_share - zenith_share)


def shown_as(colour: Doubles, exposure: float) -> Doubles:
    """The radiance (...) that exposure and tone mapping turn into a linear colour 0..1."""
    y = np.clip(colour, 0, 1)
    a, b = 2.51 - 2.43 * y, 0.03 - 0.59 * y
    return (np.sqrt(b * b + 0.56 * a * y) - b) / (2 * a * exposure)


def encode(radiance: Doubles) -> Bytes:
    """uint8 (..., 4) of radiance (..., 3): ACES tone mapping (Narkowicz 2015), sRGB (IEC 61966-2-1), alpha 255;
    not-a-number is black."""
    x = np.clip(np.nan_to_num(radiance, nan=0.0, posinf=1e4), 0, 1e4)
    x = np.minimum(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 1)
    encoded = np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)
    rgb = np.floor(encoded * 255 + 0.5).astype(np.uint8)
    return np.concatenate([rgb, np.full((*rgb.shape[:-1], 1), 255, np.uint8)], axis=-1)
