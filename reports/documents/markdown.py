"""Marked places in Markdown documents, and what is written there from kept data.

    <!-- table NAME PART -->            the table of a part (`rows` unless named) and a line of where it came from;
    ...                                 everything up to the end is written anew
    <!-- end -->
    <!-- figure NAME PART -->           likewise a picture, drawn beside the data
    <!-- n EXPRESSION as FORMAT -->0.073<!-- / -->      a number within a sentence, never at the beginning of a line

An expression has operands joined by + - * /, taken from left to right: plain numbers, or NAME.PART(KEY, ...).FIELD,
whose keys name rows, `*` any. More than one row takes a `min`, `max`, `sum` or `count` in front. FORMAT is one of
Python's.
"""

from __future__ import annotations

import operator
import re
import string
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from shading_atlas_bench.reports.documents.kept import (
    FOLDER,
    ROOT,
    ROWS,
    DocumentError,
    Kept,
    Part,
    Row,
    Source,
    read_kept,
)
from shading_atlas_bench.reports.store.csv_files import replace_file

DOCUMENTS = (
    "README.md", "reports/SWEEP.md", "reports/STRESS.md", "reports/KERNELS.md", "reports/CLAIMS.md",
    "reports/PUBLISHED.md",
    "packers/README.md", "packers/TRANSPARENCY.md", "packers/ppll/README.md", "packers/sas/README.md",
    "packers/snakebinning/README.md", "packers/tss/README.md",
)  # fmt: skip
BLOCK = re.compile(r"<!-- (table|figure) ([\w-]+)(?: ([\w-]+))? -->\n(.*?)<!-- end -->", re.DOTALL)
NUMBER = re.compile(r"<!-- n (.*?) as (\S+) -->(.*?)<!-- / -->", re.DOTALL)
BEGINNING = re.compile(r"^ {0,3}(?:[-*] +)?<!-- n .*|^ +<!-- n .*", re.MULTILINE)
OPENING = re.compile(r"<!--(?! (?:/|end|ci:\w+) -->)")  # whatever is no end of a marker has to be a marker
OPERAND = re.compile(
    r"\s*(?:(?P<fold>min|max|sum|count)\s+)?(?:(?P<name>[a-z][\w-]*)(?:\.(?P<part>[\w-]+))?\((?P<keys>[^()]*)\)"
    r"\.(?P<field>\w+)|(?P<plain>\d+(?:\.\d+)?))\s*"
)
OPERATORS: dict[str, Callable[[float, float], float]] = {
    "+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv,
}  # fmt: skip
FOLDS: dict[str, Callable[[list[Any]], Any]] = {"min": min, "max": max, "sum": sum, "count": len}
NOT_MEASURED = "not measured yet"


@dataclass(frozen=True)
class Place:
    """A marked place. what: its marker's words, for people; start, end: of the text between the markers."""

    what: str
    sources: frozenset[str]
    start: int
    end: int
    printed: str
    right: str


class Book:
    """The sources with their kept data, read once. replaced: data by name that counts in place of what is kept."""

    def __init__(self, sources: Mapping[str, Source], root: Path = ROOT, replaced: Mapping[str, Kept] | None = None):
        self.sources, self.root = sources, root
        self._read: dict[str, Kept | None] = dict(replaced or {})

    def kept(self, name: str) -> Kept | None:
        """The data of a source, None where none is kept. Raises DocumentError for an unknown name."""
        if name not in self.sources:
            raise DocumentError(f"There is no table {name!r}; known are {', '.join(self.sources)}.")
        if name not in self._read:
            self._read[name] = read_kept(name, self.root)
        return self._read[name]

    def part(self, name: str, part: str) -> tuple[Part, list[Row]]:
        """What a part of a source is, and its rows. Raises DocumentError for an unknown part."""
        kept, parts = self.kept(name), self.sources[name].parts
        if part not in parts:
            raise DocumentError(f"The table {name} has no part {part!r}; it has {', '.join(parts)}.")
        return parts[part], kept.parts.get(part, []) if kept else []

    def places(self, text: str) -> Iterator[Place]:
        """The marked places of a document, in their order, with what is right there.

        Raises DocumentError for a marker that cannot be followed.
        """
        matches = sorted([*BLOCK.finditer(text), *NUMBER.finditer(text)], key=lambda match: match.start())
        if len(matches) != len(OPENING.findall(text)):
            starts = {match.start() for match in matches}
            lost = next((m for m in OPENING.finditer(text) if m.start() not in starts), None)
            where = text[lost.start() :].splitlines()[0] if lost else matches[0][0].splitlines()[0]
            raise DocumentError(f"The marker `{where[:80]}` cannot be read, has no end, or stands within another one.")
        if beginning := BEGINNING.search(text):  # such a line is HTML for Markdown, and ends the paragraph
            raise DocumentError(
                f"The number `{beginning[0].strip()[:80]}` stands at the beginning of a line: put a word before it."
            )
        for match in matches:
            yield self._block(match) if match.re is BLOCK else self._number(match)

    def _block(self, match: re.Match[str]) -> Place:
        kind, name, part = match[1], match[2], match[3] or ROWS
        about, rows = self.part(name, part)
        kept = self.kept(name)
        if kept is None:
            right = f"\n*{NOT_MEASURED.capitalize()}: `bench tables {name}`.*\n\n"
        elif kind == "figure":
            right = f"\n![{name}](data/{figure_name(name, part)})\n\n{provenance(kept)}\n\n"
        else:
            right = f"\n{table_text(about, rows)}\n\n{provenance(kept)}\n\n"
        return Place(f"{kind} {name} {part}", frozenset({name}), match.start(4), match.end(4), match[4], right)

    def _number(self, match: re.Match[str]) -> Place:
        expression = " ".join(match[1].split())
        names = frozenset(found["name"] for found in OPERAND.finditer(expression) if found["name"])
        missing = [name for name in names if self.kept(name) is None]
        right = NOT_MEASURED if missing else self.evaluate(expression, match[2])
        return Place(expression, names, match.start(3), match.end(3), match[3], right)

    def evaluate(self, expression: str, form: str) -> str:
        """The value of an expression as text. Raises DocumentError where it has none."""
        value, place = self._operand(expression, 0)
        while place < len(expression):
            symbol = expression[place]
            if symbol not in OPERATORS:
                raise DocumentError(f"The expression `{expression}` cannot be read at `{expression[place:]}`.")
            other, place = self._operand(expression, place + 1)
            if symbol == "/" and other == 0:
                raise DocumentError(f"The expression `{expression}` divides by zero.")
            value = OPERATORS[symbol](value, other)
        try:
            return format(value, form)
        except ValueError as error:
            raise DocumentError(f"The value of `{expression}` cannot be written as {form!r}.") from error

    def _operand(self, expression: str, place: int) -> tuple[Any, int]:
        match = OPERAND.match(expression, place)
        if match is None:
            raise DocumentError(f"The expression `{expression}` cannot be read at `{expression[place:]}`.")
        if match["plain"]:
            return float(match["plain"]), match.end()
        about, rows = self.part(match["name"], match["part"] or ROWS)
        keys = [key.strip() for key in match["keys"].split(",")] if match["keys"].strip() else []
        wanted = [keys[k] if k < len(keys) else "*" for k in range(len(about.key))]
        found = [
            row[match["field"]]
            for row in rows
            if all(key in ("*", str(row.get(name))) for key, name in zip(wanted, about.key, strict=True))
            and row.get(match["field"]) is not None
        ]
        if not found or len(keys) > len(about.key) or (len(found) > 1 and not match["fold"]):
            raise DocumentError(f"`{match[0].strip()}` names {len(found)} values: it has to name one.")
        return (FOLDS[match["fold"]](found) if match["fold"] else found[0]), match.end()

    def figures(self) -> dict[Path, str]:
        """The files of all figures, below the root, and what has to be in them."""
        found = {}
        for name, source in self.sources.items():
            for part, about in source.parts.items():
                rows = self.part(name, part)[1]
                if about.figure and rows:
                    found[Path(FOLDER) / figure_name(name, part)] = about.figure(rows)
        return found

    def written(self, text: str) -> str:
        """The document with every marked place as it has to be."""
        parts, end = [], 0
        for place in self.places(text):
            parts += [text[end : place.start], place.right]
            end = place.end
        return "".join(parts) + text[end:]


def figure_name(name: str, part: str) -> str:
    """The file of a figure, in the folder of the kept data."""
    return f"{name}-{part}.svg"


def table_text(part: Part, rows: list[Row]) -> str:
    """The rows of a part as a Markdown table; a value that is not there is an empty cell."""
    columns = part.columns
    lines = [
        [column.heading for column in columns],
        ["---" if column.left else "---:" for column in columns],
        *([_cell(column.forms, row) for column in columns] for row in rows),
    ]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _cell(forms: tuple[str, ...], row: Row) -> str:
    for form in forms:
        if all(row.get(name) is not None for _, name, _, _ in string.Formatter().parse(form) if name):
            return form.format(**row).replace("|", "/")
    return ""


def provenance(kept: Kept) -> str:
    """One line: the command, and commit, date, device and driver of their measurement."""
    about = kept.about
    commands = f"`{about['commands'][0]}`"
    if len(about["commands"]) > 1:
        commands += f" and {len(about['commands']) - 1} more like it"
    facts = [f"commit {about['commit']}", about["date"], about["device"], about["driver"]]
    return f"<sub>{commands}. {', '.join(filter(None, facts))}.</sub>"


def printed_in(root: Path = ROOT) -> dict[str, list[str]]:
    """The documents that print a table or figure of each source. Raises DocumentError."""
    places: dict[str, list[str]] = {}
    for name in DOCUMENTS:
        for source in dict.fromkeys(match[2] for match in BLOCK.finditer(_read(root / name))):
            places.setdefault(source, []).append(name)
    return places


def check_documents(root: Path = ROOT) -> None:
    """Raise DocumentError where a document is not there, as in an installation without the repository."""
    for name in DOCUMENTS:
        _read(root / name)


def write_documents(book: Book) -> list[str]:
    """Write every figure, and every marked place of every document; the names of those that changed.

    Raises DocumentError.
    """
    changed = []
    for path, drawn in book.figures().items():
        if not (book.root / path).is_file() or _read(book.root / path) != drawn:
            replace_file(book.root / path, drawn)
            changed.append(path.as_posix())
    for name in DOCUMENTS:
        text = _read(book.root / name)
        try:
            new = book.written(text)
        except DocumentError as error:
            raise DocumentError(f"{name}: {error}") from None
        if new != text:
            replace_file(book.root / name, new)
            changed.append(name)
    return changed


def wrong_places(book: Book, of: str | None = None) -> list[str]:
    """A sentence for every marked place whose text is not what the book gives; `of`: only those made from this source.

    Raises DocumentError.
    """
    figures = book.figures().items() if of is None else ()
    found = [f"{path} is not what its data draws." for path, drawn in figures if _read(book.root / path) != drawn]
    for name in DOCUMENTS:
        text = _read(book.root / name)
        for place in book.places(text):
            if place.printed != place.right and (of is None or of in place.sources):
                line = text.count("\n", 0, place.start) + 1
                found += [f"{name}, line {line + down}: {what}" for down, what in _differences(place)]
    return found


def _differences(place: Place) -> Iterator[tuple[int, str]]:
    """Lines from the place's start, and what differs there; the first of each row of a table."""
    old, new = place.printed.splitlines() or [""], place.right.splitlines() or [""]
    if len(old) != len(new):
        yield 0, f"{place.what} has {len(old)} lines, and now {len(new)}."
        return
    for down, (before, after) in enumerate(zip(old, new, strict=True)):
        if before != after:
            cells = [(a, b) for a, b in zip(before.split("|"), after.split("|"), strict=False) if a != b]
            printed, now = (text.strip() for text in (cells or [(before, after)])[0])
            first = before.split("|")[1:3] if before.startswith("|") else [place.what]
            yield down, f"{', '.join(filter(None, map(str.strip, first)))}: printed {printed!r}, now {now!r}."


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise DocumentError(
            f"{path} is not there: bench tables needs a clone of the repository, installed with -e."
        ) from error
