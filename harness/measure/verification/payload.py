"""What a packed frame says of itself: its launches, its samples and their colours."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Bytes
from shading_atlas_bench.harness.measure.validity import Violation
from shading_atlas_bench.harness.measure.verification.truth import CHOSEN, LEVELS, Points, Truth, violation
from shading_atlas_bench.kernels.samples import Samples
from shading_atlas_bench.packers.interface import ALPHA, Frame, Owners, Payload

GROUPS = ("structs/", "gather/")
OPACITY = 3  # levels of 255 that an opacity may be off


def check_launches(stages: Iterable[str], samples: int) -> Iterator[Violation]:
    """stages: of all launches inside `pack`. samples: in the payload."""
    stages = list(stages)
    if stray := sorted(stage for stage in stages if not stage.startswith(GROUPS)):
        names = ", ".join(stray)
        yield violation("launches", len(stray), f'Packing launched {names}: stages begin with "structs/" or "gather/".')
    if samples and not any(stage.startswith(GROUPS[1]) for stage in stages):
        yield violation("launches", 1, f"The payload has {samples} samples, but packing it launched no gather stage.")


def check_sample_count(payload: Payload, derived: int, share: float = 0.0) -> Iterator[Violation]:
    """derived: samples counted from outside. share: of them, by which the claim may differ."""
    if abs(payload.sample_count - derived) > share * derived:
        sentence = f"The payload claims {payload.sample_count} samples and has {derived}."
        yield violation("samples", abs(payload.sample_count - derived), sentence)


def check_texels(
    truth: Truth, frame: Frame, draw: str, samples: Samples, owners: Owners, planes: Mapping[str, Bytes]
) -> Iterator[Violation]:
    """Colours, and opacities, of some texels against float64.

    draw: names the random numbers that choose them. owners: those of the samples. planes: uint8 (H, W, 4) on the host.
    """
    if not samples.count:
        return
    chosen = truth.generator(frame.index, draw).integers(0, samples.count, CHOSEN)
    texel, triangle = owners.texel[chosen], owners.triangle[chosen]
    within = (texel >= 0) & (texel < frame.atlas_width * frame.atlas_height)
    within &= (triangle >= 0) & (triangle < truth.triangles.count)  # others break a rule of harness/measure/validity.py
    chosen, texel, triangle = chosen[within], texel[within], triangle[within]
    footprint = samples.footprint.get()[chosen].astype(np.float64)
    points = Points(triangle, owners.bary[chosen].astype(np.float64), footprint)
    colours = {name: plane.reshape(-1, 4)[texel, :3] for name, plane in planes.items()}
    (shaded,) = (values for name, values in colours.items() if name != ALPHA)
    off = truth.off(shaded, points, frame.server.eye)
    if (bad := np.flatnonzero(off > LEVELS)).size:
        sentence = (
            f"{bad.size} of {CHOSEN} texels differ by up to {off.max()} levels from what float64 shading gives them."
        )
        yield violation("colours", bad.size, sentence, triangle[bad], texel[bad])
    if ALPHA in colours:
        low, high = truth.opacity(points).T
        alpha = colours[ALPHA].astype(np.float64)
        wrong = (alpha.min(axis=1) < low - OPACITY) | (alpha.max(axis=1) > high + OPACITY)
        if (bad := np.flatnonzero(wrong)).size:
            sentence = f"{bad.size} of {CHOSEN} texels of the alpha plane have another opacity than their surface."
            yield violation("colours", bad.size, sentence, triangle[bad], texel[bad])
