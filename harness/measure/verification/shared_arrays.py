"""The arrays on the device that all methods read: nobody may write to them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from typing import TYPE_CHECKING

from shading_atlas_bench.kernels.runtime.opencl import array_class

if TYPE_CHECKING:
    from pyopencl.array import Array

    from shading_atlas_bench.packers.interface import ServerScene


class SharedArrays:
    """Those of a scene, as they are now."""

    def __init__(self, scene: ServerScene) -> None:
        self._device, self._arrays = scene.device, dict(_arrays_of(scene))
        self._before = self._checksums()

    def changed(self) -> list[str]:
        """The names of those that are others now."""
        return [name for name, checksum in self._checksums().items() if checksum != self._before[name]]

    def _checksums(self) -> dict[str, int]:
        return {name: self._device.checksum(array) for name, array in self._arrays.items()}


def _arrays_of(scene: ServerScene) -> Iterator[tuple[str, Array]]:
    """What no drawing writes to, by how it is reached."""
    kind = array_class()
    opacity = scene.layers and scene.layers.opacity
    records = {"triangles": scene.triangles, "mask": scene.mask, "layers.opacity": opacity}
    for name, record in records.items():
        for field in fields(record) if record else ():
            if type(array := getattr(record, field.name)) is kind:
                yield f"scene.{name}.{field.name}", array
    yield from ((f"scene.shader.arguments[{number}]", array) for number, array in enumerate(scene.shader.arguments))
