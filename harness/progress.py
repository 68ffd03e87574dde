"""What long work says on its way. Whoever starts it decides how that is shown; by default it is not."""

from __future__ import annotations

import sys
import warnings
from typing import Self, TextIO

from shading_atlas_bench.errors import visible


class Task:
    """One piece of long work, until its `with` block ends."""

    def doing(self, what: str) -> None:
        """What is being done now."""

    def advance(self, steps: int = 1) -> None:
        """So many steps more are done."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass


class Progress:
    """Takes what long work says, and shows nothing of it."""

    def say(self, sentence: str) -> None:
        """Something to know while it runs."""

    def warn(self, sentence: str) -> None:
        """Something that makes results other than expected."""

    def task(self, what: str, steps: int | None = None) -> Task:
        """Begin a piece of work of so many steps, where their number is known."""
        return Task()


def warnings_as_sentences() -> None:
    """Have warnings that are for users printed on stderr without the line of source that they come from."""
    in_full = warnings.showwarning

    def show(
        message: Warning | str,
        category: type[Warning],
        filename: str,
        lineno: int,
        file: TextIO | None = None,
        line: str | None = None,
    ) -> None:
        if category is UserWarning:
            print(f"bench: warning: {visible(message)}", file=file or sys.stderr, flush=True)
        else:
            in_full(message, category, filename, lineno, file, line)

    warnings.showwarning = show
