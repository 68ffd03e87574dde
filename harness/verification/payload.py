"""What a packed frame says of itself: its launches, its classes, its samples and their colours."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from numbers import Real
from typing import Any

import numpy as np

from harness.validity import Violation
from harness.verification.truth import CHOSEN, LEVELS, Truth, violation
from kernels.samples import Samples
from packers.interface import ALPHA, Frame, Owners, Payload

GROUPS = ("structs/", "gather/")
OPACITY = 3  # levels of 255 that an opacity may be off
BYTES = (bytes, bytearray, memoryview)


@dataclass(frozen=True)
class HostSamples:
    """Samples on the host, see kernels.samples: triangle, texel int32 (n), bary (n, 2), footprint float32 (n)."""

    triangle: np.ndarray
    bary: np.ndarray
    footprint: np.ndarray
    texel: np.ndarray

    @classmethod
    def of(cls, samples: Samples) -> HostSamples:
        n = samples.count
        bary = np.stack([samples.bary1.get()[:n], samples.bary2.get()[:n]], axis=1)
        return cls(samples.triangle.get()[:n], bary, samples.footprint.get()[:n], samples.texel.get()[:n])


def check_launches(stages: Iterable[str], samples: int, outside: Iterable[str] = ()) -> Iterator[Violation]:
    """stages: of all launches inside `pack`. samples: in the payload. outside: stages launched by `owners`."""
    stages = list(stages)
    if stray := sorted(stage for stage in stages if not stage.startswith(GROUPS)):
        names = ", ".join(stray)
        yield violation("launches", len(stray), f'Packing launched {names}: stages begin with "structs/" or "gather/".')
    if samples and not any(stage.startswith(GROUPS[1]) for stage in stages):
        yield violation("launches", 1, f"The payload has {samples} samples, but packing it launched no gather stage.")
    if later := sorted(outside):
        yield violation("launches", len(later), f"`owners` launched {', '.join(later)}: all work belongs into `pack`.")


def check_plain(frame: Frame, payload: Payload) -> Iterator[Violation]:
    """That nothing is computed when a payload is looked at, and nothing hides in it."""
    shape = (frame.atlas_height, frame.atlas_width, 4)
    device = type(frame.pvs_device)
    samples = payload.samples
    fine = {
        "payload": type(payload) is Payload,
        "planes": type(payload.planes) is dict
        and all(type(p) is device and p.dtype == np.uint8 and p.shape == shape for p in payload.planes.values()),
        "blobs": _all_of(payload.blobs, BYTES),
        "lists": _all_of(payload.lists, BYTES),
        "geometry": type(payload.geometry) in BYTES,
        "samples": samples is None or (type(samples) is Samples and all(type(a) is device for a in _arrays(samples))),
        "unplaced": all(isinstance(reason, str) for reason in payload.unplaced.values()),
        "statistics": all(isinstance(value, Real | np.number) for value in payload.statistics.values()),
    }
    if wrong := [name for name, is_fine in fine.items() if not is_fine]:
        sentence = f"The payload's {', '.join(wrong)} are not what the interface says, of the atlas' size."
        yield violation("plain", len(wrong), sentence)
    if payload.planes and samples is None:
        yield violation("plain", 1, "The payload has planes but no samples: nothing says what their texels are.")
    if not payload.planes and not payload.lists:
        yield violation("plain", 1, "The payload has neither planes nor lists: there is nothing to draw.")


def _all_of(values: Any, kinds: tuple[type, ...]) -> bool:
    return type(values) is dict and all(type(value) in kinds for value in values.values())


def _arrays(samples: Samples) -> tuple:
    return samples.triangle, samples.bary1, samples.bary2, samples.footprint, samples.texel


def check_owners(owners: Owners | None, samples: HostSamples) -> Iterator[Violation]:
    """That `owners` tells of the payload's samples."""
    same = owners is not None and (
        np.array_equal(owners.texel, samples.texel)
        and np.array_equal(owners.triangle, samples.triangle)
        and np.array_equal(owners.bary, samples.bary, equal_nan=True)
    )
    if not same:
        yield violation("samples", 1, "`owners` tells of other samples than the payload lists.")


def check_sample_count(payload: Payload, derived: int, share: float = 0.0) -> Iterator[Violation]:
    """derived: samples counted from outside. share: of them, by which the claim may differ."""
    if abs(payload.sample_count - derived) > share * derived:
        sentence = f"The payload claims {payload.sample_count} samples and has {derived}."
        yield violation("samples", abs(payload.sample_count - derived), sentence)


def check_texels(
    truth: Truth, frame: Frame, method: str, samples: HostSamples, planes: Mapping[str, np.ndarray]
) -> Iterator[Violation]:
    """Colours, and opacities, of some texels against float64. planes: uint8 (H, W, 4) on the host."""
    within = (samples.texel >= 0) & (samples.texel < frame.atlas_width * frame.atlas_height)
    within &= (samples.triangle >= 0) & (samples.triangle < truth.triangles.count)
    known = np.flatnonzero(within)  # others break a rule of harness/validity.py
    if not known.size:
        return
    chosen = known[truth.generator(frame.index, method).integers(0, known.size, CHOSEN)]
    texel, triangle = samples.texel[chosen], samples.triangle[chosen]
    points = (triangle, samples.bary[chosen].astype(np.float64), samples.footprint[chosen].astype(np.float64))
    colours = {name: plane.reshape(-1, 4)[texel, :3] for name, plane in planes.items()}
    (shaded,) = (values for name, values in colours.items() if name != ALPHA)
    off = truth.off(shaded, points, frame.server.eye)
    if (bad := np.flatnonzero(off > LEVELS)).size:
        sentence = (
            f"{bad.size} of {CHOSEN} texels differ by up to {off.max()} levels from what float64 shading gives them."
        )
        yield violation("colours", bad.size, sentence, triangle[bad], texel[bad])
    if ALPHA in colours:
        low, high = truth.opacity(*points).T
        alpha = colours[ALPHA].astype(np.float64)
        wrong = (alpha.min(axis=1) < low - OPACITY) | (alpha.max(axis=1) > high + OPACITY)
        if (bad := np.flatnonzero(wrong)).size:
            sentence = f"{bad.size} of {CHOSEN} texels of the alpha plane have another opacity than their surface."
            yield violation("colours", bad.size, sentence, triangle[bad], texel[bad])
