"""What is left out because nothing needs it, and what is done all the same because a run asks for it."""

from __future__ import annotations

from collections.abc import Iterable


class Skips:
    """off: names of skips that are forced off: their work is done, and changes no byte of any result.

    always: what is left out of everything, because of the scene.
    """

    def __init__(self, off: Iterable[str] = ()) -> None:
        self.off = frozenset(off)
        self.always: frozenset[str] = frozenset()
        self._applied: set[str] = set()

    def leaves_out(self, name: str, unneeded: bool) -> bool:
        """Whether to leave `name` out, where `unneeded` says that nothing needs it; notes it if so."""
        leaves = unneeded and name not in self.off
        if leaves:
            self._applied.add(name)
        return leaves

    def take(self) -> frozenset[str]:
        """What was left out since the last call."""
        applied, self._applied = frozenset(self._applied), set()
        return applied
