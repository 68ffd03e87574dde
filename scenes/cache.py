"""Loaded scenes on disk as raw arrays that are mapped into memory, not read.

One folder per scene, named after a digest of everything that went into it: the bytes of all input files, the options
and the source of this package and of `arithmetic`. It is written beside and renamed, so that concurrent runs see a
whole one or none.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import shutil
import tempfile
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path

import numpy as np

import arithmetic
import scenes
from scenes.model import Camera, CameraAnimation, Features, Light, Material, Scene, Sky, Texture

_ARRAYS = ("positions", "indices", "normals", "uvs", "colours", "material_ids", "tangents", "origin", "route")
_RECORD = "scene.json"


def scene_key(options: dict, files: Iterable[Path]) -> str:
    """Digest of the options, of the files' names and bytes (missing ones count as such) and of the loader itself."""
    digest = hashlib.blake2b(json.dumps(options, sort_keys=True).encode(), digest_size=16)
    sources = [file for module in (arithmetic, scenes) for file in sorted(Path(module.__file__).parent.glob("*.py"))]
    for file in [*sources, *files]:
        content = file.read_bytes() if file.is_file() else b"missing"
        digest.update(f"\n{file.name} {len(content)}\n".encode())
        digest.update(content)
    return digest.hexdigest()


def store(folder: Path, scene: Scene) -> None:
    """Write a scene as `folder`; a whole one that is there already stays, because it is the same."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    temporary = Path(tempfile.mkdtemp(dir=folder.parent, suffix=".part"))
    try:
        arrays = {name: getattr(scene, name) for name in _ARRAYS if getattr(scene, name) is not None}
        arrays |= {f"texture{number}": texture.texels for number, texture in enumerate(scene.textures)}
        for number, animation in enumerate(scene.animations):
            arrays |= {f"{part}{number}": getattr(animation, part) for part in ("times", "positions", "orientations")}
        for name, array in arrays.items():
            np.save(temporary / f"{name}.npy", np.ascontiguousarray(array))
        (temporary / _RECORD).write_text(json.dumps(_record(scene)))
        if fetch(folder) is None:
            shutil.rmtree(folder, ignore_errors=True)  # damaged, or not there at all
            with contextlib.suppress(OSError):  # another run was faster
                temporary.rename(folder)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def fetch(folder: Path) -> Scene | None:
    """The scene stored as `folder`, its arrays mapped read-only; None where there is none or it cannot be read."""
    try:
        record = json.loads((folder / _RECORD).read_text())
        arrays = {name: _mapped(folder, name) for name in _ARRAYS if (folder / f"{name}.npy").is_file()}
        textures = [
            Texture(entry["name"], _mapped(folder, f"texture{number}"), *entry["settings"])
            for number, entry in enumerate(record["textures"])
        ]
        animations = [
            CameraAnimation(
                name, *(_mapped(folder, f"{part}{number}") for part in ("times", "positions", "orientations"))
            )
            for number, name in enumerate(record["animations"])
        ]
        return Scene(
            **arrays,
            **record["plain"],
            textures=textures,
            animations=animations,
            materials=[Material(**_tupled(entry)) for entry in record["materials"]],
            lights=[Light(**_tupled(entry)) for entry in record["lights"]],
            cameras=[Camera(**_tupled(entry)) for entry in record["cameras"]],
            sky=Sky(**_tupled(record["sky"])),
            features=Features(**record["features"]),
        )
    except (OSError, ValueError, KeyError, TypeError, EOFError):
        return None


_PLAIN = ("name", "exposure", "metres_per_unit", "place", "notes", "content_hash")


def _record(scene: Scene) -> dict:
    """Everything but the arrays, as JSON holds it."""
    return {
        "plain": {name: getattr(scene, name) for name in _PLAIN},
        "textures": [{"name": t.name, "settings": [t.srgb, t.wrap_s, t.wrap_t]} for t in scene.textures],
        "animations": [animation.name for animation in scene.animations],
        "materials": [asdict(material) for material in scene.materials],
        "lights": [asdict(light) for light in scene.lights],
        "cameras": [asdict(camera) for camera in scene.cameras],
        "sky": asdict(scene.sky),
        "features": asdict(scene.features),
    }


def _mapped(folder: Path, name: str) -> np.ndarray:
    return np.load(folder / f"{name}.npy", mmap_mode="r")


def _tupled(entry: dict) -> dict:
    return {key: tuple(value) if isinstance(value, list) else value for key, value in entry.items()}
