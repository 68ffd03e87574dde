"""Shading Atlas Streaming: patches of 1-3 triangles in power-of-two blocks that stay where they are.

See README.md in this folder for what is as published and what is ours.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np

from shading_atlas_bench.packers.atlas_client import geometry_encoder
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
from shading_atlas_bench.packers.sas.bias import AllocationBias
from shading_atlas_bench.packers.sas.client import ShadingAtlasClient
from shading_atlas_bench.packers.sas.kernels.allocate import Allocator
from shading_atlas_bench.packers.sas.kernels.emit import emit_samples
from shading_atlas_bench.packers.sas.kernels.tables import PatchTables
from shading_atlas_bench.packers.sas.kernels.visible import Marks, visible_patches
from shading_atlas_bench.packers.sas.locations import Locations
from shading_atlas_bench.packers.sas.patches import cached_patches
from shading_atlas_bench.packers.sas.statistics import describe
from shading_atlas_bench.packers.sas.superblocks import SIDES, choose_grid

if TYPE_CHECKING:
    from shading_atlas_bench.arithmetic.arrays import Ints

UNPLACED = "the atlas is full with every block at one texel"


class ShadingAtlasStreaming(Packer):
    """Packs patches into blocks; see the module."""

    name = "sas"
    paper = Paper("Shading Atlas Streaming", 2018, "10.1145/3272127.3275087")
    superblock: int
    bias: str
    fit: float
    reuse: bool
    complete: bool
    parameters: ClassVar[dict[str, Parameter]] = {
        "superblock": Parameter(
            0,
            (0, 128, 256),
            "side of the squares that hold blocks of one size, and of the largest block; 0 chooses: 256 for atlases of "
            "8 million texels and more, 128 below, less where an atlas would hold fewer than 128 of them",
            "texels",
            "128 and 256: SAS as quoted in FastAtlas, appendix B; smaller atlases: ours",
            choices=(0, *SIDES),
        ),
        "bias": Parameter(
            "atlas",
            ("atlas", "picture"),
            "what the allocation bias holds the samples down to: what the atlas has room for, or the pixels of the "
            "views that cover the cell as well: the picture that they replace",
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
        self.tables = PatchTables.upload(scene.device, self.patches, scene.triangles)
        self.marks = Marks.none(scene.device, scene.triangles.count)
        self.allocation_bias = AllocationBias(self.tables, self.fit, self.bias == "picture", self.complete)
        self.allocator: Allocator | None = None
        self.locations, self.changed = Locations(self.patches.count), True
        self.geometry = geometry_encoder(scene, {"patch": self.patches.of_triangle, "code": self.patches.codes})

    def settled(self) -> bool:
        """Blocks stay where they are once a set has them, as long as nothing was reset for lack of room."""
        return not self.changed

    def rare_costs(self) -> tuple[RareCost, ...]:
        """All blocks are given up at once when no superblock is left."""
        return (RareCost("an atlas reset", "when the atlas is full", "resets"),)

    def pack(self, frame: Frame) -> Payload:
        """Blocks for the patches in the frame's set, and their shading; the first frame's atlas size is kept."""
        device, allocator = frame.scene.device, self._allocator(frame)
        visible = visible_patches(device, frame.pvs_device, len(frame.pvs), self.tables, self.marks)
        request, resets = self.allocation_bias.request(frame, visible, allocator.grid), allocator.resets
        allocator.allocate(visible, request, self.tables.members, self.marks)
        patches, words = visible.patches.get()[: visible.count], allocator.read(visible)
        self.changed = allocator.resets > resets or not np.array_equal(words, self.locations.words[patches])
        locations = self.locations.encode(patches, words)
        samples, without = emit_samples(device, visible, allocator.words, self.tables, frame.atlas_width, self.complete)
        statistics: dict[str, float] = {
            "bias": self.allocation_bias.value,
            "triangles_without_texel": without,
            FULL: int(self.allocation_bias.is_atlas_full(frame)),
        }
        statistics |= describe(self.patches, patches, allocator)
        statistics |= {"used_texels": samples.count, "location_bytes": len(locations)}
        return Payload(
            planes=frame.shade(samples),
            blobs={"locations": locations},
            geometry=self.geometry.encode(frame.pvs),
            sample_count=samples.count,
            samples=samples,
            unplaced=self._unplaced(patches[words == 0], frame.pvs),
            statistics=statistics,
        )

    def _allocator(self, frame: Frame) -> Allocator:
        if self.allocator is None:
            grid = choose_grid(frame.atlas_width, frame.atlas_height, self.superblock)
            self.allocator = Allocator(frame.scene.device, grid, self.patches.count, self.reuse)
        return self.allocator

    def _unplaced(self, lost: Ints, pvs: Ints) -> dict[int, str]:
        """The triangles of the set that are in patches without a block."""
        if not len(lost):
            return {}
        return dict.fromkeys(pvs[np.isin(self.patches.of_triangle[pvs], lost)].tolist(), UNPLACED)

    def client(self, scene: ClientScene) -> ShadingAtlasClient:
        """A client without any triangle yet."""
        return ShadingAtlasClient(scene)
