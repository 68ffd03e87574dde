"""MTL material libraries (Wavefront, as OBJ files name them)."""

from __future__ import annotations

import math
import re
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Bytes
from shading_atlas_bench.scenes.files import SceneFiles, shown, written_differently
from shading_atlas_bench.scenes.images import ImageError, read_texture
from shading_atlas_bench.scenes.model import Material, Texture
from shading_atlas_bench.scenes.raw import RawScene
from shading_atlas_bench.scenes.text_lines import file_text

_NUMBER = re.compile(rb"[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?$")
_SWITCH = re.compile(rb"(on|off)$", re.IGNORECASE)
_CHANNEL = re.compile(rb"[rgbmlz]$", re.IGNORECASE)
_SHAPE = re.compile(rb"(sphere|cube_\w+)$", re.IGNORECASE)
# Options of a map statement (Wavefront MTL specification, texture map options): what their values look like, how many
# there are at most, and which ones change nothing.
_OPTIONS: dict[str, tuple[re.Pattern[bytes], int, list[float | bytes]]] = {
    "-o": (_NUMBER, 3, [0.0, 0.0, 0.0]),
    "-s": (_NUMBER, 3, [1.0, 1.0, 1.0]),
    "-clamp": (_SWITCH, 1, [b"off"]),
    "-t": (_NUMBER, 3, [0.0, 0.0, 0.0]),
    "-mm": (_NUMBER, 2, [0.0, 1.0]),
    "-bm": (_NUMBER, 1, [1.0]),
    "-boost": (_NUMBER, 1, [0.0]),
    "-texres": (_NUMBER, 1, []),
    "-blendu": (_SWITCH, 1, [b"on"]),
    "-blendv": (_SWITCH, 1, [b"on"]),
    "-cc": (_SWITCH, 1, [b"off"]),
    "-imfchan": (_CHANNEL, 1, []),
    "-type": (_SHAPE, 1, []),
}
_MAPS = ("map_kd", "map_ke", "map_d")
_USED = {"kd", "ke", "ns", "d", "tr", *_MAPS}
# Ambient light is the scene's, not a material's; illumination model and refraction index mean nothing on their own.
_SILENT = {"ka", "map_ka", "illum", "ni", "sharpness"}


@dataclass
class MapStatement:
    """A texture of a material: the file's name as it is written, and how its picture lies on the surface.

    scale, offset: texture coordinates times the one plus the other are the picture's, v counted from its lower edge.
    clamped: whether outside the picture its edge goes on, not the picture again. ignored: options that are not applied.
    """

    name: bytes
    scale: tuple[float, float] = (1.0, 1.0)
    offset: tuple[float, float] = (0.0, 0.0)
    clamped: bool = False
    ignored: list[str] = field(default_factory=list)

    def lies_as(self, other: MapStatement) -> bool:
        """Whether both pictures lie on a surface in the same way: scaled, shifted and clamped alike."""
        return (self.scale, self.offset, self.clamped) == (other.scale, other.offset, other.clamped)


@dataclass(frozen=True)
class FoundMap:
    """A texture of a material, and the picture's file."""

    statement: MapStatement
    file: Path


@dataclass
class LibraryMaterial:
    """A material, and how its textures lie on the surface; all of them do so in the same way."""

    material: Material
    lies: MapStatement = field(default_factory=lambda: MapStatement(b""))

    @property
    def textured(self) -> bool:
        """Whether the material has a texture of colour or of light."""
        return max(self.material.base_texture, self.material.emissive_texture) >= 0


def read_mtl(library: Path, files: SceneFiles, raw: RawScene) -> dict[bytes, LibraryMaterial]:
    """The library's materials by name; their textures go into the raw scene.

    Understood: Kd, Ke, Ns, d, Tr, map_Kd, map_Ke, map_d (as a cut-out mask in the colour texture's alpha), and of the
    options of maps -s, -o and -clamp; what else changes the look is noted. Colours are taken as linear. OBJ has no
    notion of single-sided surfaces, so all are double-sided. Of several definitions of a name the first counts.
    """
    reader = _Reader(library, files, raw)
    found: dict[bytes, LibraryMaterial] = {}
    unused: Counter[str] = Counter()
    for name, statements in _entries(library):
        if name in found:
            raw.note(f"The material {shown(name)} is defined again in {shown(library.name)}; the first of them counts.")
            continue
        found[name] = reader.material(shown(name), statements)
        unused.update(key for key, value in statements.items() if _matters(key, value))
    if unused:
        many = ", ".join(f"{_as_written(key)} ({count:,})" for key, count in unused.items())
        raw.note(f"Statements of materials in {shown(library.name)} that are not supported, left out: {many}.")
    return found


def map_statement(value: bytes) -> MapStatement:
    """What follows `map_Kd` and the like: options, and a file's name, which may hold blanks."""
    found, words, at = MapStatement(b""), list(re.finditer(rb"\S+", value)), 0
    while at < len(words) and (option := words[at][0].lower().decode("latin-1")) in _OPTIONS:
        pattern, most, neutral = _OPTIONS[option]
        at += 1
        values: list[float | bytes] = []
        while len(values) < most and at + 1 < len(words) and pattern.match(word := words[at][0]):
            values.append(float(word) if pattern is _NUMBER else word.lower())
            at += 1
        if option == "-s":
            found.scale = _pair(values, 1.0)
        elif option == "-o":
            found.offset = _pair(values, 0.0)
        elif option == "-clamp":
            found.clamped = values == [b"on"]
        elif values != neutral[: len(values)] or not neutral:
            found.ignored.append(option)
    found.name = value[words[at].start() :].strip() if at < len(words) else b""
    return found


def _pair(values: list[float | bytes], default: float) -> tuple[float, float]:
    """The first two numbers, the default where there are fewer."""
    first, second, *_ = [*(value for value in values if isinstance(value, float)), default, default]
    return first, second


class _Reader:
    """Makes materials of one library; each picture is read once."""

    def __init__(self, library: Path, files: SceneFiles, raw: RawScene) -> None:
        self.library, self.files, self.raw = library, files, raw
        self.textures: dict[tuple[Path | None, Path | None, bool], int] = {}

    def material(self, name: str, statements: dict[str, bytes]) -> LibraryMaterial:
        base, mask, glow = self._maps(name, statements)
        base_texture, emissive_texture = self._texture(base, mask), self._texture(glow, None)
        alpha = self._opacity(name, statements)
        diffuse = self._colour(name, "kd", statements, 0.8)
        if base and base_texture >= 0 and not any(diffuse):
            diffuse = (1.0, 1.0, 1.0)  # exporters write black where a texture stands for the colour
        shininess = (_numbers(statements.get("ns", b""), 1) or [0.0])[0]
        masked = mask is not None and base_texture >= 0
        material = Material(
            name=name,
            base_colour=(*diffuse, alpha),
            base_texture=base_texture,
            emissive=self._colour(name, "ke", statements, 0.0),
            emissive_texture=emissive_texture,
            # Blinn-Phong exponent to GGX roughness
            roughness=min(1.0, math.sqrt(math.sqrt(2.0 / (max(shininess, 0.0) + 2.0)))),
            alpha_mode="blend" if alpha < 1 else "mask" if masked else "opaque",
            double_sided=True,
        )
        lies = next((used.statement for used in (base, mask, glow) if used), MapStatement(b""))
        return LibraryMaterial(material, lies)

    def _maps(self, name: str, statements: dict[str, bytes]) -> list[FoundMap | None]:
        """The statements of `_MAPS` that are used, in the order base, mask, glow; what is left out of them is noted."""
        found: list[FoundMap | None] = []
        for key in ("map_kd", "map_d", "map_ke"):
            statement = map_statement(statements[key]) if key in statements else None
            first = next((other.statement for other in found if other), statement)
            if statement and not statement.name:
                self.raw.note(f"{_as_written(key)} of the material {name} names no file.")
                statement = None
            elif statement and first and not statement.lies_as(first):
                self.raw.note(
                    f"{_as_written(key)} of the material {name} is left out: its -s, -o or -clamp differ from those of "
                    "its other map."
                )
                statement = None
            for option in statement.ignored if statement else ():
                self.raw.note(f"The option {option} of {_as_written(key)} of the material {name} is left out.")
            found.append(self._found(statement) if statement else None)
        return found

    def _colour(self, name: str, key: str, statements: dict[str, bytes], default: float) -> tuple[float, float, float]:
        numbers = _numbers(statements.get(key, b""), 3)
        if key in statements and not numbers:
            self.raw.note(f"{_as_written(key)} of the material {name} is not three numbers and left out.")
        red, green, blue = numbers or [default] * 3
        return red, green, blue

    def _opacity(self, name: str, statements: dict[str, bytes]) -> float:
        value = statements.get("d", b"")
        if value.lower().startswith(b"-halo"):
            self.raw.note(f"The option -halo of d of the material {name} is left out.")
            value = value[5:]
        found = _numbers(value, 1) or [1 - t for t in _numbers(statements.get("tr", b""), 1)]
        self.raw.note(f"The opacity of the material {name} is no number and left out.", not found and "d" in statements)
        return found[0] if found else 1.0

    def _found(self, statement: MapStatement) -> FoundMap | None:
        """The statement with its file; None where there is none."""
        file = self.files.find(self.library, statement.name)
        if file is None:
            why = self.files.absence(self.library, statement.name)
            self.raw.note(f"The texture {shown(statement.name)} is left out: the file {why}.")
            return None
        if written_differently(statement.name, file):
            self.raw.note(f"The texture {shown(statement.name)} is read from {shown(file.name)}.")
        return FoundMap(statement, file)

    def _texture(self, picture: FoundMap | None, mask: FoundMap | None) -> int:
        """Index in the raw scene of a picture whose alpha is the mask's first channel; -1 where neither can be used."""
        first = picture or mask
        if first is None:
            return -1
        if picture and mask and picture.file == mask.file:
            mask = None  # the picture's own alpha
        key = (picture.file if picture else None, mask.file if mask else None, first.statement.clamped)
        if key not in self.textures:
            colours = self._texels(picture.file, True) if picture else None
            alpha = self._texels(mask.file, False) if mask else None
            texels = None if picture and colours is None else _masked(colours, alpha)
            self.textures[key] = -1
            if texels is not None:
                self.textures[key] = len(self.raw.textures)
                wrap = "clamp" if first.statement.clamped else "repeat"
                self.raw.textures.append(Texture(shown(first.file.name), texels, True, wrap, wrap))
        return self.textures[key]

    def _texels(self, file: Path, srgb: bool) -> Bytes | None:
        try:
            return read_texture(file, shown(file.name), srgb, self.raw)
        except ImageError as error:
            self.raw.note(f"The texture {shown(file.name)} is left out: {error}.")
        return None


def _masked(picture: Bytes | None, mask: Bytes | None) -> Bytes | None:
    """A picture with the mask in its alpha, white where it is missing; None where both are."""
    if mask is None:
        return picture
    if picture is None:
        picture = np.full_like(mask, 255)
    row, column = (np.arange(size) * old // size for size, old in zip(picture.shape[:2], mask.shape[:2], strict=True))
    return np.concatenate([picture[..., :3], mask[row][:, column, :1]], axis=2)


def _entries(library: Path) -> list[tuple[bytes, dict[str, bytes]]]:
    """Names of a library's materials and their statements, by lower-case keyword; the last of equal ones counts."""
    entries: list[tuple[bytes, dict[str, bytes]]] = []
    for line in file_text(library).replace(b"\t", b" ").split(b"\n"):
        key, _, value = line.strip().partition(b" ")
        if key.lower() == b"newmtl":
            entries.append((value.strip(), {}))
        elif value and entries and not key.startswith(b"#"):
            entries[-1][1][shown(key).lower()] = value.strip()
    return entries


def _matters(key: str, value: bytes) -> bool:
    """Whether a statement that is not understood changes the look: a colour of 0 does not, nor a filter of 1."""
    neutral = {"tf": 1.0, "pr": None}.get(key, 0.0)
    numbers = _numbers(value, len(value.split(b"#")[0].split()))
    return key not in _USED | _SILENT and not (numbers and all(number == neutral for number in numbers))


def _as_written(keyword: str) -> str:
    """A keyword in the usual upper and lower case."""
    start, bar, rest = keyword.rpartition("_")
    return f"{start}{bar}{rest.capitalize() if len(rest) == 2 else rest}"


def _numbers(text: bytes, count: int) -> list[float]:
    """The first `count` numbers of a statement; empty where there are fewer or other words."""
    words = text.split(b"#")[0].split()[:count]
    try:
        values = [float(word) for word in words]
    except ValueError:
        return []
    return values * count if len(values) == 1 else values if len(values) == count else []
