"""Which files a scene file draws in, found without loading it."""

from __future__ import annotations

from pathlib import Path

from shading_atlas_bench.scenes.files import file_text, named_file
from shading_atlas_bench.scenes.gltf_document import named_files
from shading_atlas_bench.scenes.mtl import map_files
from shading_atlas_bench.scenes.obj import library_files
from shading_atlas_bench.scenes.ply import ply_textures


def input_files(path: Path) -> list[Path]:
    """The file itself, `cameras.json` beside it, and every buffer, image and material library that it names.

    They need not exist. Damaged files name nothing: loading them says what is wrong.
    """
    files = [path, path.parent / "cameras.json"]
    suffix = path.suffix.lower()
    if suffix in (".gltf", ".glb"):
        files += named_files(path)
    elif suffix == ".obj":
        for name, library in library_files(path, file_text(path)):
            library = library or named_file(path, name)
            files += [library, *map_files(library)]
    elif suffix == ".ply":
        files += ply_textures(path)
    return list(dict.fromkeys(files))
