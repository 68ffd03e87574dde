"""A packer with its client over some frames."""

from __future__ import annotations

from typing import Any, Generic, TypeVar

from shading_atlas_bench.harness.measure.validity import BUDGET, check
from shading_atlas_bench.harness.measure.verification.isolation import decode_losslessly
from shading_atlas_bench.packers.interface import Frame, Packer, Payload, ServerScene

Method = TypeVar("Method", bound=Packer)


class Stream(Generic[Method]):
    """A packer of a class with some parameters, prepared for a scene, and its client; budget: see validity.check."""

    def __init__(self, kind: type[Method], scene: ServerScene, budget: int | None = BUDGET, **parameters) -> None:
        self.packer, self.budget = kind(**parameters), budget
        self.packer.prepare(scene)
        self.client: Any = self.packer.client(scene.shipped)  # of a class of the method's own

    def send(self, frame: Frame) -> Payload:
        """Pack a frame and hand it to the client."""
        payload = self.packer.pack(frame)
        self.client.receive(decode_losslessly(payload))
        return payload

    def violations(self, frame: Frame, payload: Payload) -> list:
        """What is not valid about the frame just sent."""
        return check(frame, payload, payload.owners(), self.client, budget=self.budget)
