"""Bin mapping (section 3.4): when bins with few triangles are mapped to others; kernels/mapping.py says how."""

from __future__ import annotations

from typing import TYPE_CHECKING

from shading_atlas_bench.packers.snakebinning.kernels.mapping import Mapping

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.packers.skips import Skips
    from shading_atlas_bench.packers.snakebinning.kernels.count import UsedBins


class BinMapping:
    """The mapping of bins, kept from frame to frame.

    search: as in Mapping. sink: a bin with more triangles attracts others. interval: frames after which all bins are
    mapped anew, 0 for only at resets. mapped_at: the frame in which that was. remappings: how often, not at resets.
    """

    def __init__(self, device: Device, search: str, sink: int, interval: int) -> None:
        self.mapping, self.sink, self.interval = Mapping(device, search, sink), sink, interval
        self.mapped_at = self.remappings = 0

    @property
    def is_on(self) -> bool:
        """Whether any bin is ever mapped."""
        return self.mapping.search != "off"

    @property
    def targets(self) -> Array:
        """int32 (BINS): the bin in whose strip the triangles of each one lie."""
        return self.mapping.targets

    def is_due(self, frame: int) -> bool:
        """Whether the interval is over."""
        return 0 < self.interval <= frame - self.mapped_at

    def reset(self, frame: int) -> None:
        """Forget the mapping: all bins of this frame are mapped anew."""
        self.mapping.reset()
        self.mapped_at = frame

    def renew(self, frame: int) -> None:
        """The same because the interval is over."""
        self.reset(frame)
        self.remappings += 1

    def update(self, bins: UsedBins, skips: Skips) -> None:
        """Map those of the bins that are not yet."""
        is_sparse = self.mapping.update(bins, always="bin mapping" in skips.off)
        skips.leaves_out("bin mapping", not is_sparse)
