"""STL files, read by trimesh's format reader."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from shading_atlas_bench.scenes.files import SceneFiles
from shading_atlas_bench.scenes.model import SceneError
from shading_atlas_bench.scenes.raw import Part, RawScene

_HEAD, _TRIANGLE = 84, 50  # bytes: 80 of any text and the count; a normal, three corners, and 2 of attributes
_MARKS = (b"\xff\xfe", b"\xfe\xff")  # of UTF-16, a text with zeros


def read_stl(path: Path, _files: SceneFiles, raw: RawScene) -> None:
    """All triangles of an STL file, text or bytes; colours, which programs keep in various ways, are noted only.

    Raises SceneError where triangles of a text cannot be read, or bytes are of another number than their count tells,
    or, for damaged files, whatever trimesh raises.
    """
    from trimesh.exchange.stl import load_stl

    _check_size(path)
    with path.open("rb") as file, warnings.catch_warnings():
        warnings.filterwarnings("error", category=DeprecationWarning, message=".*unmatched data")  # cut off silently
        try:
            mesh = load_stl(file)
        except ValueError as error:
            if "reshape" not in str(error):
                raise
            raise SceneError("Not every facet in it has three vertices.") from error
    solids = mesh["geometry"].values() if "geometry" in mesh else [mesh]
    for solid in solids:
        raw.parts.append(Part(np.asarray(solid["vertices"], np.float64), np.asarray(solid["faces"], np.int64), 0))
        colours = solid.get("face_attributes", {}).get("stl", np.zeros(0))
        raw.note("Triangles with a colour in the STL file's attributes, left out: {}.", np.count_nonzero(colours))
    if not any("face_attributes" in solid for solid in solids):
        _check_text(path, sum(len(part.indices) for part in raw.parts))


def _check_size(path: Path) -> None:
    """Raises SceneError where a file of bytes is longer or shorter than its count of triangles needs."""
    with path.open("rb") as file:
        head, size = file.read(_HEAD), path.stat().st_size
        count = int.from_bytes(head[80:], "little")
        needed = _HEAD + _TRIANGLE * count
        if size == needed:
            return
        data = head + file.read()
    if b"\0" not in data or b"facet" in data[:1024].lower() or data.startswith(_MARKS):
        return
    if size < _HEAD:
        raise SceneError(f"It is cut off: it has {size:,} bytes, fewer than a binary STL file's head of {_HEAD}.")
    wrong = "is cut off" if size < needed else "goes on behind its triangles"
    sentence = f"it has {size:,} bytes where its count of {count:,} triangles needs {needed:,}"
    raise SceneError(f"It {wrong}, or its count is wrong: {sentence}.")


def _check_text(path: Path, read: int) -> None:
    """Raises SceneError where a text holds other than the triangles that were read."""
    facets = path.read_bytes().lower().count(b"endfacet")
    if facets != read:
        raise SceneError(f"Of its {facets:,} triangles only {read:,} can be read; it is damaged.")
