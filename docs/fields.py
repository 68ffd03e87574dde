"""Docstrings name fields and arguments as `name: what it is.` within their text; on the site these become a list."""

from __future__ import annotations

import re
from typing import Any

import griffe

OUTCOME = re.compile(r"\n(?=Returns |Raises )")


class Fields(griffe.Extension):
    """Lists what the docstrings of classes and functions say of their fields and arguments."""

    def on_class(self, *, cls: griffe.Class, **_: Any) -> None:
        """Of a class: its members, and the arguments of `__init__`."""
        members = cls.members.get("__init__")
        arguments = [one.name for one in members.parameters] if isinstance(members, griffe.Function) else []
        _list_fields(cls, [*cls.members, *arguments])

    def on_function(self, *, func: griffe.Function, **_: Any) -> None:
        """Of a function: its arguments."""
        _list_fields(func, [one.name for one in func.parameters])


def _list_fields(described: griffe.Object, names: list[str]) -> None:
    if described.docstring is not None and names:
        described.docstring.value = listed(described.docstring.value, names)


def listed(text: str, names: list[str]) -> str:
    """The text with a list in place of each run of `name: meaning.`, of these names, that a paragraph ends with.

    A meaning goes up to the next name or the end of the paragraph; a sentence that begins with `Returns` or `Raises` is
    none of it.
    """
    known = "|".join(map(re.escape, names))
    start = re.compile(rf"(?:^|(?<=[.;] )|(?<=\n))(?P<names>(?:{known})(?:, (?:{known}))*): ")
    paragraphs = []
    for paragraph in text.split("\n\n"):
        lines = re.sub(r"\n\s+", " ", paragraph)
        found = list(start.finditer(lines))
        if not found:
            paragraphs.append(paragraph)
            continue
        before, ends = lines[: found[0].start()].strip(), [*(one.start() for one in found[1:]), len(lines)]
        after, items = "", []
        for one, end in zip(found, ends, strict=True):
            meaning, *rest = OUTCOME.split(lines[one.end() : end], 1)
            after += " ".join(rest)
            items.append(f"- **{one['names']}**: {' '.join(meaning.split())}")
        paragraphs += [part for part in (before, "\n".join(items), after.strip()) if part]
    return "\n\n".join(paragraphs)
