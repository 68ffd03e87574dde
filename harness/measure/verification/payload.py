"""What a packed frame says of itself: its launches, its classes, its samples and their colours."""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields
from numbers import Real
from typing import TYPE_CHECKING

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Bytes
from shading_atlas_bench.harness.measure.validity import Violation
from shading_atlas_bench.harness.measure.verification.truth import CHOSEN, LEVELS, Points, Truth, violation
from shading_atlas_bench.kernels.samples import Samples
from shading_atlas_bench.packers.interface import ALPHA, Frame, Owners, Payload

if TYPE_CHECKING:
    from pyopencl.array import Array

GROUPS = ("structs/", "gather/")
OPACITY = 3  # levels of 255 that an opacity may be off
BYTES = (bytes, bytearray, memoryview)
LONGEST_NAME = 32  # letters, of a plane, a blob or lists


def check_launches(stages: Iterable[str], samples: int) -> Iterator[Violation]:
    """stages: of all launches inside `pack`. samples: in the payload."""
    stages = list(stages)
    if stray := sorted(stage for stage in stages if not stage.startswith(GROUPS)):
        names = ", ".join(stray)
        yield violation("launches", len(stray), f'Packing launched {names}: stages begin with "structs/" or "gather/".')
    if samples and not any(stage.startswith(GROUPS[1]) for stage in stages):
        yield violation("launches", 1, f"The payload has {samples} samples, but packing it launched no gather stage.")


def check_plain(frame: Frame, payload: Payload) -> Iterator[Violation]:
    """That nothing is computed when a payload is looked at, and nothing hides in it."""
    shape = (frame.atlas_height, frame.atlas_width, 4)
    device = type(frame.pvs_device)
    samples = payload.samples
    fine = {
        "payload": _is_plain(payload),
        "planes": type(payload.planes) is dict
        and all(type(p) is device and p.dtype == np.uint8 and p.shape == shape for p in payload.planes.values()),
        "blobs": _all_of(payload.blobs, BYTES),
        "lists": _all_of(payload.lists, BYTES),
        "names": all(_is_name(name) for parts in (payload.planes, payload.blobs, payload.lists) for name in parts),
        "geometry": type(payload.geometry) in BYTES,
        "samples": samples is None or (type(samples) is Samples and all(type(a) is device for a in _arrays(samples))),
        "unplaced": all(isinstance(reason, str) for reason in payload.unplaced.values()),
    }
    if wrong := [name for name, is_fine in fine.items() if not is_fine]:
        sentence = f"The payload is not as the interface says, planes of the atlas' size: {', '.join(wrong)}."
        yield violation("plain", len(wrong), sentence)
    if strange := sorted(payload.statistics.keys() - statistics_of(payload)):
        sentence = f"Of the payload, the statistics {', '.join(strange)} are not finite numbers."
        yield violation("plain", len(strange), sentence)
    if payload.planes and samples is None:
        yield violation("plain", 1, "The payload has planes but no samples: nothing says what their texels are.")
    if not payload.planes and not payload.lists:
        yield violation("plain", 1, "The payload has neither planes nor lists: there is nothing to draw.")


def _is_plain(payload: Payload) -> bool:
    """Whether a payload's fields are values and nothing that is run when somebody reads them; a packer may add some."""
    kind = type(payload)
    reading = (inspect.getattr_static(kind, name, None) for name in ("__getattribute__", "__getattr__"))
    computed = (inspect.isdatadescriptor(inspect.getattr_static(kind, field.name, None)) for field in fields(Payload))
    plain = [*reading] == [object.__getattribute__, None] and not any(computed)
    return isinstance(payload, Payload) and plain and kind.owners is Payload.owners


def statistics_of(payload: Payload) -> dict[str, float]:
    """Those that are finite numbers."""
    known = payload.statistics.items()
    return {name: float(value) for name, value in known if isinstance(value, Real) and np.isfinite(value)}


def _all_of(values: object, kinds: tuple[type, ...]) -> bool:
    return type(values) is dict and all(type(value) in kinds for value in values.values())


def _is_name(name: object) -> bool:
    return type(name) is str and name.isidentifier() and len(name) <= LONGEST_NAME


def _arrays(samples: Samples) -> tuple[Array, ...]:
    return samples.triangle, samples.bary1, samples.bary2, samples.footprint, samples.texel


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
