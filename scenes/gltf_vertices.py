"""Vertex attributes of glTF primitives, moved by their morph targets (Khronos glTF 2.0, section 3.7.2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Array, Floats
from shading_atlas_bench.scenes.gltf_document import GltfDocument
from shading_atlas_bench.scenes.gltf_values import JsonObject
from shading_atlas_bench.scenes.raw import RawScene

_Kinds: TypeAlias = dict[str, tuple[str, ...]]  # types of accessors by the first words of attributes' names

_KINDS: _Kinds = {
    **{"POSITION": ("VEC3",), "NORMAL": ("VEC3",), "TANGENT": ("VEC4",), "TEXCOORD": ("VEC2",)},
    **{"COLOR": ("VEC3", "VEC4"), "JOINTS": ("VEC4",), "WEIGHTS": ("VEC4",)},
    **{"TRANSLATION": ("VEC3",), "ROTATION": ("VEC4",), "SCALE": ("VEC3",)},  # of instances
}
_MOVED: _Kinds = _KINDS | {"TANGENT": ("VEC3",)}  # morph targets leave a tangent's side as it is
_FRACTIONS = ("COLOR", "TANGENT")  # whole numbers of these are always meant as fractions of the largest
_FOUND_ANEW = ("NORMAL", "TANGENT")  # from the morphed positions where a primitive has none


def attribute(document: GltfDocument, attributes: JsonObject, name: str, count: int) -> Array | None:
    """An attribute's values (count, k), as from `GltfDocument.accessor`, or None where it is not there.

    Raises ValueError where it has other ones.
    """
    return _values(document, attributes, name, count, _KINDS) if name in attributes else None


def _values(document: GltfDocument, attributes: JsonObject, name: str, count: int, kinds: _Kinds) -> Array:
    stem = name.partition("_")[0]
    read = document.whole_numbers if stem == "JOINTS" else document.accessor
    values = read(attributes[name], name, *kinds[stem])
    if len(values) != count:
        raise ValueError(f"{name} has {len(values)} entries where {count} belong")
    return values


@dataclass(frozen=True)
class Vertices:
    """The vertices of a primitive. weights: of its morph targets."""

    document: GltfDocument
    primitive: JsonObject
    weights: tuple[float, ...]
    raw: RawScene

    @property
    def count(self) -> int:
        """How many there are."""
        count: int = self.document.entry("accessors", self.primitive["attributes"]["POSITION"])["count"]
        return count

    def get(self, name: str) -> Array | None:
        """As `moved`; None where the primitive has not got the attribute."""
        return self.moved(name) if name in self.primitive["attributes"] else None

    def moved(self, name: str) -> Array:
        """An attribute (count, k) that the primitive has, morphed; floats where that moves it, else as from
        `attribute`."""
        own = _values(self.document, self.primitive["attributes"], name, self.count, _KINDS)
        values = self._fractions(name, own)
        targets = [(weight, target) for weight, target in self._targets() if name in target]
        if not targets:
            return values
        values = values.astype(np.result_type(values, np.float32))
        for weight, target in targets:
            change = self._fractions(name, _values(self.document, target, name, self.count, _MOVED))
            values[:, : change.shape[1]] += weight * change
        return np.clip(values, 0, 1) if name.startswith("COLOR") else values

    def colours(self) -> Floats | None:
        """Linear RGBA (count, 4), float32; None where the primitive has none."""
        values = self.get("COLOR_0")
        if values is None:
            return None
        colours = np.ones((len(values), 4), np.float32)
        colours[:, : values.shape[1]] = values
        return colours

    def note_unused(self) -> None:
        """Note by name what of the attributes and targets is not used."""
        attributes = self.primitive["attributes"]
        for name in attributes:
            unused = name.startswith("COLOR_") and name != "COLOR_0"
            self.raw.note(f"Primitives whose further colours {name} are not used: {{}}.", unused)
        for _, target in self._targets():
            for name in sorted(target.keys() - attributes.keys() - set(_FOUND_ANEW)):
                self.raw.note(f"Morph targets of {name} where there is no {name} to move, not used: {{}}.")

    def _targets(self) -> list[tuple[float, JsonObject]]:
        """The morph targets that count, by their weights."""
        pairs = zip(self.weights, self.primitive.get("targets", []), strict=False)
        return [(weight, target) for weight, target in pairs if weight]

    def _fractions(self, name: str, values: Array) -> Array:
        if values.dtype.kind == "f" or not name.startswith(_FRACTIONS):
            return values
        self.raw.note(f"Whole numbers of {name} that are not marked as normalised, read as if they were: {{}}.")
        return (values / np.float32(np.iinfo(values.dtype).max)).astype(np.float32)
