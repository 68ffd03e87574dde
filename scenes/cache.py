"""Loaded scenes on disk, their arrays mapped into memory, not copied.

One file per scene, named after a digest of what its loading starts from: the scene file, the options and the source of
this package and of `arithmetic`. With the scene it holds the list of all further files that the reader asked for, and
what was in them: a scene counts as missing where one of them has changed, came or went. A checksum over all of it tells
a damaged file, which is as good as a missing one; a warning says so. It is written beside and renamed over what is
there, so that concurrent runs see a whole one or none.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import tempfile
import warnings
import zlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from shading_atlas_bench import arithmetic, scenes
from shading_atlas_bench.arithmetic.arrays import Array, Bytes
from shading_atlas_bench.scenes.files import is_file
from shading_atlas_bench.scenes.inputs import Input
from shading_atlas_bench.scenes.model import Camera, CameraAnimation, Features, Light, Material, Scene, Sky, Texture

_ARRAYS = (
    "positions",
    "indices",
    "normals",
    "uvs",
    "colours",
    "material_ids",
    "tangents",
    "further_uvs",
    "origin",
    "route",
)
# A file: the CRC-32 of the file's name and of all that follows; the record's length; the record, which is JSON and says
# where each array lies; the arrays. The checksum runs at 2 to 3 GB/s, a large scene has 0.2 GB.
_NUMBER = 4  # bytes of each number
_ALIGNMENT = 64  # bytes, of arrays within the file
_BLOCK = 1 << 18  # bytes read at a time, so that they stay in the processor's cache


def scene_key(options: Mapping[str, object], files: Iterable[Path]) -> str:
    """Digest of the options, of the files' names and bytes (missing ones count as such) and of the loader itself."""
    digest = hashlib.blake2b(json.dumps(options, sort_keys=True).encode(), digest_size=16)
    sources = [file for module in (arithmetic, scenes) for file in sorted(Path(module.__path__[0]).glob("*.py"))]
    for file in [*sources, *files]:
        digest.update(os.fsencode(f"\n{file.name} {file.stat().st_size if is_file(file) else 'missing'}\n"))
        if is_file(file):
            with file.open("rb") as stream:
                while block := stream.read(_BLOCK):
                    digest.update(block)
    return digest.hexdigest()


def store(path: Path, scene: Scene, inputs: Iterable[Input] = ()) -> None:
    """Write a scene, and the files that were asked for to load it, as the file `path`, replacing what is there.

    Where it cannot be written (a full disk, a folder without permission) a warning says so, and it is only loaded again
    next time.
    """
    arrays = _arrays(scene)
    places, end = {}, 0
    for name, array in arrays.items():
        places[name] = (array.dtype.str, array.shape, end)
        end += array.nbytes + -array.nbytes % _ALIGNMENT
    record = json.dumps({"arrays": places, "inputs": list(inputs)} | _record(scene)).encode()
    record += b" " * (-(2 * _NUMBER + len(record)) % _ALIGNMENT)
    parts: list[bytes | memoryview] = [len(record).to_bytes(_NUMBER, "little"), record]
    for array in arrays.values():
        parts += [array.data, bytes(-array.nbytes % _ALIGNMENT)]
    checksum = _start(path)
    for part in parts:
        checksum = zlib.crc32(part, checksum)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".part")
        try:
            with os.fdopen(handle, "wb") as file:
                file.writelines([checksum.to_bytes(_NUMBER, "little"), *parts])
            if path.is_dir():  # a file cannot replace a folder; nothing of a concurrent run's is one
                shutil.rmtree(path, ignore_errors=True)
            os.replace(temporary, path)
        except BaseException:
            Path(temporary).unlink(missing_ok=True)
            raise
    except OSError as error:
        _warn_once(f"Scenes cannot be kept in {path.parent} ({error.strerror}): they are loaded anew each time.")


def fetch(path: Path, unchanged: Callable[[list[Input]], bool] = lambda _: True) -> Scene | None:
    """The scene stored as `path`, its arrays mapped read-only; None where it is missing, unreadable or damaged, or its
    input files are not `unchanged`."""
    data = _checked(path)
    if data is None:
        return None
    start = 2 * _NUMBER + int.from_bytes(data[_NUMBER : 2 * _NUMBER], "little")
    record = json.loads(bytes(data[2 * _NUMBER : start]))
    if not unchanged([tuple(asked) for asked in record["inputs"]]):
        return None
    arrays = {
        name: data[start + place :][: np.dtype(dtype).itemsize * int(np.prod(shape))].view(dtype).reshape(shape)
        for name, (dtype, shape, place) in record["arrays"].items()
    }
    textures = [
        Texture(entry["name"], arrays[f"texture{number}"], *entry["settings"])
        for number, entry in enumerate(record["textures"])
    ]
    animations = [
        CameraAnimation(name, *(arrays[f"{part}{number}"] for part in _ANIMATED))
        for number, name in enumerate(record["animations"])
    ]
    return Scene(
        **{name: arrays[name] for name in _ARRAYS if name in arrays},
        **record["plain"],
        textures=textures,
        animations=animations,
        materials=[Material(**_tupled(entry)) for entry in record["materials"]],
        lights=[Light(**_tupled(entry)) for entry in record["lights"]],
        cameras=[Camera(**_tupled(entry)) for entry in record["cameras"]],
        sky=Sky(**_tupled(record["sky"])),
        features=Features(**record["features"]),
    )


def _checked(path: Path) -> Bytes | None:
    """The whole file, mapped, uint8, if its checksum holds.

    It is read for that, not looked at through the mapping: where a disk fails, reading is an error that can be caught.
    """
    if not os.path.lexists(path):
        return None
    try:
        if path.is_file():  # other things might block
            with path.open("rb", buffering=0) as file:
                expected, found = file.read(_NUMBER), _start(path)
                block = memoryview(bytearray(_BLOCK))
                while length := file.readinto(block):
                    found = zlib.crc32(block[:length], found)
                if expected == found.to_bytes(_NUMBER, "little"):
                    return np.memmap(file, np.uint8, "r")
    except FileNotFoundError:  # the cache was deleted just now
        return None
    except (OSError, ValueError):  # a file emptied just now cannot be mapped
        pass
    _warn_once(f"The scene {path} was damaged: it is loaded again.")
    return None


@cache  # the filters of `warnings` forget what was said whenever somebody changes them
def _warn_once(sentence: str) -> None:
    warnings.warn(sentence, stacklevel=2)


def _start(path: Path) -> int:
    """The checksum before the first byte: a file under another's name is not taken for it."""
    return zlib.crc32(path.name.encode())


def _arrays(scene: Scene) -> dict[str, Array]:
    """All arrays of a scene by their names in the file, contiguous."""
    arrays = {name: getattr(scene, name) for name in _ARRAYS if getattr(scene, name) is not None}
    arrays |= {f"texture{number}": texture.texels for number, texture in enumerate(scene.textures)}
    for number, animation in enumerate(scene.animations):
        arrays |= {f"{part}{number}": getattr(animation, part) for part in _ANIMATED}
    return {name: np.ascontiguousarray(array) for name, array in arrays.items()}


_ANIMATED = ("times", "positions", "orientations")
_PLAIN = ("name", "exposure", "metres_per_unit", "unit_from", "place", "because", "notes", "content_hash")


def _record(scene: Scene) -> dict[str, Any]:
    """Everything but the arrays, as JSON holds it."""
    return {
        "plain": {name: getattr(scene, name) for name in _PLAIN},
        "textures": [{"name": t.name, "settings": [t.srgb, t.wrap_s, t.wrap_t]} for t in scene.textures],
        "animations": [animation.name for animation in scene.animations],
        "materials": [vars(material) for material in scene.materials],  # `asdict` copies, which takes a while
        "lights": [asdict(light) for light in scene.lights],
        "cameras": [asdict(camera) for camera in scene.cameras],
        "sky": asdict(scene.sky),
        "features": asdict(scene.features),
    }


def _tupled(entry: dict[str, Any]) -> dict[str, Any]:
    return {key: tuple(value) if isinstance(value, list) else value for key, value in entry.items()}
