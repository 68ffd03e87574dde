"""Fragments as rows of words: what lists hold and what is sent (table 2.1 of the thesis)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.arithmetic.arrays import Doubles, Floats, Words
    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.kernels.fragments.build import Fragments
    from shading_atlas_bench.kernels.samples import Samples
    from shading_atlas_bench.kernels.triangles import Triangles

HERE = Path(__file__).parent

COLOUR_WORDS = 2  # colour, depth
NORMAL_WORDS = 5  # colour, normal, x, y, distance


def rays(projection: Doubles, width: int, height: int) -> Floats:
    """float32 (4): eye-space x over distance is r[0] * column + r[1], y over distance r[2] * row + r[3].

    projection: float64 (4, 4), perspective, symmetric or off-centre.
    """
    steps = np.array([2 / width / projection[0, 0], -2 / height / projection[1, 1]])
    start = np.array([(-1 + projection[0, 2]) / projection[0, 0], (1 + projection[1, 2]) / projection[1, 1]])
    return np.stack([steps, start + steps / 2], axis=1).ravel().astype(np.float32)


def colour_rows(device: Device, fragments: Fragments, colours: Array, opacity: Array | None, stage: str) -> Array:
    """uint32 (n, 2): RGBA bytes and the bits of the depth.

    colours: uint8 (1, n, 4). opacity: int32 (n), 0..255; None where all is 255.
    """
    blended = () if opacity is None else (opacity,)
    rows = device.recycled((fragments.count, COLOUR_WORDS), np.uint32)
    kernel = device.build(HERE / "rows.cl", BLENDED=len(blended)).colour_rows
    device.launch(stage, kernel, fragments.count, fragments.count, colours, fragments.depth, rows, *blended)
    return rows


def normal_rows(
    device: Device,
    fragments: Fragments,
    colours: Array,
    opacity: Array | None,
    triangles: Triangles,
    vertices: Array,
    projection: Doubles,
    stage: str,
) -> Array:
    """uint32 (n, 5): RGBA bytes, normal, and the bits of eye-space x, y and distance.

    colours, opacity: as for `colour_rows`. projection: float64 (4, 4). vertices: float32 (V, 8), normals in 3 to 5
    (shade.tables). The normal, in scene space, is two half floats: azimuth
    atan2(y, x) and inclination from +z.
    """
    blended = () if opacity is None else (opacity,)
    rows = device.recycled((fragments.count, NORMAL_WORDS), np.uint32)
    samples, near = fragments.samples, float(projection[2, 3])
    view = (fragments.width, rays(projection, fragments.width, fragments.height), near)
    surface = (samples.triangle, samples.bary1, samples.bary2, triangles.indices, vertices, rows, *blended)
    inputs = (fragments.count, colours, fragments.depth, samples.texel)
    kernel = device.build(HERE / "rows.cl", BLENDED=len(blended)).normal_rows
    device.launch(stage, kernel, -(-fragments.count // 8), *inputs, *view, *surface)
    return rows


def normals_twin(words: Words) -> Doubles:
    """Unit normals, float64 (n, 3), of packed ones, uint32 (n) (eq. 2.2)."""
    theta, phi = np.ascontiguousarray(words).view(np.float16).reshape(-1, 2).astype(np.float64).T
    return np.stack([np.sin(phi) * np.cos(theta), np.sin(phi) * np.sin(theta), np.cos(phi)], axis=1)


def rows_twin(
    samples: Samples,
    depth: Floats,
    triangles: Triangles,
    normals: Floats,
    projection: Doubles,
    width: int,
    height: int,
) -> tuple[Doubles, Doubles]:
    """Unit normals and positions (x, y, distance), float64 (n, 3) each, of fragments with depth (n).

    normals: (V, 3), of the vertices. projection: float64 (4, 4).
    """
    n = samples.count
    bary = np.stack([samples.bary1.get()[:n], samples.bary2.get()[:n]], axis=1).astype(np.float64)
    weights = np.concatenate([1 - bary.sum(axis=1, keepdims=True), bary], axis=1)
    at = triangles.host_indices[samples.triangle.get()[:n]]
    smooth = np.einsum("ni,nif->nf", weights, normals.astype(np.float64)[at])
    pixel, distance = samples.texel.get()[:n], projection[2, 3] / depth.astype(np.float64)
    ndc_x = 2 * (pixel % width + 0.5) / width - 1
    ndc_y = 1 - 2 * (pixel // width + 0.5) / height
    x = (ndc_x + projection[0, 2]) / projection[0, 0] * distance
    y = (ndc_y + projection[1, 2]) / projection[1, 1] * distance
    return smooth / np.linalg.norm(smooth, axis=1, keepdims=True), np.stack([x, y, distance], axis=1)
