"""What a file reader hands over before assembly: parts with their instances, in the file's own coordinates."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from shading_atlas_bench.scenes.model import Camera, CameraAnimation, Light, Material, Texture


@dataclass
class Part:
    """A piece of mesh with one material, drawn once per transform.

    positions: float (V, 3), local. indices: int (T, 3). normals, uvs (row 0 of an image at v = 0), colours (linear
    RGBA) and tangents belong to the vertices; None where the file has none. further_uvs: the sets that the material's
    textures use beside `uvs` (see Material), None in place of one that the file lacks here.
    transforms: float64 (N, 4, 4), local to world, column vectors.
    """

    positions: np.ndarray
    indices: np.ndarray
    material: int
    normals: np.ndarray | None = None
    uvs: np.ndarray | None = None
    colours: np.ndarray | None = None
    tangents: np.ndarray | None = None
    transforms: np.ndarray = field(default_factory=lambda: np.eye(4)[None])
    further_uvs: tuple[np.ndarray | None, ...] = ()

    def taking(self, vertices: np.ndarray, indices: np.ndarray) -> Part:
        """The part with only these vertices (any index array, repeats allowed) and these triangles of them."""
        attributes = [self.normals, self.uvs, self.colours, self.tangents, *self.further_uvs]
        taken = [None if a is None else a[vertices] for a in attributes]
        return Part(self.positions[vertices], indices, self.material, *taken[:4], self.transforms, tuple(taken[4:]))


@dataclass
class RawScene:
    """Everything read from a file, in world coordinates of the file (float64), with what was found wanting.

    counts: sentence with `{}` for the number -> how often it happened; they become the scene's notes.
    """

    parts: list[Part] = field(default_factory=list)
    materials: list[Material] = field(default_factory=list)
    textures: list[Texture] = field(default_factory=list)
    cameras: list[Camera] = field(default_factory=list)
    animations: list[CameraAnimation] = field(default_factory=list)
    lights: list[Light] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)

    def note(self, sentence: str, count: int = 1) -> None:
        """Count something for the report; nothing is noted for a count of 0."""
        if count:
            self.counts[sentence] += int(count)

    def notes(self) -> list[str]:
        """The counted sentences, in the order in which they came up."""
        return [sentence.replace("{}", f"{count:,}") for sentence, count in self.counts.items()]
