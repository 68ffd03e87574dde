"""OFF files (Geomview's object file format): polygons with normals, colours and texture coordinates.

Read here and not by trimesh, which reads no colours.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Doubles, Floats
from shading_atlas_bench.scenes.file_colours import linear_colours, whole
from shading_atlas_bench.scenes.files import SceneFiles
from shading_atlas_bench.scenes.model import Indices, SceneError
from shading_atlas_bench.scenes.polygons import triangulated, usable_polygons, vertex_numbers
from shading_atlas_bench.scenes.raw import Part, RawScene
from shading_atlas_bench.scenes.text_lines import TextLines, file_text, numbers

_SIZES = re.compile(rb"\s*(\d+)\s+(\d+)(?!\S)(?:[ \t]+\d+(?!\S)|\s+\d+(?=[ \t]*\n))?")


@dataclass
class Faces:
    """Where the faces of a file stand.

    values: float64 (N), numbers of the file, and `text` what they were read from. first: int64 (P), the place of each
    face's first corner in them. counts: of its corners. sizes: of what comes behind these. left: lines behind the last.
    """

    values: Doubles
    first: Indices
    counts: Indices
    sizes: Indices
    left: int
    text: bytes


def read_off(path: Path, _files: SceneFiles, raw: RawScene) -> None:
    """All faces of an OFF file, with what its first word tells of vertices: ST, C and N before OFF.

    Numbers may stand in any lines, but for colours of faces: those end with the line.
    Raises SceneError for binary files and those of another number of dimensions, ValueError for damaged ones.
    """
    text = re.sub(rb"#[^\n]*", b"", file_text(path))
    head = re.match(rb"\s*(?:(ST)?(C)?(N)?(4?n?)OFF\b)?\s*(BINARY)?", text)
    assert head is not None  # every part of the pattern may be absent
    if head[4] or head[5]:
        raise SceneError("its points are binary or of more than three dimensions; it has to be a plain OFF file.")
    sizes = _SIZES.match(text, head.end())
    if sizes is None:
        raise ValueError("it does not begin with OFF and the numbers of its vertices and faces")
    vertices, faces = int(sizes[1]), int(sizes[2])
    lines = TextLines(text[sizes.end() :] + b"\n")
    has = tuple(bool(prefix) for prefix in head.groups()[:3])
    widths = lines.counts[:vertices]
    width = int(widths.max(initial=3))
    if len(widths) == vertices and (widths == width).all():
        table, rest = lines.joined(np.arange(vertices)), np.arange(vertices, len(lines.starts))
        layout = _in_lines(lines, rest, faces) or _anyhow(lines, rest, faces)
    else:
        width = _width(has)
        table, lines = _cut(lines, vertices * width)
        layout = _behind(lines, faces)
    part = _vertices(numbers(table, vertices * width, np.float64).reshape(vertices, width), has, raw)
    raw.note("Lines behind the last face of the OFF file, left out: {}.", layout.left)
    raw.parts.append(_with_faces(part, layout, raw))


def _width(has: tuple[bool, ...]) -> int:
    """Values of a vertex: its position, and the normal, colour and coordinates that the first word tells of."""
    textured, coloured, smooth = has
    return 3 + 3 * smooth + 4 * coloured + 2 * textured


def _cut(lines: TextLines, words: int) -> tuple[bytes, TextLines]:
    """The first words of some lines, one at least, and the lines of the others."""
    ends = np.cumsum(lines.counts)
    if words > ends[-1:].sum():
        raise ValueError("it ends before its last vertex")
    row = int(np.searchsorted(ends, words))
    in_row = words - int(ends[row] - lines.counts[row])
    cut = lines.starts[row] + list(re.finditer(rb"[^\0- ]+", lines.line(row)))[in_row - 1].end()
    return lines.text[:cut], TextLines(lines.text[cut:])


def _behind(lines: TextLines, faces: int) -> Faces:
    """The faces behind vertices that do not have a line each; one number too many or too few shows here."""
    rows = np.arange(len(lines.starts))
    try:
        layout = _in_lines(lines, rows, faces) or _anyhow(lines, rows, faces)
    except ValueError as error:
        raise ValueError(f"its vertices do not have a line each, and number by number {error}") from None
    if layout.left:
        raise ValueError("its vertices have different numbers of values")
    return layout


def _in_lines(lines: TextLines, rows: Indices, faces: int) -> Faces | None:
    """Faces that have a line each; None where they do not."""
    if faces > len(rows):
        return None
    widths, text = lines.counts[rows[:faces]], lines.joined(rows[:faces])
    values = numbers(text, int(widths.sum()), np.float64)
    start = np.cumsum(widths) - widths
    counts = values[start]
    if not ((counts == np.floor(counts)) & (counts >= 0) & (counts < widths)).all():
        return None
    counts = counts.astype(np.int64)
    return Faces(values, start + 1, counts, widths - counts - 1, len(rows) - faces, text)


def _anyhow(lines: TextLines, rows: Indices, faces: int) -> Faces:
    """Faces whose corners may stand in several lines; the last one of these ends the face, with what is its colour."""
    text = lines.joined(rows)
    ends = np.cumsum(lines.counts[rows]).tolist()
    values = numbers(text, ends[-1] if ends else 0, np.float64)
    found, at = [], 0
    for _ in range(faces):
        if at == len(values):
            early = "it ends before its last face"
            raise ValueError("a face has fewer corners than it says" if faces <= len(rows) else early)
        count = values[at]
        if not (count >= 0 and count % 1 == 0):
            raise ValueError(f"a face has {count:g} corners")
        if count >= len(values) - at:
            raise ValueError("a face has fewer corners than it says")
        last = at + int(count)
        end = ends[bisect_right(ends, last)]
        found.append((at + 1, int(count), end - last - 1))
        at = end
    first, counts, sizes = np.array(found, np.int64).reshape(-1, 3).T
    return Faces(values, first, counts, sizes, len(ends) - bisect_right(ends, at), text)


def _vertices(table: Doubles, has: tuple[bool, ...], raw: RawScene) -> Part:
    """A part without triangles; each row holds a position, then the normal, colour and coordinates of `has`."""
    textured, coloured, smooth = has
    width = table.shape[1]
    part = Part(table[:, :3], np.zeros((0, 3), np.int64), 0)
    colour = 3 + 3 * smooth
    end = width - 2 * textured
    if end < colour or (coloured and end - colour not in (3, 4)):
        raise ValueError("its vertices have other numbers of values than its first word tells")
    raw.note(
        "Vertices of the OFF file with more values than its first word tells, left out: {}.",
        (end > colour and not coloured) * len(table),
    )
    part.normals = table[:, 3:6] if smooth else None
    part.colours = linear_colours(raw, whole(table[:, colour:end])) if coloured else None
    if textured:
        part.uvs = np.stack([table[:, end], 1 - table[:, end + 1]], axis=1)
    return part


def _with_faces(part: Part, faces: Faces, raw: RawScene) -> Part:
    """The part with its triangles and perhaps their colours."""
    values, counts = faces.values, faces.counts
    before = np.cumsum(counts) - counts
    corners = vertex_numbers(values[np.repeat(faces.first - before, counts) + np.arange(counts.sum())])
    usable = usable_polygons(corners, counts, len(part.positions), raw)
    corners = corners[np.repeat(usable, counts)]
    places, polygon = triangulated(part.positions, corners, counts[usable], raw)
    part = replace(part, indices=corners[places])
    colours = _face_colours(faces, part.colours is not None, raw)
    if colours is not None:
        part = part.taking(part.indices.ravel(), np.arange(part.indices.size).reshape(-1, 3))
        part.colours = np.repeat(colours[usable][polygon], 3, axis=0)
    return part


def _face_colours(faces: Faces, left_out: bool, raw: RawScene) -> Floats | None:
    """Colours of faces, float32 (P, 4), white for those without; None where no face has any."""
    sizes, start = faces.sizes, faces.first + faces.counts
    usable = (sizes == 3) | (sizes == 4)
    raw.note("Faces whose colour is a number in a table that is not in the OFF file, left out: {}.", (sizes == 1).sum())
    raw.note("Faces with values that are no colour, left out: {}.", ((sizes == 2) | (sizes > 4)).sum())
    raw.note("Faces with colours besides those of the vertices, left out: {}.", left_out * usable.sum())
    if left_out or not usable.any():
        return None
    given = whole(faces.values[start[usable, None] + np.arange(3)])
    if given.dtype != np.uint8 and not re.search(rb"[^\d\s+-]", faces.text):
        in_bytes = ((given >= 0) & (given <= 255)).all()  # 0 and 1: only how they are written tells
        given = given.astype(np.uint8) if in_bytes else given
        sentence = "Faces whose colours are the whole numbers 0 and 1, taken to be of 255, as OFF files have them: {}."
        raw.note(sentence, in_bytes * usable.sum())
    opacity = faces.values[start[sizes == 4] + 3]
    colours = np.ones((len(sizes), 4), np.float32)
    colours[usable] = linear_colours(raw, given)
    full = 255 if given.dtype == np.uint8 else 1
    raw.note("Vertices or faces with an opacity of their own, drawn opaque: {}.", (opacity < full).sum())
    return colours
