"""OBJ with MTL, PLY, STL and OFF files."""

from __future__ import annotations

from pathlib import Path

from scenes.model import Material
from scenes.obj import read_obj
from scenes.off import read_off
from scenes.ply import read_ply
from scenes.raw import RawScene
from scenes.stl import read_stl

_READERS = {".obj": read_obj, ".off": read_off, ".ply": read_ply, ".stl": read_stl}


def read_mesh_file(path: Path) -> RawScene:
    """All triangles of an OBJ, PLY, STL or OFF file with its materials and textures; what is left out is noted.

    Raises SceneError, or some other exception for damaged files.
    """
    raw = RawScene()
    raw.materials.append(Material(name="default", double_sided=True))
    _READERS[path.suffix.lower()](path, raw)
    return raw
