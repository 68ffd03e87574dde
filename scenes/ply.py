"""PLY files (Stanford): vertices, faces and triangle strips, as text and as bytes of either order.

Read here and not by trimesh, which knows no strips and no binary lists of several lengths, and takes 16-bit colours as
bytes.
"""

from __future__ import annotations

import itertools
import re
import struct
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Array, Doubles, Floats, Longs
from shading_atlas_bench.scenes.file_colours import linear_colours
from shading_atlas_bench.scenes.files import SceneFiles, shown, written_differently
from shading_atlas_bench.scenes.images import ImageError, read_texture
from shading_atlas_bench.scenes.model import Indices, Material, Texture
from shading_atlas_bench.scenes.polygons import distinct, triangulated, usable_polygons, vertex_numbers
from shading_atlas_bench.scenes.raw import Part, RawScene
from shading_atlas_bench.scenes.text_lines import count_words, numbers

_TYPES = {"char": "b", "uchar": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I", "float": "f", "double": "d"}
_TYPES |= {"int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I", "int64": "q"}
_TYPES |= {"uint64": "Q", "float16": "e", "float32": "f", "float64": "d"}
_SIZES = {"b": "i1", "B": "u1", "h": "i2", "H": "u2", "i": "i4", "I": "u4", "q": "i8", "Q": "u8"}
_SIZES |= {"e": "f2", "f": "f4", "d": "f8"}

_INDICES = ("vertex_indices", "vertex_index")
_UVS = (("texture_u", "texture_v"), ("u", "v"), ("s", "t"))
_COLOURS = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b"))
_ALPHAS = ("alpha", "diffuse_alpha", "a")


@dataclass
class Element:
    """A table of the file: its rows' number and, by name, its properties.

    kinds: of each property the type of its values and, for lists, of their lengths, as `struct` names types.
    values: the properties' values; those of lists one after the other. lengths: int64 (rows), of each list.
    used: properties that were asked for.
    """

    name: str
    rows: int
    kinds: dict[str, tuple[str, str]] = field(default_factory=dict)
    values: dict[str, Array] = field(default_factory=dict)
    lengths: dict[str, Indices] = field(default_factory=dict)
    used: set[str] = field(default_factory=set)

    def chosen(self, *choices: tuple[str, ...]) -> tuple[str, ...] | None:
        """The first choice of properties of which all are there and no lists."""
        there = self.values.keys() - self.lengths.keys()
        return next((names for names in choices if there.issuperset(names)), None)

    def columns(self, *choices: tuple[str, ...]) -> Array | None:
        """The properties of the first choice of which all are there, as `stacked` gives them."""
        names = self.chosen(*choices)
        return None if names is None else self.stacked(names)

    def stacked(self, names: tuple[str, ...]) -> Array:
        """Properties that are there, side by side (rows, names), of any numbers: of a type that holds them all."""
        self.used.update(names)
        return np.stack([self.values[name] for name in names], axis=1)

    def list(self, *names: str) -> tuple[Array, Indices] | None:
        """Values, of any numbers, one list after the other, and lengths, int64 (rows), of the first of these that is
        there."""
        for name in names:
            if name in self.lengths:
                self.used.add(name)
                return self.values[name], self.lengths[name]
        return None


def read_ply(path: Path, files: SceneFiles, raw: RawScene) -> None:
    """All faces and strips of a PLY file with colours, texture coordinates and textures.

    Raises ValueError or struct.error for damaged files.
    """
    data = path.read_bytes()
    header, body = _halves(data)
    elements = _elements(header)
    _read_values(elements, body, header)
    tables = {element.name: element for element in elements}
    vertices = tables.get("vertex", Element("vertex", 0))
    positions = vertices.columns(("x", "y", "z"))
    if positions is None:
        raise ValueError("its vertices have no x, y and z")
    whole = Part(np.asarray(positions, np.float64), np.zeros((0, 3), np.int64), 0)
    whole.normals = vertices.columns(("nx", "ny", "nz"))
    uvs = vertices.columns(*_UVS)
    whole.uvs = None if uvs is None else _turned(uvs)
    whole.colours = _colours(vertices, raw)
    pictures = _pictures(header)
    if "face" in tables:
        raw.parts += _faces(tables["face"], whole, len(pictures), raw)
    if "tristrips" in tables:
        raw.parts.append(_strips(tables["tristrips"], whole))
    _add_materials(path, pictures, files, raw)
    _note_unused(elements, raw)


def _pictures(header: bytes) -> list[bytes]:
    """Names in comments, as common tools write them."""
    lines = re.findall(rb"comment[ \t]+TextureFile[ \t]+([^\r\n]+)", header, re.IGNORECASE)
    return [line.strip() for line in lines]


def _halves(data: bytes) -> tuple[bytes, bytes]:
    """Header and what follows; lines of the header end as its first one does, what follows may begin with any byte."""
    first = re.match(rb"ply[ \t]*(\r\n|\n|\r)", data)
    if first is None:
        raise ValueError("it does not begin with a line that says ply")
    end = re.search(rb"[\r\n]end_header[ \t]*(" + first[1] + rb"|$)", data)
    if end is None:
        raise ValueError("its header does not end")
    return data[: end.start()], data[end.end() :]


def _elements(header: bytes) -> list[Element]:
    elements: list[Element] = []
    for line in header.decode("latin-1").splitlines()[1:]:
        words = line.split()
        if words[:1] == ["element"] and len(words) == 3 and re.fullmatch(r"-?\d{1,18}", words[2]):
            elements.append(Element(words[1], int(words[2])))
        elif words[:2] == ["property", "list"] and len(words) == 5 and elements and _TYPES.keys() >= set(words[2:4]):
            elements[-1].kinds[words[4]] = (_TYPES[words[3]], _TYPES[words[2]])
        elif words[:1] == ["property"] and len(words) == 3 and elements and words[1] in _TYPES:
            elements[-1].kinds[words[2]] = (_TYPES[words[1]], "")
        elif words and words[0] not in ("comment", "obj_info", "format"):
            raise ValueError(f"its header has a line that cannot be read: {line[:60]}")
    if any(element.rows < 0 for element in elements):
        raise ValueError("its header counts less than nothing")
    return elements


def _read_values(elements: list[Element], body: bytes, header: bytes) -> None:
    """All values of the elements. Text is read as if it were bytes, those of numbers of one kind, doubles."""
    form = re.search(rb"[\r\n]format[ \t]+(ascii|binary_little_endian|binary_big_endian)\b", header)
    if form is None:
        raise ValueError("its header tells no known format")
    text, order = form[1] == b"ascii", ">" if form[1] == b"binary_big_endian" else "<"
    if text:
        body = numbers(body, count_words(body), np.float64).astype("<f8").tobytes()
    at = 0
    for element in elements:
        at = _read_element(element, body, at, order, text)
    if at > len(body) or (body[at:] if text else body[at : at + 64].strip()):
        raise ValueError("its header tells of less or more than it holds")


def _read_element(element: Element, body: bytes, at: int, order: str, text: bool) -> int:
    """Fill an element's values from the byte `at` on; returns the byte after it."""
    stored = {name: ("d", kind[1] and "d") if text else kind for name, kind in element.kinds.items()}
    least = sum(struct.calcsize(order + (length or kind)) for kind, length in stored.values())  # of a row
    if element.rows * least > len(body) - at:
        raise ValueError(f"it ends within the {element.rows:,} rows that it claims to have of {element.name}")
    read = _read_equal(element, stored, body, at, order) if element.rows and stored else at
    if read is None:
        read = _read_different(element, stored, body, at, order)
    for name, values in element.values.items():
        declared = values.astype(_SIZES[element.kinds[name][0]])
        as_declared = not text or declared.dtype.kind == "f" or (declared == values).all()
        element.values[name] = declared if as_declared else values
    return read


def _read_equal(element: Element, stored: dict[str, tuple[str, str]], body: bytes, at: int, order: str) -> int | None:
    """As `_read_element`, all rows at once; None where not every row's lists are as long as those of the first."""
    fields: list[tuple[str, str] | tuple[str, str, tuple[int]]] = []
    end = at
    for number, (kind, length) in enumerate(stored.values()):
        count = 1
        if length:
            count = _length(struct.unpack_from(order + length, body, end)[0])
            fields.append((f"length{number}", order + _SIZES[length]))
            end += struct.calcsize(order + length)
        fields.append((f"value{number}", order + _SIZES[kind], (count,)))
        end += count * struct.calcsize(order + kind)
    row = end - at
    if element.rows * row > len(body) - at or row <= 0:
        return None
    table = np.frombuffer(body, np.dtype(fields), element.rows, at)
    lists = [number for number, (_, length) in enumerate(stored.values()) if length]
    if any((table[f"length{number}"] != table[f"value{number}"].shape[1]).any() for number in lists):
        return None
    for number, (name, (_, length)) in enumerate(stored.items()):
        values = table[f"value{number}"]
        element.values[name] = values.reshape(-1)
        if length:
            element.lengths[name] = np.full(element.rows, values.shape[1], np.int64)
    return at + element.rows * row


def _length(stored: float) -> int:
    """A list's length; raises ValueError for what is none."""
    if not (stored >= 0 and stored % 1 == 0):
        raise ValueError(f"a list has {stored:g} values")
    return int(stored)


def _read_different(element: Element, stored: dict[str, tuple[str, str]], body: bytes, at: int, order: str) -> int:
    """As `_read_element`, row by row."""
    steps = [
        (struct.Struct(order + length).unpack_from if length else None, struct.calcsize(order + (length or kind)))
        for kind, length in stored.values()
    ]
    sizes = [struct.calcsize(order + kind) for kind, _ in stored.values()]
    places: list[list[int]] = [[] for _ in stored]
    lengths: list[list[int]] = [[] for _ in stored]
    columns = list(zip(steps, sizes, places, lengths, strict=True))
    for _ in range(element.rows):
        for (unpack, step), size, place, length in columns:
            if unpack is None:
                place.append(at)
            else:
                count = _length(unpack(body, at)[0])
                place.append(at + step)
                length.append(count)
                at += count * size
            at += step
        if at > len(body):
            raise ValueError("it ends within its data")
    letters = np.frombuffer(body, np.uint8)
    for (name, (kind, prefix)), size, starts, counts in zip(stored.items(), sizes, places, lengths, strict=True):
        first = np.array(starts, np.int64)
        if prefix:
            element.lengths[name] = np.array(counts, np.int64)
            begin = np.cumsum(element.lengths[name]) - element.lengths[name]
            within = np.arange(element.lengths[name].sum()) - np.repeat(begin, element.lengths[name])
            first = np.repeat(first, element.lengths[name]) + size * within
        element.values[name] = letters[first[:, None] + np.arange(size)].reshape(-1).view(order + _SIZES[kind])
    return at


def _colours(element: Element, raw: RawScene) -> Floats | None:
    """Linear RGBA, float32 (rows, 4): what a value means follows from its own type, whatever those beside it have."""
    rgb = element.chosen(*_COLOURS)
    if rgb is None:
        return None
    alike = itertools.groupby(rgb, key=lambda name: element.kinds[name])
    channels = [element.stacked(tuple(names)) for _, names in alike]
    alpha = element.columns(*((name,) for name in _ALPHAS))
    if alpha is not None and alpha.dtype == channels[-1].dtype:
        channels[-1] = np.concatenate([channels[-1], alpha], axis=1)
    elif alpha is not None:
        channels.append(alpha)
    return linear_colours(raw, *channels)


def _turned(uvs: Array) -> Doubles:
    """Texture coordinates (N, 2), float64, counted from a picture's upper edge instead of its lower one."""
    return np.stack([uvs[:, 0], 1 - uvs[:, 1].astype(np.float64)], axis=1)


def _faces(element: Element, whole: Part, pictures: int, raw: RawScene) -> list[Part]:
    """Parts of the faces, with the vertices of `whole`; several where the faces use several pictures."""
    lists = list(element.lengths)
    table = element.list(*_INDICES, *(lists if len(lists) == 1 else []))
    if table is None:
        return []
    values, counts = table
    corners = vertex_numbers(values)
    usable = usable_polygons(corners, counts, len(whole.positions), raw)
    kept = np.repeat(usable, counts)
    corners = corners[kept]
    places, polygon = triangulated(whole.positions, corners, counts[usable], raw)
    part = replace(whole, indices=corners[places])
    wedges = element.list("texcoord")
    if wedges is not None and (wedges[1] == 2 * counts).all():
        part = _with_wedges(part, places.ravel(), wedges[0].reshape(-1, 2)[kept])
    elif wedges is not None:
        raw.note("Texture coordinates of faces, which are not two for each corner, left out: {}.", len(counts))
    colours = _colours(element, raw) if whole.colours is None else None
    if colours is not None:
        part = part.taking(part.indices.ravel(), np.arange(part.indices.size).reshape(-1, 3))
        part.colours = np.repeat(colours[usable][polygon], 3, axis=0)
    number = element.columns(("texnumber",))
    if number is None:
        return [part]
    number = number[usable, 0][polygon].astype(np.int64)
    number[(number < 0) | (number >= pictures)] = pictures
    return [
        replace(part, indices=part.indices[number == picture], material=int(picture)) for picture in np.unique(number)
    ]


def _with_wedges(part: Part, corners: Longs, uvs: Array) -> Part:
    """A part whose triangles' corners, int64 (3 T) places in `uvs`, have texture coordinates of their own."""
    exact = np.ascontiguousarray(uvs, np.float32).view(np.int64).ravel()
    same = np.unique(exact, return_inverse=True)[1]
    first, number = distinct([part.indices.ravel(), same[corners]])
    split = part.taking(part.indices.ravel()[first], number.reshape(-1, 3))
    split.uvs = _turned(uvs[corners[first]])
    return split


def _strips(element: Element, whole: Part) -> Part:
    """The triangles of strips, which end at -1; every second one turns the other way."""
    table = element.list(*_INDICES)
    if table is None:
        return whole
    values, lengths = table
    values = np.insert(vertex_numbers(values), np.cumsum(lengths), -1)
    places = np.arange(len(values))
    last_end = np.maximum.accumulate(np.where(values < 0, places, -1))
    odd = ((places - last_end) % 2 == 0)[:-2]
    a, b, c = values[:-2], values[1:-1], values[2:]
    drawn = (np.minimum(np.minimum(a, b), c) >= 0) & (a != b) & (b != c) & (a != c)  # repeats only join strips
    triangles = np.stack([np.where(odd, b, a), np.where(odd, a, b), c], axis=1)
    return replace(whole, indices=triangles[drawn])


def _add_materials(path: Path, pictures: list[bytes], files: SceneFiles, raw: RawScene) -> None:
    """A material for each picture, the first one being the default, and one without for faces that have none."""
    default = raw.materials.pop()
    for name in pictures:
        raw.materials.append(_material(path, name, files, raw))
    raw.materials.append(default)


def _material(path: Path, name: bytes, files: SceneFiles, raw: RawScene) -> Material:
    material, file = Material(name=shown(name), double_sided=True), files.find(path, name)
    try:
        if file is None:
            raise ImageError(f"the file {files.absence(path, name)}")
        raw.textures.append(Texture(shown(file.name), read_texture(file, shown(file.name), True, raw)))
    except ImageError as error:
        raw.note(f"The texture {shown(name)} is left out: {error}.")
        return material
    raw.note(f"The texture {shown(name)} is read from {shown(file.name)}.", written_differently(name, file))
    return replace(material, base_texture=len(raw.textures) - 1, base_colour=(1.0, 1.0, 1.0, 1.0))


def _note_unused(elements: list[Element], raw: RawScene) -> None:
    filled = [element for element in elements if element.rows]
    tables = [f"{element.name} ({element.rows:,})" for element in filled if not element.used]
    if tables:
        raw.note(f"Elements of the PLY file that are not supported, left out: {', '.join(tables)}.")
    rest = [
        f"{element.name} {name}"
        for element in filled
        if element.used
        for name in element.kinds
        if name not in element.used
    ]
    if rest:
        raw.note(f"Properties of the PLY file that are not supported, left out: {', '.join(rest)}.")
