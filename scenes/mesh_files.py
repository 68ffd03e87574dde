"""OBJ with MTL, PLY, STL and OFF files."""

from __future__ import annotations

from pathlib import Path

from shading_atlas_bench.scenes.files import SceneFiles
from shading_atlas_bench.scenes.model import Material
from shading_atlas_bench.scenes.obj import read_obj
from shading_atlas_bench.scenes.off import read_off
from shading_atlas_bench.scenes.ply import read_ply
from shading_atlas_bench.scenes.raw import RawScene
from shading_atlas_bench.scenes.stl import read_stl

_READERS = {".obj": read_obj, ".off": read_off, ".ply": read_ply, ".stl": read_stl}


def read_mesh_file(path: Path, files: SceneFiles, raw: RawScene) -> None:
    """All triangles of an OBJ, PLY, STL or OFF file with its materials and textures; what is left out is noted.

    Raises SceneError, or some other exception for damaged files.
    """
    raw.materials.append(Material(name="default", double_sided=True))
    _READERS[path.suffix.lower()](path, files, raw)
