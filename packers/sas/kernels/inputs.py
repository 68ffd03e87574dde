"""Patches without a mesh: random triangles that share what their roles say they share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.kernels.triangles import Triangles
from shading_atlas_bench.packers.sas.kernels.layout import ROLE_POINTS, ROLE_SLOT, pack_location, pack_role
from shading_atlas_bench.packers.sas.kernels.tables import Patches, PatchTables
from shading_atlas_bench.packers.sas.kernels.visible import VisiblePatches

if TYPE_CHECKING:
    from shading_atlas_bench.arithmetic.arrays import Bytes, Floats, Ints, Words
    from shading_atlas_bench.kernels.device import Device


@dataclass(frozen=True)
class Soup(Patches):
    """Patches with their positions, float32 (V, 3), and indices, int32 (T, 3)."""

    positions: Floats
    indices: Ints

    def upload(self, device: Device) -> PatchTables:
        """Its tables on the device."""
        flags = np.zeros(len(self.indices), np.uint8)
        return PatchTables.upload(device, self, Triangles.upload(device, self.positions, self.indices, flags))


def all_visible(device: Device, masks: Bytes) -> VisiblePatches:
    """The patches 0, 1, ... of which `masks`, uint8 (n), says which members are in the set."""
    patches = np.arange(len(masks), dtype=np.int32)
    return VisiblePatches(len(masks), device.upload(patches), device.upload(masks))


ROLES = {1: (0,), 2: (0, 1), 3: (2, 3, 4)}


def random_patches(rng: np.random.Generator, count: int, size: int | None = None) -> Soup:
    """`count` patches of random sizes (or `size`), shapes, rotations and triangle numbers."""
    sizes = rng.integers(1, 4, count) if size is None else np.full(count, size)
    positions = rng.normal(size=(5 * count, 3)).astype(np.float32)
    triangles = int(sizes.sum())
    numbers = rng.permutation(triangles)
    indices, codes = np.zeros((triangles, 3), np.int32), np.zeros(triangles, np.uint8)
    of_triangle = np.zeros(triangles, np.int32)
    members, points = np.full((count, 3), -1, np.int32), np.full((count, 5), -1, np.int32)
    for patch in range(count):
        for role in ROLES[int(sizes[patch])]:
            triangle, numbers = numbers[0], numbers[1:]
            rotation = int(rng.integers(3))
            indices[triangle] = np.roll(5 * patch + ROLE_POINTS[role], rotation)
            codes[triangle] = pack_role(np.array([role]), np.array([rotation]))[0]
            of_triangle[triangle] = patch
            members[patch, ROLE_SLOT[role]] = triangle
            points[patch, ROLE_POINTS[role]] = 5 * patch + ROLE_POINTS[role]
    return Soup(of_triangle, codes, members, points, positions, indices)


def words_in_rows(levels: list[tuple[int, int]]) -> Words:
    """Location words, uint32 (n), of blocks of these levels, each alone in a square of 256 texels."""
    w, h = np.array(levels).T
    k = np.arange(len(levels))
    return pack_location(k % 16 * 256 + (k * 37 % 256 >> w << w), k // 16 * 256 + (k * 91 % 256 >> h << h), w, h)


def random_masks(rng: np.random.Generator, soup: Soup) -> Bytes:
    """uint8 (P): for each patch some of its members, at least one, as bits."""
    return rng.integers(1, 1 << soup.sizes()).astype(np.uint8)
