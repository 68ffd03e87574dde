"""The door through which texts of others (reasons, names of scenes, labels) enter a page."""

from __future__ import annotations

import html

from shading_atlas_bench.errors import visible


def escape(text: str) -> str:
    """As text in HTML, also in an attribute, with escapes for what is not seen, such as what turns the direction of
    writing."""
    return html.escape(visible(text))


def seen(value: object) -> object:
    """A value of plain types whose texts, keys among them, have escapes for what is not seen."""
    if isinstance(value, dict):
        return {seen(name): seen(part) for name, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [seen(part) for part in value]
    return visible(value) if isinstance(value, str) and not value.isprintable() else value
