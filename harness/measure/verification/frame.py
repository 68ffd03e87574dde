"""All that is checked of one frame of a method, in runs and in the conformance kit alike."""

from __future__ import annotations

import time
import zlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from shading_atlas_bench.arithmetic.arrays import Bytes
from shading_atlas_bench.harness.measure.returned import CheckedPacker
from shading_atlas_bench.harness.measure.validity import Violation
from shading_atlas_bench.harness.measure.verification import lists as of_lists
from shading_atlas_bench.harness.measure.verification.payload import (
    check_launches,
    check_sample_count,
    check_texels,
)
from shading_atlas_bench.harness.measure.verification.truth import Truth, violation
from shading_atlas_bench.packers.interface import Client, Frame, Owners, Payload

OLD = 0.25  # share of the fragments by which lists that may be old may differ from those that were shaded


@dataclass
class Verified:
    """samples: derived. found: rules that do not hold. milliseconds: host time of finding that out. draw: names the
    random numbers that chose what was looked at."""

    samples: int
    found: list[Violation] = field(default_factory=list)
    milliseconds: float = 0.0
    draw: str = ""


class Verifier:
    """Checks a method's frames, one after the other: how large lists may be depends on those before."""

    def __init__(self, truth: Truth, packer: CheckedPacker) -> None:
        self.truth, self.packer, self.fragments = truth, packer, 0
        self.names: tuple[list[str], ...] | None = None  # of the parts of the first payload

    def pass_over(self, payload: Payload, owners: Owners | None, client: Client) -> int:
        """Go on behind a frame that was checked before, with the arguments of `verify`; the frame's samples."""
        self.names = self.names or _names_of(payload)
        self.fragments = of_lists.count_fragments(client.fragments())
        return len(owners.texel) if owners else self.fragments

    def verify(
        self,
        frame: Frame,
        payload: Payload,
        planes: Mapping[str, Bytes],
        owners: Owners | None,
        client: Client,
        stages: Iterable[str] | None,
    ) -> Verified:
        """Check one frame.

        planes: uint8 (H, W, 4) as packed, on the host. owners: the payload's. client: has received the payload as it
        is. stages: launched by `pack`, None where the last frame's payload was kept.
        """
        start = time.perf_counter()
        draw = name_draw(self.packer.name, payload, planes)
        if planes:
            result = self._of_planes(frame, payload, planes, owners, draw)
        else:
            result = self._of_lists(frame, payload, client, draw)
        result.draw = draw
        result.found += self._check_names(payload)
        if stages is not None:
            result.found += check_launches(stages, result.samples)
        result.milliseconds = (time.perf_counter() - start) * 1000
        return result

    def _check_names(self, payload: Payload) -> Iterator[Violation]:
        """That the names of a payload's parts, which cost no bytes, say nothing: they are those of the first frame."""
        names = _names_of(payload)
        self.names = self.names or names
        if names != self.names:
            sentence = "Planes, blobs and lists have other names than in the first frame: names cost no bytes."
            yield violation("plain", 1, sentence)

    def _of_planes(
        self, frame: Frame, payload: Payload, planes: Mapping[str, Bytes], owners: Owners | None, draw: str
    ) -> Verified:
        if owners is None or payload.samples is None:
            return Verified(0)
        count = len(owners.texel)
        found = list(check_sample_count(payload, count))
        found += check_texels(self.truth, frame, draw, payload.samples, owners, planes)
        found += of_lists.check_bytes(payload, (), 0, 0, "every")
        return Verified(count, found)

    def _of_lists(self, frame: Frame, payload: Payload, client: Client, draw: str) -> Verified:
        held, holds, before = client.fragments(), self.packer.holds, self.fragments
        if not held:
            self.fragments = 0
            sentence = "The payload has no planes, and the client's `fragments` tells of no lists."
            return Verified(0, [violation("fragments", 1, sentence)])
        walked = of_lists.walk(self.truth.scene.device, held)
        found = list(of_lists.check_structure(held, walked))
        whole = [part for part in walked if part]
        if found:
            self.fragments = of_lists.count_fragments(held)
            return Verified(self.fragments, found)
        self.fragments = count = sum(part.visible for part in whole)
        found += check_sample_count(payload, count, OLD if holds in ("alike", "moved") else 0.0)
        found += of_lists.check_bytes(payload, held, count, before, holds)
        found += of_lists.check_fragments(self.truth, frame, draw, holds, held, whole)
        return Verified(count, found)


def _names_of(payload: Payload) -> tuple[list[str], ...]:
    """Of planes, blobs and lists."""
    return tuple(sorted(parts) for parts in (payload.planes, payload.blobs, payload.lists))


def name_draw(method: str, payload: Payload, planes: Mapping[str, Bytes]) -> str:
    """A name for the random numbers that choose what is looked at: it depends on all that was sent, so that nobody can
    know the choice before and be right only there. planes: uint8 (H, W, 4), as packed."""
    checksum = 0
    for plane in planes.values():
        checksum = zlib.crc32(plane.data, checksum)
    for lists in payload.lists.values():
        checksum = zlib.crc32(lists, checksum)
    return f"{method} {checksum:08x}"
