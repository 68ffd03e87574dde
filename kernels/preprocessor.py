"""What the preprocessor of OpenCL C sees in a kernel's text: its comments and continued lines."""

from __future__ import annotations

import re

HIDDEN = "\0"
# Strings come first: what looks like a comment in one is none.
TOKEN = re.compile(
    r"""(?P<string>"(?:\\.|[^"\\\n])*"|'(?:\\.|[^'\\\n])*')|//(?:\\\n|[^\n])*|/\*.*?(?:\*/|\Z)|\\\n""", re.DOTALL
)


def hidden(text: str) -> str:
    """The text with HIDDEN in place of every character of a comment and of the end of a continued line."""
    return TOKEN.sub(lambda match: match.group() if match["string"] else HIDDEN * len(match.group()), text)


def logical_lines(text: str) -> str:
    """The text with continued lines in one, and a space in place of every comment."""
    joined = text.replace("??/", "\\").replace("??=", "#").replace("\\\n", "")
    return TOKEN.sub(lambda match: match["string"] or " ", joined)
