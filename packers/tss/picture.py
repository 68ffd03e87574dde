"""A picture of the atlas by strategy, as in figure 1 of the paper."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from shading_atlas_bench.packers.tss.kernels.forms import OVERSAMPLED
from shading_atlas_bench.packers.tss.statistics import samples_by_primitive

if TYPE_CHECKING:
    from shading_atlas_bench.arithmetic.arrays import Bytes, Ints

LPACKING, OVERSAMPLING, SINGLE = (70, 200, 90), (60, 110, 230), (230, 200, 80)


def draw_strategies(forms: Ints, places: Ints, texel: NDArray[np.integer[Any]], width: int, height: int) -> Bytes:
    """Ls in green, right triangles in blue, single texels in yellow, the rest black: uint8 (height, width, 3).

    forms: int32 (m, 4), places: int32 (m, 2), of primitives. texel: int (n), of their samples, in order. Brightness
    changes from one primitive to the next, so that neighbours can be told apart.
    """
    kind = forms[:, 0]
    colours = np.array([OVERSAMPLING, SINGLE, LPACKING])[np.where(kind == OVERSAMPLED, 0, np.where(kind == 0, 1, 2))]
    shade = 0.6 + 0.4 * (np.arange(len(forms)) * 5 % 7) / 6
    picture = np.zeros((height * width, 3), np.uint8)
    picture[texel] = np.repeat((colours * shade[:, None]).astype(np.uint8), samples_by_primitive(forms, places), axis=0)
    return picture.reshape(height, width, 3)
