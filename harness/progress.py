"""What long work says on its way. Whoever starts it decides how that is shown; by default it is not."""

from __future__ import annotations

from typing import Self


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
