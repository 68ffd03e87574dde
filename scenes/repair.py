"""Repair and decimation of parts through pymeshlab, on request."""

from __future__ import annotations

import ctypes
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Doubles
from shading_atlas_bench.scenes.model import Indices, SceneError
from shading_atlas_bench.scenes.raw import Part, RawScene
from shading_atlas_bench.scenes.system_libraries import missing_library

_SMALLEST = 16  # triangles of a part below which decimation would only make holes


def repaired(part: Part, raw: RawScene) -> Part:
    """The part without duplicate faces, faces of no area and faces at non-manifold edges; what goes is counted.

    Vertices at the same position count as one, so that edges along texture seams are seen as the edges they are. Only
    triangles are removed: those that stay keep all their attributes.
    """
    pymeshlab = load_pymeshlab()
    corners, welded = _welded(part)
    proper = (corners != corners[:, [1, 2, 0]]).all(axis=1)
    kept = np.flatnonzero(proper)
    raw.note("Repair dropped degenerate triangles: {}.", np.count_nonzero(~proper))
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(welded, corners[kept].astype(np.int32), f_scalar_array=kept.astype(np.float64)))
    for work, sentence in (
        ("meshing_remove_duplicate_faces", "Repair dropped duplicate triangles: {}."),
        ("meshing_remove_null_faces", "Repair dropped triangles without area: {}."),
        ("meshing_repair_non_manifold_edges", "Repair dropped triangles at non-manifold edges: {}."),
    ):
        before = meshes.current_mesh().face_number()
        if before:
            _apply(meshes, work)
        raw.note(sentence, before - meshes.current_mesh().face_number())
    kept = np.sort(np.rint(meshes.current_mesh().face_scalar_array()).astype(np.int64))
    return part.taking(np.arange(len(part.positions)), part.indices[kept])


def decimated(part: Part, ratio: float, raw: RawScene) -> Part:
    """The part with about `ratio` of its triangles, by quadric edge collapse (Garland and Heckbert 1997).

    Open borders are held, texture coordinates are part of the error, normals are made anew, and colours and further
    sets of texture coordinates are taken from the nearest old vertex. Parts that would end below 16 triangles stay.
    """
    target = int(len(part.indices) * ratio)
    if target < _SMALLEST:
        raw.note("Parts too small to decimate, kept: {}.")
        return part
    pymeshlab = load_pymeshlab()
    corners, welded = _welded(part)
    proper = (corners != corners[:, [1, 2, 0]]).all(axis=1)
    options = {"targetfacenum": target, "preserveboundary": True, "preservenormal": True}
    meshes = pymeshlab.MeshSet()
    if part.uvs is None:
        meshes.add_mesh(pymeshlab.Mesh(welded, corners[proper].astype(np.int32)))
        _apply(meshes, "meshing_decimation_quadric_edge_collapse", planarquadric=True, **options)
    else:
        # Coordinates of corners handed over directly count as absent; those of vertices can be moved to the corners.
        arrays = (np.asarray(part.positions, np.float64), part.indices[proper].astype(np.int32))
        meshes.add_mesh(pymeshlab.Mesh(*arrays, v_tex_coords_matrix=np.asarray(part.uvs, np.float64)))
        _apply(meshes, "compute_texcoord_transfer_vertex_to_wedge")
        _apply(meshes, "meshing_remove_duplicate_vertices")
        _apply(meshes, "meshing_decimation_quadric_edge_collapse_with_texture", **options)
    result = meshes.current_mesh()
    faces = result.face_matrix().astype(np.int64)
    raw.note("Decimation removed triangles (before instancing): {}.", len(part.indices) - len(faces))
    uvs = None if part.uvs is None else result.wedge_tex_coord_matrix()
    return _rebuilt(part, result.vertex_matrix(), faces, uvs)


def _apply(meshes: Any, work: str, **options: object) -> None:
    """One pymeshlab filter; raises SceneError where it fails."""
    try:
        meshes.apply_filter(work, **options)
    except Exception as error:
        reason = str(error).strip().splitlines()[-1]
        raise SceneError(f"pymeshlab could not do {work} ({reason}); load the file without it.") from error


def _rebuilt(part: Part, positions: Doubles, faces: Indices, wedges: Doubles | None) -> Part:
    """A part from decimated geometry; vertices are split where their texture coordinates differ."""
    new = Part(positions, faces, part.material, transforms=part.transforms)
    if wedges is not None:
        rows = np.column_stack([faces.ravel(), wedges])
        _, first, inverse = np.unique(rows, axis=0, return_index=True, return_inverse=True)
        new = new.taking(faces.ravel()[first], inverse.reshape(-1, 3))
        new.uvs = wedges[first]
    if part.colours is not None or part.further_uvs:
        from scipy.spatial import cKDTree

        nearest = cKDTree(part.positions).query(new.positions)[1]
        new.colours = None if part.colours is None else part.colours[nearest]
        new.further_uvs = tuple(None if uvs is None else uvs[nearest] for uvs in part.further_uvs)
    return new


def _welded(part: Part) -> tuple[Indices, Doubles]:
    """Triangles (T, 3) of vertices at distinct positions, and these, float64."""
    points, number = np.unique(np.asarray(part.positions, np.float64), axis=0, return_inverse=True)
    return number.reshape(-1)[part.indices], points


def load_pymeshlab() -> ModuleType:
    """pymeshlab, which needs the system's OpenGL libraries even where it draws nothing; nothing else here does.

    Raises SceneError, saying what to install.
    """
    found = find_spec("pymeshlab")
    if found is None or found.origin is None:
        raise SceneError("--repair and --decimate need pymeshlab: pip install -e '.[repair]' brings it.")
    try:
        if sys.platform == "linux":  # pymeshlab itself loads without a library that only its filters need
            ctypes.CDLL(str(Path(found.origin).parent / "lib" / "plugins" / "libfilter_meshing.so"))
        return import_module("pymeshlab")
    except (ImportError, OSError) as error:
        library, remedy = missing_library(error) or ("", "")
        reason = f"the system library {library} for pymeshlab: {remedy}" if library else f"pymeshlab, but {error}"
        raise SceneError(f"--repair and --decimate need {reason}.") from error
