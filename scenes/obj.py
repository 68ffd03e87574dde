"""OBJ files (Wavefront): polygons by material.

Read here and not by trimesh, which cuts concave quadrilaterals wrongly and drops the texture coordinates of a material
where one of its faces has none.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Bools, Doubles, Floats, Longs
from shading_atlas_bench.scenes.file_colours import linear_colours, whole
from shading_atlas_bench.scenes.files import SceneFiles, shown, written_differently
from shading_atlas_bench.scenes.model import Indices, Material
from shading_atlas_bench.scenes.mtl import LibraryMaterial, read_mtl
from shading_atlas_bench.scenes.polygons import distinct, triangulated
from shading_atlas_bench.scenes.raw import Part, RawScene
from shading_atlas_bench.scenes.text_lines import TextLines, file_text, numbers

_Values = TypeVar("_Values", Doubles, Longs)

MOST_LIBRARIES = 1000  # more than that are no scene's, and each is looked for under many names
_MOST_WORDS = 16  # of a library's name among others in a line
_LONGEST_NAME = 4096  # bytes, of a path
_MTL = re.compile(rb"\.mtl(?=[ \t]|$)", re.IGNORECASE)
_NUMERIC = (b"v", b"vt", b"vn", b"f")
# Statements without a say in how the surface looks.
_SILENT = b"g o mg lod bevel c_interp d_interp shadow_obj trace_obj end mtllib".split()


def read_obj(path: Path, files: SceneFiles, raw: RawScene) -> None:
    """All faces of an OBJ file with their materials and textures.

    Raises ValueError or IndexError for damaged files.
    """
    text = original = file_text(path)
    if b"\\\n" in text:
        # The line goes on; not so after a byte of 128 or more, which in Japanese is one character with the backslash.
        text = re.sub(rb"(?<![\x80-\xff])\\ *\n", b" ", text)
    lines, kinds = _without_comments(TextLines(text))
    try:
        tables = [_table(lines, np.flatnonzero(kinds == number), kind) for number, kind in enumerate(_NUMERIC[:3])]
        faces = _faces(lines, kinds, [len(counts) for _, counts in tables], raw)
    except _LineError as error:
        raise ValueError(f"{_place(original, error.line)}: {error}") from error
    used, smoothing = _statements(lines, np.flatnonzero(kinds == len(_NUMERIC)), raw)
    materials = _Materials(path, text, used, files, raw)
    if not len(faces.lines):
        return
    positions, colours = _positions(*tables[0], raw)
    _add_parts(faces, positions, colours, _columns(*tables[1], 2), _columns(*tables[2], 3), materials, raw)
    rough = sum(len(part.indices) for part in raw.parts if part.normals is None)
    raw.note("Triangles in smoothing groups, made smooth by their angles instead: {}.", rough * smoothing)


def _libraries(path: Path, text: bytes, files: SceneFiles, raw: RawScene) -> list[tuple[bytes, Path | None]]:
    """Names after `mtllib` in an OBJ file's text, in order, each once, with the files; None where there is none.

    Those after the first MOST_LIBRARIES are noted only.
    """
    found: dict[bytes, Path | None] = {}
    for match in re.finditer(rb"mtllib[ \t]+([^\n]*)", text):
        if text[text.rfind(b"\n", 0, match.start()) + 1 : match.start()].strip():
            continue  # within a comment or a name
        for name, file in _named(path, match[1].strip(), files):
            found.setdefault(name, file)
            if len(found) > MOST_LIBRARIES:
                raw.note(f"The OBJ file names more than {MOST_LIBRARIES:,} material libraries: no more are read.")
                return list(found.items())[:MOST_LIBRARIES]
    return list(found.items())


def _named(path: Path, line: bytes, files: SceneFiles) -> Iterator[tuple[bytes, Path | None]]:
    """The names in what follows an `mtllib`, and their files.

    It may be several, and names may hold blanks: as many words are one name as make the name of a file.
    """
    blanks = [(blank.start(), blank.end()) for blank in re.finditer(rb"[ \t]+|$", line)]
    words = len(blanks)  # behind each of them is a blank, or the line's end
    start = word = 0
    while start < len(line):
        last = [words - 1] if len(line) - start <= _LONGEST_NAME and word + _MOST_WORDS < words else []
        several = [*last, *reversed(range(word, min(word + _MOST_WORDS, words)))]
        whole = next((number for number in several if files.find(path, line[start : blanks[number][0]])), None)
        if whole is None:
            first = _MTL.search(line, start)
            end = first.end() if first else len(line)
            whole = next(number for number in range(word, words) if blanks[number][0] >= end)
        name = line[start : blanks[whole][0]]
        yield name, files.find(path, name)
        start, word = blanks[whole][1], whole + 1


def _without_comments(lines: TextLines) -> tuple[TextLines, Indices]:
    """Lines whose numbers are followed by no comments, and their kinds: places in `_NUMERIC`, 4 others, 5 comments.

    Only numbers are searched for comments: names may hold a #.
    """
    kinds = _kinds(lines)
    marks = np.flatnonzero(lines.bytes == ord("#"))
    within = np.searchsorted(lines.ends, marks)
    if (kinds[within[within < len(kinds)]] < len(_NUMERIC)).any():
        lines = TextLines(re.sub(rb"^([ \t]*(?:v|vt|vn|f)[ \t][^\n#]*)#[^\n]*", rb"\1", lines.text, flags=re.MULTILINE))
        kinds = _kinds(lines)
    return lines, kinds


def _kinds(lines: TextLines) -> Indices:
    one, two, three = (lines.bytes[lines.starts + step] for step in range(3))
    short, longer = two <= ord(" "), three <= ord(" ")
    vertex = one == ord("v")
    kinds = np.full(len(lines.starts), 4, np.int8)
    kinds[vertex & short] = 0
    kinds[vertex & longer & (two == ord("t"))] = 1
    kinds[vertex & longer & (two == ord("n"))] = 2
    kinds[(one == ord("f")) & short] = 3
    kinds[one == ord("#")] = 5
    return kinds


def _table(lines: TextLines, rows: Indices, keyword: bytes) -> tuple[Doubles, Indices]:
    """All numbers of the lines of a kind, float64, and how many each line has, int64."""
    counts = lines.counts[rows] - 1

    def read(some: Indices) -> Doubles:
        return numbers(lines.joined(some, len(keyword)), _words(lines, some), np.float64)

    return _read(lines, rows, read), counts


def _corners(lines: TextLines, rows: Indices) -> Longs:
    """As `_fields`, of the lines of faces."""
    return _read(lines, rows, lambda some: _fields(lines.joined(some, 1), _words(lines, some)))


def _words(lines: TextLines, rows: Indices) -> int:
    """How many words follow the first ones of some lines."""
    return int((lines.counts[rows] - 1).sum())


class _LineError(ValueError):
    """Something in a line is not a number; line: its text."""

    def __init__(self, error: ValueError, line: bytes) -> None:
        super().__init__(str(error))
        self.line = line


def _read(lines: TextLines, rows: Indices, read: Callable[[Indices], _Values]) -> _Values:
    """What `read` makes of some lines; raises _LineError with the first of them that it cannot read."""
    try:
        return read(rows)
    except ValueError as error:
        while len(rows) > 1:  # the half with the first line that cannot be read
            half = rows[: len(rows) // 2]
            try:
                read(half)
                rows = rows[len(half) :]
            except ValueError:
                rows = half
        raise _LineError(error, lines.line(rows[0]) if len(rows) else b"") from error


def _place(text: bytes, line: bytes) -> str:
    """The number of the first such line; its text where it is put together of several, or lacks its comment."""
    found = re.search(rb"^[ \t]*" + re.escape(line.rstrip()) + rb"[ \t]*(?:#|$)", text, re.MULTILINE)
    number = text.count(b"\n", 0, found.start()) + 1 if found else 0
    return f"line {number}" if number else f"the line {shown(line[:40])}"


def _columns(values: Doubles, counts: Indices, size: int) -> Doubles:
    """The first numbers of each line, (lines, size); 0 where there are fewer."""
    if (counts == size).all():
        return values.reshape(-1, size)
    start = np.cumsum(counts) - counts
    table = np.zeros((len(counts), size))
    for column in range(size):
        has = counts > column
        table[has, column] = values[start[has] + column]
    return table


def _positions(values: Doubles, counts: Indices, raw: RawScene) -> tuple[Doubles, Floats | None]:
    """Positions, and colours where any line has six numbers; vertices without are white."""
    if counts.min(initial=3) < 3:
        raise ValueError("a vertex has fewer than three numbers")
    raw.note(
        "Vertices of the OBJ file with numbers after the position that are neither a colour nor 1, left out: {}.",
        np.count_nonzero(_strange(values, counts)),
    )
    coloured = counts == 6
    if not coloured.any():
        return _columns(values, counts, 3), None
    table = _columns(values, counts, 6)
    colours = np.ones((len(counts), 4), np.float32)
    colours[coloured] = linear_colours(raw, whole(table[coloured, 3:]))
    return table[:, :3], colours


def _strange(values: Doubles, counts: Indices) -> Bools:
    """Lines of 4, 5, 7 or more numbers whose fourth is not the usual weight of 1, or is not the last."""
    start = np.cumsum(counts) - counts
    weighted = counts == 4
    unusual = values[np.where(weighted, start + 3, 0)] != 1
    strange: Bools = ~np.isin(counts, (3, 4, 6)) | (weighted & unusual)
    return strange


def _statements(lines: TextLines, others: Indices, raw: RawScene) -> tuple[list[tuple[int, bytes]], bool]:
    """Lines and names of `usemtl`, and whether there are smoothing groups; statements that are not used are noted."""
    used: list[tuple[int, bytes]] = []
    left_out: Counter[bytes] = Counter()
    smoothing = False
    for number in others.tolist():
        key, _, rest = lines.line(number).replace(b"\t", b" ").partition(b" ")
        if key.lower() == b"usemtl":
            used.append((number, rest.strip()))
        elif key == b"s":
            smoothing |= rest.strip() not in (b"", b"off", b"0")
        elif key.lower() not in _SILENT:
            left_out[key] += 1
    if left_out:
        many = ", ".join(f"{shown(key[:20])} ({count:,})" for key, count in list(left_out.items())[:10])
        raw.note(f"Statements of the OBJ file that are not supported, left out: {many}.")
    return used, smoothing


class _Materials:
    """What `usemtl` names: `index` of a name in the scene's materials, and the library's entry by that index.

    Index 0 is grey, for faces without a material.
    """

    def __init__(
        self, path: Path, text: bytes, used: list[tuple[int, bytes]], files: SceneFiles, raw: RawScene
    ) -> None:
        self.entries, self.index = [LibraryMaterial(raw.materials[0])], {b"": 0}
        self._used = used
        defined = _defined(path, text, files, raw)
        undefined: list[str] = []
        plain = Counter(_plain(key) for key in defined)
        by_plain = {_plain(key): entry for key, entry in defined.items() if plain[_plain(key)] == 1}
        for name in dict.fromkeys(name for _, name in used):
            if name in self.index:
                continue
            entry = defined.get(name) or by_plain.get(_plain(name))
            if entry is None:
                undefined.append(shown(name))
                entry = LibraryMaterial(Material(name=shown(name), double_sided=True))
            self.index[name] = len(raw.materials)
            raw.materials.append(entry.material)
            self.entries.append(entry)
        if undefined:
            more = f" and {len(undefined) - 10:,} more" if len(undefined) > 10 else ""
            raw.note(f"Materials that no library defines, grey: {', '.join(undefined[:10])}{more}.")

    def at(self, lines: Indices) -> Indices:
        """Indices of the materials that faces in these lines have, int64."""
        current = np.searchsorted([line for line, _ in self._used], lines)
        return np.array([0, *(self.index[name] for _, name in self._used)])[current]


def _defined(path: Path, text: bytes, files: SceneFiles, raw: RawScene) -> dict[bytes, LibraryMaterial]:
    """The materials of all libraries by name; the first definition of a name counts, as the format's text says."""
    defined: dict[bytes, LibraryMaterial] = {}
    for name, file in _libraries(path, text, files, raw):
        if file is None:
            raw.note(f"The material library {shown(name)} {files.absence(path, name)}; its materials are grey.")
            continue
        if written_differently(name, file):
            raw.note(f"The material library {shown(name)} is read from {shown(file.name)}.")
        entries = read_mtl(file, files, raw)
        for twice in entries.keys() & defined.keys():
            raw.note(f"The material {shown(twice)} is defined in several libraries; the first of them counts.")
        defined = entries | defined
    return defined


def _plain(name: bytes) -> bytes:
    """A name without what may be a comment behind it, and with single blanks."""
    return b" ".join(re.sub(rb"[ \t]#.*", b"", name).split())


@dataclass
class _Faces:
    """Polygons of at least three corners.

    lines: int64 (P), where each stands. counts: int64 (P), its corners. v, vt, vn: int64 (C), what the corners refer
    to, from 0; -1 for no vt or vn.
    """

    lines: Indices
    counts: Indices
    v: Longs
    vt: Longs
    vn: Longs


def _faces(lines: TextLines, kinds: Indices, sizes: list[int], raw: RawScene) -> _Faces:
    """The file's faces; `sizes` counts v, vt and vn lines.

    Raises _LineError for what are no numbers, and for vertices that are not there.
    """
    rows = np.flatnonzero(kinds == 3)
    fields = _corners(lines, rows)
    given = fields[0].copy()
    counts = lines.counts[rows] - 1
    for kind, field in enumerate(fields):
        back = field < 0
        if back.any():  # counted backwards from the face's line
            before = np.repeat(np.cumsum(kinds == kind)[rows], counts)
            field[back] += before[back] + 1
            field[back & (field < 1)] = sizes[kind] + 1
    full = counts >= 3
    raw.note("Faces of fewer than three corners, dropped: {}.", np.count_nonzero(~full))
    corners = np.repeat(full, counts)
    v, vt, vn = (field[corners] - 1 for field in fields)
    outside = np.flatnonzero((v < 0) | (v >= sizes[0]))
    if len(outside):
        number = given[corners][outside[0]]
        why = f"which the file does not have: it has {sizes[0]:,}" if number else "but OBJ files count from 1"
        line = np.repeat(rows, counts)[corners][outside[0]]
        raise _LineError(ValueError(f"a face uses vertex {number}, {why}"), lines.line(line))
    return _Faces(rows[full], counts[full], v, vt, vn)


def _fields(text: bytes, count: int) -> Longs:
    """v, vt and vn of all corners of faces, int64 (3, C), as they stand there; 0 for those left out."""
    text += b"\n"
    if b"/" not in text:
        return np.stack([numbers(text, count, np.int64), np.zeros(count, np.int64), np.zeros(count, np.int64)])
    text = re.sub(rb"/(?=[ \t\n])", b"/0", text.replace(b"//", b"/0/"))
    letters = np.frombuffer(text, np.uint8)
    words = np.flatnonzero(np.diff(letters > ord(" "), prepend=False))[::2]
    slashes = np.searchsorted(np.flatnonzero(letters == ord("/")), np.append(words, len(letters)))
    given = np.diff(slashes) + 1
    values = numbers(text.replace(b"/", b" "), int(given.sum()), np.int64)
    start = np.cumsum(given) - given
    fields = np.zeros((3, count), np.int64)
    for field in range(3):
        has = given > field
        fields[field, has] = values[start[has] + field]
    return fields


def _add_parts(
    faces: _Faces,
    positions: Doubles,
    colours: Floats | None,
    uvs: Doubles,
    normals: Doubles,
    materials: _Materials,
    raw: RawScene,
) -> None:
    """Parts of materials one after the other, apart where only some of their faces have coordinates or normals."""
    material_of = materials.at(faces.lines)
    mapped = _whole(faces.vt, len(uvs), faces.counts, "texture coordinates", raw)
    smooth = _whole(faces.vn, len(normals), faces.counts, "normals", raw)
    bare = np.zeros(len(materials.entries), bool)
    bare[material_of[~mapped]] = True
    textured = np.array([entry.textured for entry in materials.entries])
    mapped &= (textured | ~bare)[material_of]  # coordinates that no texture needs do not split a part
    places, polygon = triangulated(positions, faces.v, faces.counts, raw)
    group = (material_of * 4 + mapped * 2 + smooth)[polygon]
    order = np.argsort(group, kind="stable")
    has = group[order] & 3
    scales, offsets = (np.array([getattr(e.lies, name) for e in materials.entries]) for name in ("scale", "offset"))
    for triangles in np.split(order, np.flatnonzero(np.diff(has)) + 1):
        if not len(triangles):
            continue
        corners, owners = places[triangles].ravel(), group[triangles] >> 2
        kind = int(group[triangles[0]]) & 3
        columns = [np.repeat(owners, 3), faces.v[corners]]
        columns += [faces.vt[corners]] * (kind >> 1) + [faces.vn[corners]] * (kind & 1)
        first, number = distinct(columns)
        corner, owner = corners[first], columns[0][first]
        part = Part(positions[faces.v[corner]], number.reshape(-1, 3), 0, materials=owners)
        part.colours = None if colours is None else colours[faces.v[corner]]
        part.normals = normals[faces.vn[corner]] if kind & 1 else None
        if kind >> 1:
            moved = uvs[faces.vt[corner]] * scales[owner] + offsets[owner]
            part.uvs = np.stack([moved[:, 0], 1 - moved[:, 1]], axis=1)  # counted from a picture's upper edge
        raw.parts.append(part)


def _whole(field: Longs, size: int, counts: Indices, what: str, raw: RawScene) -> Bools:
    """Faces (P) whose corners all refer to something that is there; those of which only some do are noted."""
    good: Longs = np.add.reduceat((field >= 0) & (field < size), np.cumsum(counts) - counts, dtype=np.int64)
    meant = np.add.reduceat(field >= 0, np.cumsum(counts) - counts, dtype=np.int64) > 0
    raw.note(
        f"Faces with {what} that are missing at some corners, drawn without them: {{}}.",
        (meant & (good < counts)).sum(),
    )
    complete: Bools = good == counts
    return complete
