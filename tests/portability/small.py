"""The kernels' cases at sizes that an interpreter of OpenCL gets through."""

from __future__ import annotations

from shading_atlas_bench.kernels.case import Case, Trial
from shading_atlas_bench.kernels.device import Device

# No multiple of a vector's width or of a work-group, so that what is left over is there.
SIZE = 61
# What takes whole vectors only, what needs 161 pixels a side, and what has too many samples, or a slow twin.
SIZES = {
    **dict.fromkeys(("doctor/polynomial", "roofline/copying", "roofline/arithmetic"), 64),
    "metrics/iwssim": 289,
    **dict.fromkeys(("snakebinning/clearing", "snakebinning/emission", "tss/emission"), 13),
    "ppll/splatting": 24,
}


def small_trial(case: Case, device: Device, kind: str) -> Trial:
    """A case at a small size."""
    return case.make(device, kind, min(case.checked, SIZES.get(case.name, SIZE)))
