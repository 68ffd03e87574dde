"""Shading Atlas Streaming: patches of 1-3 triangles in power-of-two blocks that stay where they are.

See README.md in this folder for what is as published and what is ours.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.functions import log2, power
from shading_atlas_bench.packers.atlas_client import geometry_encoder
from shading_atlas_bench.packers.budget import ALL, BudgetedRate
from shading_atlas_bench.packers.interface import (
    FULL,
    ClientScene,
    Frame,
    Packer,
    Paper,
    Parameter,
    Payload,
    RareCost,
    ServerScene,
)
from shading_atlas_bench.packers.sas.client import ATTRIBUTES, ShadingAtlasClient, encode_words
from shading_atlas_bench.packers.sas.kernels.allocate import Allocator, Grid
from shading_atlas_bench.packers.sas.kernels.bias import needed_superblocks
from shading_atlas_bench.packers.sas.kernels.emit import Unfolded, count_asked, emit_samples
from shading_atlas_bench.packers.sas.kernels.footprint import SIZES, STEPS, measure_sides
from shading_atlas_bench.packers.sas.kernels.visible import visible_patches
from shading_atlas_bench.packers.sas.patches import cached_patches

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.samples import Samples

FEWEST_SUPERBLOCKS = 128  # of an atlas, when their side is chosen for it: the paper's settings give 128 to 256
LARGEST_BIAS = (SIZES - 1) / STEPS  # every block is a single texel
UNPLACED = "the atlas is full with every block at one texel"


class ShadingAtlasStreaming(Packer):
    """Packs patches into blocks; see the module."""

    name = "sas"
    paper = Paper("Shading Atlas Streaming", 2018, "10.1145/3272127.3275087")
    parameters = {  # noqa: RUF012
        "superblock": Parameter(
            0,
            (0, 128, 256),
            "side of the squares that hold blocks of one size, and of the largest block; 0 chooses: 256 for atlases of "
            "8 million texels and more, 128 below, less where an atlas would hold fewer than 128 of them",
            "texels",
            "128 and 256: SAS as quoted in FastAtlas, appendix B; smaller atlases: ours",
            choices=(0, 1, 2, 4, 8, 16, 32, 64, 128, 256),
        ),
        "bias": Parameter(
            "atlas",
            ("atlas", "picture"),
            "what the allocation bias holds the samples down to: what the atlas has room for, or the pixels of the "
            "server's view as well, which is the picture that they replace",
            "",
            "picture: SnakeBinning, section 5.2; atlas: ours",
            choices=("atlas", "picture"),
        ),
        "fit": Parameter(
            0.75,
            (0.5, 0.75, 0.9),
            "share of the superblocks that one frame's request may take; the rest is room until the next reset",
            "1",
            "ours",
            limits=(0.01, 1.0),
        ),
        "reuse": Parameter(
            False,
            (False, True),
            "whether the blocks of hidden or resized patches serve others before the atlas is full",
            "",
            "false: SAS as quoted in SnakeBinning, section 2",
        ),
        "complete": Parameter(
            False,
            (False, True),
            "whether every texel of a block is shaded, not only those that lookups touch",
            "",
            "true: SAS as quoted in Tessellated Shading Streaming, section 5.3; false: ours",
            published=True,
        ),
    }

    def prepare(self, scene: ServerScene) -> None:
        """Find the patches and upload them."""
        self.patches = cached_patches(scene.host)
        upload = scene.device.upload
        self.of_triangle, self.points = upload(self.patches.of_triangle), upload(self.patches.points)
        self.members = upload(self.patches.members)
        self.unfolded = Unfolded.measure(scene.device, self.members, upload(self.patches.codes), scene.triangles)
        self.marks = scene.device.zeros(max(1, scene.triangles.count), np.int32)
        self.mark, self.budgeted = 0, BudgetedRate(lowest=float(power(2.0, -LARGEST_BIAS)))
        attributes = dict(zip(ATTRIBUTES, (self.patches.of_triangle, self.patches.codes), strict=True))
        self.geometry = geometry_encoder(scene, attributes)
        self.sent, self.changed = np.zeros(self.patches.count, np.uint32), True
        self.allocator: Allocator | None = None

    def settled(self) -> bool:
        """Blocks stay where they are once a set has them, as long as nothing was reset for lack of room."""
        return not self.changed

    def rare_costs(self) -> tuple[RareCost, ...]:
        """All blocks are given up at once when no superblock is left."""
        return (RareCost("an atlas reset", "when the atlas is full", "resets"),)

    def pack(self, frame: Frame) -> Payload:
        """Blocks for the patches in the frame's set, and their shading; the first frame's atlas size is kept."""
        device = frame.scene.device
        if self.allocator is None:
            grid = choose_grid(frame.atlas_width, frame.atlas_height, self.superblock)
            self.allocator = Allocator(device, grid, self.patches.count, self.reuse)
        self.mark += 1
        known = (self.of_triangle, self.members, self.marks, self.mark)
        patches, masks, count = visible_patches(device, frame.pvs_device, len(frame.pvs), *known)
        sizes, bias = self._measure(frame, patches, masks, count)
        resets = self.allocator.resets
        self.allocator.allocate(patches, count, sizes, bias, self.members, self.marks, self.mark)
        words = self.allocator.read(patches, count)
        shown = patches.get()[:count]
        self.changed = self.allocator.resets > resets or not np.array_equal(words, self.sent[shown])
        listed = (patches, masks, count, self.allocator.words)
        samples, without = emit_samples(device, *listed, self.unfolded, frame.atlas_width, self.complete)
        is_full = frame.sample_budget is None and self.bias == "atlas" and self.budgeted.rate < 1
        found = {"bias": 0.0 - float(log2(self.budgeted.rate)), "triangles_without_texel": without, FULL: int(is_full)}
        return self._payload(frame, shown, words, samples, found)

    def _measure(self, frame: Frame, patches: Array, masks: Array, count: int) -> tuple[Array, int]:
        """Sizes of the patches' sides and the bias, in eighths, that holds the request down to what `fit` allows and to
        the samples that are asked for; the largest bias if none does.

        The rate of the search is the bias as a factor. Whole eighths of it are the bias that is returned, and the rest,
        which makes it any number, is in the sizes.
        """
        device, server, grid = frame.scene.device, frame.server, self.allocator.grid
        room = int(self.fit * grid.total)
        last: tuple[Array, int]

        def needed(rate: float) -> int | None:
            nonlocal last
            bias = int(np.clip(np.ceil(-STEPS * float(log2(rate))), 0, SIZES - 1))
            pixels = rate * float(power(2.0, bias / STEPS)) * server.pixels_per_tangent
            seen = (frame.scene.triangles.positions, server.eye, pixels)
            sizes, histogram = measure_sides(device, patches, count, self.points, *seen)
            last = sizes, bias
            superblocks = int(needed_superblocks(device, histogram, grid.top)[bias])
            return superblocks if superblocks <= room else None

        def samples(rate: float) -> int | None:
            if needed(rate) is None:
                return None
            return count_asked(
                device, patches, masks, count, *last, grid.top, self.patches.count, self.unfolded.members, self.complete
            )

        if frame.sample_budget is not None:
            self.budgeted.meet(frame.sample_budget, samples)
        elif self.bias == "picture":
            pixels = sum(view.width * view.height for view in frame.cell_views)
            self.budgeted.meet(pixels, samples, highest=1.0)
        else:
            self.budgeted.meet(ALL, needed, highest=1.0)
        return last

    def _payload(
        self, frame: Frame, patches: np.ndarray, words: np.ndarray, samples: Samples, found: dict[str, float]
    ) -> Payload:
        locations = encode_words(words, self.sent[patches])
        self.sent[patches] = words
        lost = patches[words == 0]
        of_pvs = self.patches.of_triangle[frame.pvs]
        unplaced = {int(t): UNPLACED for t in frame.pvs[np.isin(of_pvs, lost)]} if len(lost) else {}
        allocator, grid = self.allocator, self.allocator.grid
        in_use = allocator.superblocks_in_use()
        sizes = np.bincount(self.patches.sizes(patches), minlength=4)
        blocks = allocator.blocks_by_class()
        statistics = (
            found
            | {f"patches_of_{k}": int(sizes[k]) for k in (1, 2, 3)}
            | {
                "resets": allocator.resets,
                "superblocks": in_use,
                "blocks": int(blocks.sum()),
                "size_classes": int((blocks > 0).sum()),
                "reserved_texels": in_use << 2 * grid.top,
                "used_texels": samples.count,
                "location_bytes": len(locations),
            }
        )
        return Payload(
            planes=frame.shade(samples),
            blobs={"locations": locations},
            geometry=self.geometry.encode(frame.pvs),
            sample_count=samples.count,
            samples=samples,
            unplaced=unplaced,
            statistics=statistics,
        )

    def client(self, scene: ClientScene) -> ShadingAtlasClient:
        """A client without any triangle yet."""
        return ShadingAtlasClient(scene)


def choose_grid(width: int, height: int, superblock: int) -> Grid:
    """The superblocks of an atlas; a side of 0 is chosen for it. What their rows and columns leave over is not used.

    Raises ValueError for a side that is not a power of two from 1 to 256, or does not fit.
    """
    side = superblock
    if superblock == 0:
        side = 256 if width * height >= 8_000_000 else 128
        while side > 1 and (width // side) * (height // side) < FEWEST_SUPERBLOCKS:
            side //= 2
    if side not in (1, 2, 4, 8, 16, 32, 64, 128, 256):
        raise ValueError(f"The superblock side {superblock} is not a power of two from 1 to 256 (0 chooses one).")
    if side > min(width, height):
        raise ValueError(
            f"A superblock of {side} texels does not fit into a {width}x{height} atlas: give a smaller side, or 0."
        )
    return Grid(side.bit_length() - 1, width // side, height // side)
