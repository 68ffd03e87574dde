"""MTL material libraries (Wavefront, as OBJ files name them)."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np

from scenes.files import beside
from scenes.images import read_image
from scenes.model import Material, Texture
from scenes.raw import RawScene

# Options of a map statement and how many values follow each (Wavefront MTL specification, texture map options).
_MAP_OPTIONS = {"-o": 3, "-s": 3, "-t": 3, "-mm": 2, "-bm": 1, "-clamp": 1, "-blendu": 1, "-blendv": 1, "-boost": 1}
_MAP_OPTIONS |= {"-texres": 1, "-imfchan": 1, "-type": 1, "-cc": 1}


def material_libraries(obj: bytes) -> list[str]:
    """File names after `mtllib` in an OBJ file's bytes, in order, each once."""
    lines = re.findall(rb"^[ \t]*mtllib[ \t]+([^\r\n]*)", obj, re.MULTILINE)
    return list(dict.fromkeys(line.decode("utf-8", errors="replace").strip() for line in lines))


def map_files(library: Path) -> list[Path]:
    """Image files that a material library names; they need not exist."""
    statements = (line.split(None, 1) for line in _lines(library))
    names = (
        _map_name(line[1]) for line in statements if len(line) == 2 and line[0].lower().startswith(("map_", "bump"))
    )
    return [beside(library, name) for name in dict.fromkeys(names)]


def read_mtl(library: Path, raw: RawScene) -> dict[str, Material]:
    """The library's materials by name; their textures go into the raw scene.

    Understood: Kd, Ke, Ns, d, Tr, map_Kd, map_Ke, map_d (as a cut-out mask in the colour texture's alpha). Colours are
    taken as linear. OBJ has no notion of single-sided surfaces, so all are double-sided.
    """
    entries: dict[str, dict[str, str]] = {}
    current: dict[str, str] = {}
    for line in _lines(library):
        key, _, value = line.partition(" ")
        if key.lower() == "newmtl":
            current = entries.setdefault(" ".join(value.split()), {})
        elif value:
            current[key.lower()] = value.strip()
    textures: dict[tuple[Path, Path | None], int] = {}
    return {name: _material(name, entry, library, textures, raw) for name, entry in entries.items()}


def _material(
    name: str, entry: dict[str, str], library: Path, textures: dict[tuple[Path, Path | None], int], raw: RawScene
) -> Material:
    opacity = _numbers(entry.get("d", ""), 1) or [1 - t for t in _numbers(entry.get("tr", ""), 1)] or [1.0]
    mask = beside(library, _map_name(entry["map_d"])) if "map_d" in entry else None
    base = _texture(library, entry.get("map_kd"), mask, textures, raw)
    diffuse = _numbers(entry.get("kd", ""), 3) or [0.8] * 3
    if base >= 0 and not any(diffuse):
        diffuse = [1.0] * 3  # exporters write black where a texture stands for the colour
    shininess = (_numbers(entry.get("ns", ""), 1) or [0.0])[0]
    emissive = _numbers(entry.get("ke", ""), 3) or [0.0] * 3
    return Material(
        name=name,
        base_colour=(*diffuse, opacity[0]),
        base_texture=base,
        emissive=tuple(emissive),
        emissive_texture=_texture(library, entry.get("map_ke"), None, textures, raw),
        roughness=min(
            1.0, math.sqrt(math.sqrt(2.0 / (max(shininess, 0.0) + 2.0)))
        ),  # Blinn-Phong exponent to GGX roughness
        alpha_mode="blend" if opacity[0] < 1 else "mask" if mask is not None and base >= 0 else "opaque",
        double_sided=True,
    )


def _texture(
    library: Path,
    statement: str | None,
    mask: Path | None,
    textures: dict[tuple[Path, Path | None], int],
    raw: RawScene,
) -> int:
    """Index of a map statement's texture in the raw scene, or -1 where there is none or it is unusable (noted)."""
    if not statement:
        return -1
    file = beside(library, _map_name(statement))
    if (file, mask) not in textures:
        try:
            texels = read_image(file)
            if mask is not None and mask != file:
                texels[..., 3] = _resized(read_image(mask)[..., 0], texels.shape[:2])
            textures[file, mask] = len(raw.textures)
            raw.textures.append(Texture(file.name, texels))
        except ValueError as error:
            textures[file, mask] = -1
            reason = str(error) if file.is_file() else "the file is missing"
            raw.note(f"The texture {file.name} is left out: {reason}.")
    return textures[file, mask]


def _resized(channel: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """The nearest texels of a channel (H, W) at another size."""
    row = np.arange(shape[0]) * channel.shape[0] // shape[0]
    column = np.arange(shape[1]) * channel.shape[1] // shape[1]
    return channel[row][:, column]


def _lines(library: Path) -> list[str]:
    if not library.is_file():
        return []
    text = library.read_bytes().decode("utf-8", errors="replace").replace("\t", " ")
    return [line.strip() for line in re.sub(r"(^| )#.*", "", text, flags=re.MULTILINE).splitlines() if line.strip()]


def _map_name(statement: str) -> str:
    """The file name of a map statement, its options skipped."""
    words = statement.split()
    while words and words[0].lower() in _MAP_OPTIONS:
        words = words[1 + _MAP_OPTIONS[words[0].lower()] :]
    return " ".join(words)


def _numbers(text: str, count: int) -> list[float]:
    """The first `count` numbers of a statement; empty where there are fewer or other words."""
    try:
        values = [float(word) for word in text.split()[:count]]
    except ValueError:
        return []
    return values * count if len(values) == 1 else values if len(values) == count else []
