"""The style of all pages."""

from __future__ import annotations

from importlib.resources import files


def page_style() -> str:
    """The style sheet's text."""
    return files(__package__).joinpath("page.css").read_text(encoding="utf-8")
