"""STL files, read by trimesh's format reader."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from scenes.model import SceneError
from scenes.raw import Part, RawScene


def read_stl(path: Path, raw: RawScene) -> None:
    """All triangles of an STL file, text or bytes; colours, which programs keep in various ways, are noted only.

    Raises SceneError where triangles of a text cannot be read, or, for damaged files, whatever trimesh raises.
    """
    from trimesh.exchange.stl import load_stl

    with path.open("rb") as file, warnings.catch_warnings():
        warnings.filterwarnings("error", category=DeprecationWarning, message=".*unmatched data")  # cut off silently
        mesh = load_stl(file)
    solids = mesh["geometry"].values() if "geometry" in mesh else [mesh]
    for solid in solids:
        positions, indices = (
            np.asarray(solid[key], kind) for key, kind in (("vertices", np.float64), ("faces", np.int64))
        )
        raw.parts.append(Part(positions, indices, 0))
        colours = solid.get("face_attributes", {}).get("stl", np.zeros(0))
        raw.note("Triangles with a colour in the STL file's attributes, left out: {}.", np.count_nonzero(colours))
    if not any("face_attributes" in solid for solid in solids):
        _check_text(path, sum(len(part.indices) for part in raw.parts))


def _check_text(path: Path, read: int) -> None:
    """Raises SceneError where a text holds other than the triangles that were read."""
    facets = path.read_bytes().lower().count(b"endfacet")
    if facets != read:
        raise SceneError(f"Of its {facets:,} triangles only {read:,} can be read; it is damaged.")
