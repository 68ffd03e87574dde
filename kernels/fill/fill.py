"""Colours for the texels of an atlas that nothing owns, so that they cost a codec little and bleed little."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Bytes
from shading_atlas_bench.kernels.constants import constants_of

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device

DEFINED = constants_of(Path(__file__).with_name("fill.cl"))
PIECE = DEFINED.whole("PIECE")


def _levels(width: int, height: int) -> list[tuple[int, int]]:
    """Widths and heights from the plane down to one texel."""
    sizes = [(width, height)]
    while sizes[-1] != (1, 1) or len(sizes) < 2:
        width, height = sizes[-1]
        sizes.append((-(-width // 2), -(-height // 2)))
    return sizes


class Filler:
    """Fills the frames of one plane of a video, remembering the last one.

    A texel that is not owned takes the mean of owned ones around it (push-pull: the finest 2^k x 2^k square with any);
    if it was not owned in the last frame either, it keeps the colour it had there. Owned means alpha above 0.
    """

    def __init__(self, device: Device, width: int, height: int) -> None:
        self.device, self.kernels = device, device.build("fill/fill.cl")
        self.sizes = _levels(width, height)
        self.filled = device.empty((height, width, 4), np.uint8)
        self.reset()

    def reset(self) -> None:
        """Forget the last frame."""
        self.device.fill(self.filled, 255)

    def fill(self, atlas: Array) -> Array:
        """The filled plane of the next frame, uint8 (h, w, 4), with the alpha of `atlas`; good until the next call."""
        levels = [self.device.recycled((h, w, 4), np.uint8) for w, h in self.sizes[1:]]
        planes, launch, kernels = [atlas, *levels], self.device.launch, self.kernels
        for k in range(len(levels)):
            size = (*self.sizes[k], *self.sizes[k + 1])
            launch("fill/pull", kernels.pull, self._items(k + 1), *size, planes[k], planes[k + 1])
        for k in range(len(levels) - 1, 0, -1):
            size = (*self.sizes[k], *self.sizes[k + 1])
            launch("fill/push", kernels.push, self._items(k), *size, planes[k + 1], planes[k])
        size = (*self.sizes[0], *self.sizes[1])
        launch("fill/finish", kernels.finish, self._items(0), *size, planes[1], atlas, self.filled)
        return self.filled

    def _items(self, k: int) -> int:
        width, height = self.sizes[k]
        return -(-width // PIECE) * height


def fill_twin(atlas: Bytes, before: Bytes | None) -> Bytes:
    """The filled plane of `atlas`, uint8 (h, w, 4) both; before: the last filled plane with its alpha, (h, w, 4), None
    for the first frame."""
    pyramid = [np.where(atlas[..., 3:] > 0, atlas, 0).astype(np.int64)]
    pyramid[0][..., 3] = pyramid[0][..., 3] > 0
    while len(pyramid) < 2 or pyramid[-1].shape[:2] != (1, 1):
        fine = pyramid[-1]
        height, width = fine.shape[:2]
        even = np.pad(fine, ((0, height % 2), (0, width % 2), (0, 0)))
        quads = even.reshape(-(-height // 2), 2, -(-width // 2), 2, 4).sum(axis=(1, 3))
        count = quads[..., 3:]
        mean = (quads[..., :3] + count // 2) // np.maximum(count, 1)
        pyramid.append(np.concatenate([mean, count > 0], axis=2))
    colour = pyramid[-1]
    for fine in pyramid[-2::-1]:
        parent = colour.repeat(2, axis=0).repeat(2, axis=1)[: fine.shape[0], : fine.shape[1]]
        colour = np.where(fine[..., 3:] > 0, fine, parent)
    filled = np.concatenate([colour[..., :3], atlas[..., 3:]], axis=2).astype(np.uint8)
    if before is None:
        return filled
    return np.where((atlas[..., 3:] == 0) & (before[..., 3:] == 0), before, filled)
