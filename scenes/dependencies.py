"""Which files a scene file draws in, found without loading it."""

from __future__ import annotations

from pathlib import Path

from shading_atlas_bench.scenes.cameras import CAMERAS
from shading_atlas_bench.scenes.files import SceneFiles
from shading_atlas_bench.scenes.gltf_document import named_files
from shading_atlas_bench.scenes.mtl import map_files
from shading_atlas_bench.scenes.obj import library_files
from shading_atlas_bench.scenes.ply import ply_textures
from shading_atlas_bench.scenes.text_lines import file_text


def input_files(path: Path, files: SceneFiles) -> list[Path]:
    """The file itself, `cameras.json` beside it, and every buffer, image and material library that it names.

    They need not exist. Damaged files name nothing: loading them says what is wrong. Raises SceneError for names that
    `files` does not allow.
    """
    found = [path, files.exact(path, CAMERAS)]
    suffix = path.suffix.lower()
    if suffix in (".gltf", ".glb"):
        found += named_files(path, files)
    elif suffix == ".obj":
        for name, library in library_files(path, file_text(path), files):
            library = library or files.expect(path, name)
            found += [library, *map_files(library, files)]
    elif suffix == ".ply":
        found += ply_textures(path, files)
    return list(dict.fromkeys(found))
