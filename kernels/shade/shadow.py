"""Shadow maps: one per light that casts shadows, rendered once per scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from pyopencl.array import Array

    from kernels.device import Device

ROW_FLOATS = 28  # of a light's record, from its 20th float on; layout in shadow_lookup.cl


@dataclass(frozen=True)
class ShadowMaps:
    """maps: float32 device array, all maps one after the other; rows: float32 (L, 28), each light's transform."""

    maps: Array
    rows: np.ndarray

    @classmethod
    def none(cls, device: Device, lights: int) -> ShadowMaps:
        """No shadows for any of `lights` lights."""
        return cls(device.zeros(1, np.float32), np.zeros((lights, ROW_FLOATS), np.float32))
