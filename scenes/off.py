"""OFF files (Geomview's object file format): polygons with normals, colours and texture coordinates.

Read here and not by trimesh, which reads no colours.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from scenes.file_colours import linear_colours, whole
from scenes.files import file_text
from scenes.model import SceneError
from scenes.polygons import triangulated, usable_polygons
from scenes.raw import Part, RawScene
from scenes.text_lines import TextLines, numbers


def read_off(path: Path, raw: RawScene) -> None:
    """All faces of an OFF file, with what its first word tells of vertices: ST, C and N before OFF.

    Raises SceneError for binary files and those of another number of dimensions, ValueError for damaged ones.
    """
    text = re.sub(rb"#[^\n]*", b"", file_text(path))
    head = re.match(rb"\s*(?:(ST)?(C)?(N)?(4?n?)OFF\b)?\s*(BINARY)?", text)
    if head[4] or head[5]:
        raise SceneError("Its points are binary or of more than three dimensions; it has to be a plain OFF file.")
    sizes = re.compile(rb"\s*(\d+)\s+(\d+)([ \t]+\d+)?[ \t]*\n").match(text, head.end())
    if sizes is None:
        raise ValueError("it does not begin with OFF and the numbers of its vertices and faces")
    vertices, faces = int(sizes[1]), int(sizes[2])
    lines = TextLines(text[sizes.end() :])
    rows = np.arange(len(lines.starts))
    if vertices + faces > len(rows):
        raise ValueError("it ends before its last face")
    raw.note("Lines behind the last face of the OFF file, left out: {}.", len(rows) - vertices - faces)
    part = _vertices(lines, rows[:vertices], head.groups()[:3], raw)
    raw.parts.append(_with_faces(part, lines, rows[vertices : vertices + faces], raw))


def _vertices(lines: TextLines, rows: np.ndarray, has: tuple[bytes | None, ...], raw: RawScene) -> Part:
    """A part without triangles; each line holds a position, then the normal, colour and coordinates of `has`."""
    textured, coloured, smooth = (bool(prefix) for prefix in has)
    width = int(lines.counts[rows].max(initial=3))
    if (lines.counts[rows] != width).any():
        raise ValueError("its vertices have different numbers of values")
    table = numbers(lines.joined(rows), len(rows) * width).reshape(-1, width)
    part = Part(table[:, :3], np.zeros((0, 3), np.int64), 0)
    colour = 3 + 3 * smooth
    end = width - 2 * textured
    if end < colour or (coloured and end - colour not in (3, 4)):
        raise ValueError("its vertices have other numbers of values than its first word tells")
    raw.note(
        "Vertices of the OFF file with more values than its first word tells, left out: {}.",
        (end > colour and not coloured) * len(rows),
    )
    part.normals = table[:, 3:6] if smooth else None
    part.colours = linear_colours(whole(table[:, colour:end]), raw) if coloured else None
    if textured:
        part.uvs = np.stack([table[:, end], 1 - table[:, end + 1]], axis=1)
    return part


def _with_faces(part: Part, lines: TextLines, rows: np.ndarray, raw: RawScene) -> Part:
    """The part with its triangles: lines of a number of corners, these, and perhaps a colour of 3 or 4 numbers."""
    widths = lines.counts[rows]
    values = numbers(lines.joined(rows), int(widths.sum()))
    start = np.cumsum(widths) - widths
    counts = values[start].astype(np.int64)
    if (counts != values[start]).any() or (counts < 0).any() or (counts >= widths).any():
        raise ValueError("a face has fewer corners than it says")
    within = np.arange(len(values)) - np.repeat(start, widths)
    corners = values[(within > 0) & (within <= np.repeat(counts, widths))].astype(np.int64)
    usable = usable_polygons(corners, counts, len(part.positions), raw)
    corners = corners[np.repeat(usable, counts)]
    places, polygon = triangulated(part.positions, corners, counts[usable], raw)
    part = replace(part, indices=corners[places])
    colours = _face_colours(values, start + counts + 1, widths - counts - 1, part.colours is not None, raw)
    if colours is not None:
        part = part.taking(part.indices.ravel(), np.arange(part.indices.size).reshape(-1, 3))
        part.colours = np.repeat(colours[usable][polygon], 3, axis=0)
    return part


def _face_colours(
    values: np.ndarray, start: np.ndarray, sizes: np.ndarray, left_out: bool, raw: RawScene
) -> np.ndarray | None:
    """Colours of faces, float32 (P, 4), white for those without; None where no face has any."""
    usable = (sizes == 3) | (sizes == 4)
    raw.note("Faces whose colour is a number in a table that is not in the OFF file, left out: {}.", (sizes == 1).sum())
    raw.note("Faces with values that are no colour, left out: {}.", ((sizes == 2) | (sizes > 4)).sum())
    raw.note("Faces with colours besides those of the vertices, left out: {}.", left_out * usable.sum())
    if left_out or not usable.any():
        return None
    table = values[start[usable, None] + np.arange(3)]
    opacity = values[start[sizes == 4] + 3]
    given = whole(table)
    colours = np.ones((len(sizes), 4), np.float32)
    colours[usable] = linear_colours(given, raw)
    full = 255 if given.dtype == np.uint8 else 1
    raw.note("Vertices or faces with an opacity of their own, drawn opaque: {}.", (opacity < full).sum())
    return colours
