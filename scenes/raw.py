"""What a file reader hands over before assembly: parts with their instances, in the file's own coordinates."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace
from typing import SupportsInt

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Array, Bools, Doubles
from shading_atlas_bench.scenes.memory import check_memory, room
from shading_atlas_bench.scenes.model import Camera, CameraAnimation, Indices, Light, Material, Texture

MAX_TEXTURE = 8192  # texels, of a side: what OpenCL devices take as an image at least


@dataclass
class Part:
    """A piece of mesh, drawn once per transform.

    positions: float (V, 3), local. indices: int (T, 3). normals, uvs (row 0 of an image at v = 0), colours (linear
    RGBA) and tangents belong to the vertices; None where the file has none. further_uvs: the sets that the material's
    textures use beside `uvs` (see Material), None in place of one that the file lacks here.
    materials: int (T), of each triangle, in place of `material`; no vertex is of several, and none has a normal map.
    transforms: float64 (N, 4, 4), local to world, column vectors.
    """

    positions: Array
    indices: Indices
    material: int
    normals: Array | None = None
    uvs: Array | None = None
    colours: Array | None = None
    tangents: Array | None = None
    transforms: Doubles = field(default_factory=lambda: np.eye(4)[None])
    further_uvs: tuple[Array | None, ...] = ()
    materials: Indices | None = None

    @property
    def own_bytes(self) -> int:
        """Bytes of its arrays that are no views of others."""
        arrays = (self.positions, self.indices, self.normals, self.uvs, self.colours, self.tangents, *self.further_uvs)
        return sum(array.nbytes for array in arrays if array is not None and array.flags.owndata)

    def keeping(self, triangles: Bools) -> Part:
        """The part with only the triangles marked in a mask (T), and all its vertices."""
        if triangles.all():
            return self
        materials = None if self.materials is None else self.materials[triangles]
        return replace(self, indices=self.indices[triangles], materials=materials)

    def taking(self, vertices: Indices, indices: Indices) -> Part:
        """The part with only these vertices, int (n), repeats allowed, and triangles of them, indices int (T, 3)."""

        def of(attribute: Array | None) -> Array | None:
            return None if attribute is None else attribute[vertices]

        return replace(
            self,
            positions=self.positions[vertices],
            indices=indices,
            normals=of(self.normals),
            uvs=of(self.uvs),
            colours=of(self.colours),
            tangents=of(self.tangents),
            further_uvs=tuple(of(uvs) for uvs in self.further_uvs),
        )


@dataclass
class RawScene:
    """Everything read from a file, in world coordinates of the file (float64), with what was found wanting.

    counts: sentence with `{}` for the number -> how often it happened; they become the scene's notes.
    max_texture: the longest side that its textures may have, in texels. taken: bytes of memory, see `take`.
    """

    parts: list[Part] = field(default_factory=list)
    materials: list[Material] = field(default_factory=list)
    textures: list[Texture] = field(default_factory=list)
    cameras: list[Camera] = field(default_factory=list)
    animations: list[CameraAnimation] = field(default_factory=list)
    lights: list[Light] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)
    max_texture: int = MAX_TEXTURE
    taken: int = 0

    def take(self, size: int, what: str, remedy: str = "use a larger machine") -> None:
        """Count bytes that the scene is about to take. Raises SceneError where they do not fit into memory."""
        self.check(size, what, remedy)
        self.taken += size

    def check(self, size: int, what: str, remedy: str = "use a larger machine") -> None:
        """Raise SceneError where bytes that are about to be taken for a while do not fit into memory."""
        check_memory(self.taken + size, f"the scene, with {what},", remedy)

    @property
    def room(self) -> int:
        """The bytes that the scene may still take."""
        return room() - self.taken

    def note(self, sentence: str, count: SupportsInt = 1) -> None:
        """Count something for the report; nothing is noted for a count of 0."""
        if count:
            self.counts[sentence] += int(count)

    def notes(self) -> list[str]:
        """The counted sentences, in the order in which they came up."""
        return [sentence.replace("{}", f"{count:,}") for sentence, count in self.counts.items()]
