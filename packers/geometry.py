"""Coding of the potentially visible geometry, the same for every method.

A message says which triangles enter or leave the set since the last one, and carries those that the client has never
had; it keeps them for good. All numbers are little-endian; arrays of wide numbers are sent byte plane by byte plane,
which the harness's LZ4 packs better (FACTS of floats: 35% against 64% as they are).

    uint32        number of changes
    uint32 (n)    ids of the triangles that enter or leave, ascending, as differences
    float32 (m,9) corner positions of those never sent before, in the same order
    uint8 (m)     their flags, as in kernels.triangles.Triangles
    float32 (k,6) texture coordinates of the corners of those with an alpha mask
    float32 (l,3) alpha of the corners of those of them where it counts
    int16 (j)     materials of those that are masked or blended
    ...           what the method adds per triangle: one array of m for each of its attributes
    uint16        only if any of them is blended: number of materials of these that the client has not had yet
    int16 (i)     these materials
    uint16 (i)    their opacities, 0..255, or 256 where the alpha plane of the atlas has them

So a scene without blended triangles sends nothing for them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray

from shading_atlas_bench.arithmetic.arrays import Array, Bytes, Floats, Ints
from shading_atlas_bench.kernels.triangles import Triangles

Number = TypeVar("Number", bound=np.generic)


def shuffle(values: Array) -> bytes:
    """The bytes of an array of any shape and numbers, first all lowest ones, then all second ones and so on."""
    values = np.ascontiguousarray(values, values.dtype.newbyteorder("<"))
    return values.view(np.uint8).reshape(values.size, values.itemsize).T.tobytes()


def unshuffle(
    data: bytes | memoryview, dtype: type[Number] | np.dtype[Number], count: int, offset: int = 0
) -> NDArray[Number]:
    """The inverse: numbers of `dtype`, of shape (count), from `data` at `offset`."""
    sent = np.dtype(dtype).newbyteorder("<")
    planes = np.frombuffer(data, np.uint8, count * sent.itemsize, offset).reshape(sent.itemsize, count)
    return np.ascontiguousarray(planes.T).reshape(-1).view(sent)


SPECIAL = Triangles.MASKED | Triangles.BLENDED  # triangles whose material the client must know


class GeometryEncoder:
    """The server's side: what each client has been sent.

    positions float32 (V, 3), indices int32 (T, 3), flags uint8 (T), uvs float32 (V, 2), materials (T): the scene's.
    attributes: arrays (T) that the method adds, in the order in which the decoder names them.
    opacities: uint16 (M), of the materials (see kernels.fragments.opacity); None for a scene without blended ones.
    alphas: (V), of the vertices; None for a scene without Triangles.FADED.
    """

    def __init__(
        self,
        positions: Floats,
        indices: Ints,
        flags: Bytes,
        uvs: Floats,
        materials: NDArray[np.integer[Any]],
        attributes: Mapping[str, Array],
        opacities: NDArray[np.uint16] | None = None,
        alphas: Floats | None = None,
    ) -> None:
        self.opacities = np.empty(0, np.uint16) if opacities is None else opacities
        self.alphas = np.empty(0, np.float32) if alphas is None else alphas
        self.stated = np.zeros(len(self.opacities), bool)
        self.positions, self.indices, self.flags, self.uvs = positions, indices, flags, uvs
        self.materials, self.attributes = materials, attributes
        self.sent = np.zeros(len(indices), bool)
        self.current: Ints = np.empty(0, np.int32)

    def encode(self, pvs: Ints) -> bytes:
        """The message that makes `pvs` (int32, ascending) the client's set."""
        changed = np.setxor1d(self.current, pvs, assume_unique=True)
        new = changed[~self.sent[changed]]
        masked = new[(self.flags[new] & Triangles.MASKED) > 0]
        faded = new[(self.flags[new] & Triangles.FADED) > 0]
        special = new[(self.flags[new] & SPECIAL) > 0]
        self.sent[new] = True
        self.current = pvs.copy()
        parts = [
            np.array([len(changed)], "<u4").tobytes(),
            shuffle(np.diff(changed, prepend=0).astype(np.uint32)),
            shuffle(self.positions[self.indices[new]]),
            self.flags[new].tobytes(),
            shuffle(self.uvs[self.indices[masked]].astype(np.float32)),
            shuffle(self.alphas[self.indices[faded]].astype(np.float32)),
            shuffle(self.materials[special].astype(np.int16)),
        ]
        parts += [shuffle(values[new]) for values in self.attributes.values()]
        return b"".join(parts + self._opacities_of(new[(self.flags[new] & Triangles.BLENDED) > 0]))

    def _opacities_of(self, blended: Ints) -> list[bytes]:
        """What says how much the materials of new blended triangles cover; nothing if there are none."""
        if not len(blended):
            return []
        materials = np.unique(self.materials[blended])
        fresh = materials[~self.stated[materials]]
        self.stated[fresh] = True
        values = (np.array([len(fresh)], "<u2"), fresh.astype("<i2"), self.opacities[fresh].astype("<u2"))
        return [part.tobytes() for part in values]


class GeometryDecoder:
    """The client's side: a table of all triangles received, a row each, and the current set.

    attributes: name to dtype, in the encoder's order.
    """

    def __init__(self, attributes: Mapping[str, DTypeLike]) -> None:
        real, byte = np.dtype(np.float32), np.dtype(np.uint8)
        self.dtypes: dict[str, tuple[np.dtype[Any], int]] = {"positions": (real, 9), "flags": (byte, 1)}
        self.dtypes |= {"uvs": (real, 6), "alphas": (real, 3), "materials": (np.dtype(np.int16), 1)}
        self.dtypes |= {name: (np.dtype(dtype), 1) for name, dtype in attributes.items()}
        self.columns: dict[str, Array] = {name: np.empty((0, width), of) for name, (of, width) in self.dtypes.items()}
        self.opacities: dict[int, int] = {}  # of materials
        self.row_of: Ints = np.empty(0, np.int32)
        self.pvs: Ints = np.empty(0, np.int32)

    def decode(self, data: bytes) -> bool:
        """Take one message; whether the set changed."""
        count = int(np.frombuffer(data, "<u4", 1)[0])
        if count == 0:
            return False
        changed = np.cumsum(unshuffle(data, np.uint32, count, 4).astype(np.int64)).astype(np.int32)
        self.pvs = np.setxor1d(self.pvs, changed, assume_unique=True)
        if changed[-1] >= len(self.row_of):
            grown = np.full(int(changed[-1] * 1.25) + 1, -1, np.int32)
            grown[: len(self.row_of)] = self.row_of
            self.row_of = grown
        new = changed[self.row_of[changed] < 0]
        self.row_of[new] = len(self.columns["flags"]) + np.arange(len(new))
        self._append(data, 4 + 4 * count, len(new))
        return True

    def _append(self, data: bytes, offset: int, count: int) -> None:
        """Read the columns of `count` new triangles."""
        chosen = {"uvs": Triangles.MASKED, "alphas": Triangles.FADED, "materials": SPECIAL}
        flags: Bytes = np.zeros(count, np.uint8)
        for name, (dtype, width) in self.dtypes.items():
            rows = np.flatnonzero(flags & chosen[name]) if name in chosen else np.arange(count)
            values = unshuffle(data, dtype, len(rows) * width, offset).reshape(len(rows), width)
            offset += values.nbytes
            added = np.zeros((count, width), dtype)
            added[rows] = values
            if name == "flags":
                flags = values[:, 0]
            self.columns[name] = np.concatenate([self.columns[name], added])
        if (flags & Triangles.BLENDED).any():
            fresh = int(np.frombuffer(data, "<u2", 1, offset)[0])
            materials = np.frombuffer(data, "<i2", fresh, offset + 2).tolist()
            opacities = np.frombuffer(data, "<u2", fresh, offset + 2 + 2 * fresh).tolist()
            self.opacities.update(zip(materials, opacities, strict=True))

    def current(self, name: str) -> Array:
        """A column, of any numbers, of the triangles in the current set, by ascending id: (n, width) or (n)."""
        values = self.columns[name][self.row_of[self.pvs]]
        return values[:, 0] if values.shape[1] == 1 else values

    def current_opacities(self) -> NDArray[np.uint16]:
        """uint16 (n): how much each triangle of the current set covers, 0..255; 256 where the alpha plane says it."""
        table = np.full(max(self.opacities, default=0) + 1, 255, np.uint16)
        table[list(self.opacities)] = list(self.opacities.values())
        opacities = np.full(len(self.pvs), 255, np.uint16)
        blended = (self.current("flags") & Triangles.BLENDED) > 0
        opacities[blended] = table[self.current("materials")[blended]]
        return opacities
