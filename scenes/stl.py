"""STL files: bytes, and text, which trimesh's format reader reads."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from shading_atlas_bench.scenes.files import SceneFiles
from shading_atlas_bench.scenes.model import SceneError
from shading_atlas_bench.scenes.raw import Part, RawScene

_HEAD = 84  # bytes: 80 of any text and the count of triangles
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attributes", "<u2")])
_MARKS = (b"\xff\xfe", b"\xfe\xff")  # of UTF-16, a text with zeros


def read_stl(path: Path, _files: SceneFiles, raw: RawScene) -> None:
    """All triangles of an STL file, text or bytes; colours, which programs keep in various ways, are noted only.

    Raises SceneError where triangles of a text cannot be read, or bytes are of another number than their count tells,
    ValueError for damaged texts, or whatever else trimesh raises.
    """
    if not _is_text(path):
        table = np.fromfile(path, _TRIANGLE, offset=_HEAD)
        corners = np.ascontiguousarray(table["corners"]).reshape(-1, 3)
        coloured = np.count_nonzero(table["attributes"])
        raw.note("Triangles with a colour in the STL file's attributes, left out: {}.", coloured)
        raw.parts.append(Part(corners, np.arange(len(corners), dtype=np.int32).reshape(-1, 3), 0))
        return
    from trimesh.exchange.stl import load_stl_ascii

    with path.open("rb") as file, warnings.catch_warnings():
        warnings.filterwarnings("error", category=DeprecationWarning, message=".*unmatched data")  # cut off silently
        try:
            mesh = load_stl_ascii(file)
        except UnicodeDecodeError:
            raise
        except ValueError as error:
            if "reshape" in str(error):
                raise SceneError("not every facet in it has three vertices.") from error
            raise ValueError("its lines do not follow each other as the format has them") from error
    for solid in mesh["geometry"].values() if "geometry" in mesh else [mesh]:
        raw.parts.append(Part(np.asarray(solid["vertices"], np.float64), np.asarray(solid["faces"], np.int64), 0))
    _check_text(path, sum(len(part.indices) for part in raw.parts))


def _is_text(path: Path) -> bool:
    """Whether a file is text. Raises SceneError for one of bytes that is longer or shorter than its count needs."""
    with path.open("rb") as file:
        head, size = file.read(_HEAD), path.stat().st_size
        count = int.from_bytes(head[80:], "little")
        needed = _HEAD + _TRIANGLE.itemsize * count
        if size == needed:
            return False
        data = head + file.read()
    if b"\0" not in data or b"facet" in data[:1024].lower() or data.startswith(_MARKS):
        return True
    if size < _HEAD:
        raise SceneError(f"it is cut off: it has {size:,} bytes, fewer than a binary STL file's head of {_HEAD}.")
    wrong = "is cut off" if size < needed else "goes on behind its triangles"
    sentence = f"it has {size:,} bytes where its count of {count:,} triangles needs {needed:,}"
    raise SceneError(f"it {wrong}, or its count is wrong: {sentence}.")


def _check_text(path: Path, read: int) -> None:
    """Raises SceneError where a text holds other than the triangles that were read."""
    facets = path.read_bytes().lower().count(b"endfacet")
    if facets != read:
        raise SceneError(f"of its {facets:,} triangles only {read:,} can be read; it is damaged.")
