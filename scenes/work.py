"""How much work is done for a scene that is not worth it: counted in steps and not in seconds, so that the same comes
of a scene on every machine."""

from __future__ import annotations


class WorkError(Exception):
    """There are no steps left."""


class Work:
    """Steps that may still be taken."""

    def __init__(self, most: int) -> None:
        self._left = most

    def take(self, steps: int) -> None:
        """Count steps that are about to be taken. Raises WorkError where they are more than there are left."""
        if steps > self._left:
            raise WorkError
        self._left -= steps
