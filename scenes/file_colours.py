"""Colours as mesh files keep them: sRGB, in whole numbers of some size or in 0 to 1."""

from __future__ import annotations

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Array, Doubles, Floats
from shading_atlas_bench.arithmetic.functions import power
from shading_atlas_bench.scenes.raw import RawScene


def linear_colours(raw: RawScene, *channels: Array) -> Floats:
    """Linear RGBA float32 (N, 4), alpha 1, from sRGB colours: red, green, blue and perhaps alpha, as columns (N, k) of
    one or more arrays, each of one type.

    Opacity is noted and left out: none of these formats tells whether it is meant to be seen through.
    """
    rgba = np.concatenate([_scaled(values, raw) for values in channels], axis=1)
    rgb = rgba[:, :3]
    if rgba.shape[1] == 4:
        raw.note("Vertices or faces with an opacity of their own, drawn opaque: {}.", (rgba[:, 3] < 1).sum())
    raw.note("Colours outside 0 to 1, limited: {}.", ((rgb < 0) | (rgb > 1)).any(axis=1).sum())
    rgb = np.clip(rgb, 0, 1)
    linear = np.ones((len(rgb), 4), np.float32)
    linear[:, :3] = np.where(rgb <= 0.04045, rgb / 12.92, power((rgb + 0.055) / 1.055, 2.4))
    return linear


def _scaled(values: Array, raw: RawScene) -> Doubles:
    """Numbers (N, k) of one type as float64 of 0 to 1.

    The type tells which value means 1, or, where files are known to differ from it (noted), the largest value does.
    """
    values = values.view(np.uint8) if values.dtype == np.int8 else values
    usual, full = _full(values)
    if full != usual:
        raw.note(
            f"Vertex or face colours of type {values.dtype}, taken as numbers from 0 to {full:,}: {{}}.", len(values)
        )
    return values.astype(np.float64) / full


def whole(values: Array) -> Array:
    """Numbers of a text without types, of any shape: as uint8 where they are whole, from 0 to 255, and not just 0 and
    1, else as they are."""
    if not (np.isfinite(values).all() and values.min(initial=0) >= 0 and 1 < values.max(initial=0) <= 255):
        return values
    return values.astype(np.uint8) if (values == np.floor(values)).all() else values


def _full(values: Array) -> tuple[int, int]:
    """What a type's colours usually mean by 1, and what these do."""
    largest = np.max(values, where=np.isfinite(values), initial=0)
    if values.dtype.kind == "f":
        # A little above 1 is a colour brighter than white.
        return 1, 1 if largest < 2 or largest > 65535 else 255 if largest <= 255 else 65535
    if values.dtype.itemsize == 1:
        return 255, 255
    fits = next(full for full in (255, 65535, 2**32 - 1, 2**64) if largest <= full)
    return (65535 if values.dtype.itemsize == 2 else fits), fits
