"""The errors that are for people: what is wrong, where, and what to do, in one sentence that can be printed."""

from __future__ import annotations

import unicodedata

LONGEST = 1600  # letters of a sentence
_UNSEEN = ("Cc", "Cf", "Cs", "Zl", "Zp")  # controls, formats, halves of letters, and Unicode's own line ends
_KEPT = "\n\t\u200c\u200d"  # the last two are letters' joiners, as in emoji and in scripts of India


class BenchError(Exception):
    """Whatever a person can mend.

    sentence: with the names of files and texts of others in it as they are; those of their letters that no terminal
        shows become escapes, and of over LONGEST letters the middle is left out. log: lines of another program, put
        behind it.
    """

    def __init__(self, sentence: str, log: str = "") -> None:
        line = visible(sentence).replace("\n", "\\n")
        if len(line) > LONGEST:
            line = f"{line[: LONGEST // 2]} … {line[-LONGEST // 4 :]}"
        super().__init__(line + visible(log))


def visible(text: object) -> str:
    """The text with everything as an escape that is no letter to be seen: what steers a terminal, turns the direction
    of writing, or breaks a line without being a line's end. Line ends, tabs and what joins letters stay."""
    return "".join(_seen(letter) for letter in str(text))


def _seen(letter: str) -> str:
    if letter in _KEPT or unicodedata.category(letter) not in _UNSEEN:
        return letter
    return letter.encode("unicode_escape").decode("ascii")
