"""What fits into memory, asked before it is taken: where too much is taken, the system ends the process without a
word."""

from __future__ import annotations

from shading_atlas_bench.memory import memory_bound
from shading_atlas_bench.scenes.model import SceneError


def check_memory(size: int, what: str, remedy: str = "use a larger machine") -> None:
    """Raise SceneError, saying what takes so many bytes and the remedy, for more than half of what this process may
    have: what is made of a scene later needs the other half."""
    bound = memory_bound()
    if size > bound.size / 2:
        sizes = f"{size / 1e9:,.1f} GB, more than half of {bound.what}, {bound.size / 1e9:,.1f} GB"
        raise SceneError(f"{what} takes {sizes}: {remedy}.")
