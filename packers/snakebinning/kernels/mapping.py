"""Bin mapping (section 3.4, algorithm 1): bins with few triangles go to near ones with many."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.kernels.constants import constants_of
from shading_atlas_bench.packers.snakebinning.kernels.bins import ANGLES, BINS, HEIGHTS, POINTS, bin_of, indices_of

if TYPE_CHECKING:
    from shading_atlas_bench.arithmetic import arrays
    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.packers.snakebinning.kernels.count import UsedBins

HERE = Path(__file__).parent

STAGE = "structs/mapping"
DEFINED = constants_of(HERE / "mapping.cl")
ANGLE_RANGE = DEFINED.whole("ANGLE_RANGE")  # bins to either side
HEIGHT_RANGE = DEFINED.whole("HEIGHT_RANGE")  # bins, upwards only
# distance^2 = 400 (da^2 + db^2) + dh^2: 20 bins of the height are as far as one of an angle.
PER_ANGLE = DEFINED.whole("PER_ANGLE")
SIDES = (1, 2, 5, 10)  # of the hierarchy's cells in bins of an angle; 20 times as many of the height
CELLS = [(ANGLES // side) * (ANGLES // side) * -(-HEIGHTS // (20 * side)) for side in SIDES]
NO_KEY = DEFINED.whole("NO_KEY")


class Mapping:
    """Targets of bins, int32 (BINS), -1 for a bin not mapped yet; kept until `reset`.

    search: "exact" finds the nearest sink in range, "hierarchical" the first in the hierarchy of section 4, "off" maps
    every bin to itself. most: triangles of a source; a sink has more.
    """

    def __init__(self, device: Device, search: str, most: int) -> None:
        self.device, self.search, self.most = device, search, most if search != "off" else -1
        self.kernels = device.build(HERE / "mapping.cl")
        self.targets = device.empty(BINS, np.int32)
        self.sinks = device.empty(BINS // 32, np.uint32)
        self.keys = device.empty(sum(CELLS), np.uint32)
        self.sources = device.empty(1, np.int32)
        self.reset()

    def reset(self) -> None:
        """Forget all targets and sinks."""
        self.device.fill(self.targets, -1, STAGE)
        self.device.fill(self.sinks, 0, STAGE)
        self.device.fill(self.keys, NO_KEY, STAGE)

    def update(self, bins: UsedBins, always: bool = False) -> bool:
        """Give targets to those of the bins that have none.

        Returns whether any bin looks for a sink; if not, no search is launched, unless `always`. New sinks come first,
        then sources look for theirs, then those without one are promoted to sinks themselves.
        """
        launch, kernels, targets, sinks = self.device.launch, self.kernels, self.targets, self.sinks
        count, used = bins.count, bins.numbers
        self.device.fill(self.sources, 0, STAGE)
        launch(STAGE, kernels.find_sinks, count, count, used, bins.triangles, self.most, targets, sinks, self.sources)
        sparse = int(self.sources.get()[0]) > 0
        if not (sparse or always):
            return False
        found = self.device.recycled(count, np.int32)
        if self.search == "hierarchical":
            launch(STAGE, kernels.add_sinks, count, count, used, targets, self.keys)
            launch(STAGE, kernels.search_hierarchy, count, count, used, targets, self.keys, found)
        elif self.search == "exact":
            launch(STAGE, kernels.search_exactly, count, count, used, targets, sinks, found)
        launch(STAGE, kernels.apply_mapping, count, count, used, found, targets, sinks)
        return sparse


def map_bins_twin(
    used: arrays.Array, counts: arrays.Array, most: int, search: str, earlier: arrays.Array | None = None
) -> arrays.Array:
    """Targets int (k) of k used bins with `counts` triangles each, before which only the bins `earlier` are sinks.

    The bin of points stays by itself."""
    targets = np.where((counts > most) | (used == POINTS), used, -1)
    found = targets[(targets >= 0) & (targets != POINTS)]
    sinks = np.unique(np.concatenate([found, np.empty(0, int) if earlier is None else earlier]))
    find = nearest_sink if search == "exact" else first_in_hierarchy
    for i in np.flatnonzero(targets < 0):
        target = find(int(used[i]), sinks)
        targets[i] = used[i] if target is None else target
    return targets


def nearest_sink(source: int, sinks: arrays.Array) -> int | None:
    """The nearest of `sinks`, int (k), ascending, in range; of equally near ones the first."""
    alpha, beta, height = indices_of(source)
    a, b, h = (values - own for values, own in zip(indices_of(sinks), (alpha, beta, height), strict=True))
    near = (np.abs(a) <= ANGLE_RANGE) & (np.abs(b) <= ANGLE_RANGE) & (h >= 0) & (h <= HEIGHT_RANGE)
    distance = np.where(near, PER_ANGLE * (a * a + b * b) + h * h, np.inf)
    return int(sinks[np.argmin(distance)]) if near.any() else None


def first_in_hierarchy(source: int, sinks: arrays.Array) -> int | None:
    """Of the smallest cell around the source whose most central sink is not lower than the source, that sink.

    sinks: int (k), bins.
    """
    own = np.array(indices_of(source))
    places = np.stack(indices_of(sinks), axis=1)
    for side in SIDES:
        size = np.array([side, side, 20 * side])
        inside = places[(places // size == own // size).all(axis=1)]
        if not len(inside):
            continue
        off = 2 * (inside % size) + 1 - size
        central = inside[np.lexsort((*inside.T[::-1], (off * off * [PER_ANGLE, PER_ANGLE, 1]).sum(axis=1)))[0]]
        if central[2] >= own[2]:
            return int(bin_of(*central))
    return None
